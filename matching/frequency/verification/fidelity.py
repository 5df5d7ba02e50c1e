"""XiL fidelity of a match on its manoeuvre (Eqs. 14 to 23), without control and matched, from the simulated traces.

R_SD compares torque and speed at every cut, as the paper does with M and n of each load dynamometer; R_RVM the
vehicle's sensors behind the cuts with what the residual vehicle reads (see ``verification/emulated.py``);
R_MU takes U = 2·u of the torque and speed sensor of every dynamometer over the range that the vehicle shows there.
The simulated signals carry no noise, so the uncertainty stated is that of U as an offset and of the delays.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from matching.frequency.loop.emulated import PLACE, on_emulated_side
from matching.frequency.loop.parts import Parts
from matching.frequency.verification.simulation import Traces
from modelling.fidelity.assess import fidelity_of_signals
from modelling.fidelity.distribution import FidelityDistribution, fidelity_distribution
from modelling.fidelity.fidelity import Fidelity, SignalPair
from modelling.fidelity.measures import WEIGHTS

COVERAGE_FACTOR = 2.0
LONGEST_DELAY = 0.25  # s: a delay beyond it counts as none of the fidelity, and so does a tenth of it at 30 Hz
DRAWS = 5_000
RATE = 8.0  # samples a period of f_max that are enough; simulated signals carry no noise to average
AT_REST = 1e-9  # N·m, rad/s, rad/s²
SHORT = {"system_dynamics": "R_SD", "residual_vehicle_model": "R_RVM", "measurement_uncertainty": "R_MU"}


@dataclass(frozen=True)
class MatchFidelity:
    """Fidelity without control and as matched; ``at_rest`` names signals the manoeuvre leaves at rest, left out."""

    before: Fidelity
    after: Fidelity
    at_rest: tuple[str, ...]

    @cached_property
    def distributions(self) -> tuple[FidelityDistribution, FidelityDistribution]:
        """Distributions of both, seeded."""
        return fidelity_distribution(self.before, DRAWS), fidelity_distribution(self.after, DRAWS)

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it; a domain without a signal is None and its weight is 0."""
        notes = [f"{name} is left at rest by the manoeuvre and does not count" for name in self.at_rest]
        if not self.after.sensors:
            notes.append("no dynamometer's sensor has an uncertainty: R_MU is left out and the weights are scaled up")
        return {
            "f_max": self.after.f_max,
            "weights": {SHORT[name]: self.after.weights.get(name, 0.0) for name in SHORT},
            "before": _described(self.before, self.distributions[0]),
            "after": _described(self.after, self.distributions[1]),
            "notes": notes,
        }


def match_fidelity(parts: Parts, traces: Traces) -> MatchFidelity | None:
    """Fidelity of free and matched rig; None where the manoeuvre leaves every cut at rest.

    Parameters
    ----------
    parts : Parts
        Of the tuned case.
    traces : Traces
        Of its manoeuvre.
    """
    f_max = parts.case.band[1]
    every = max(int(1 / (RATE * f_max * parts.case.loop["sample_time"])), 1)
    wanted = _signals(parts, traces)
    resting = tuple(
        member.name for members in wanted.values() for member in members if np.ptp(member.reference) <= AT_REST
    )
    kept = {
        domain: [member for member in members if member.name not in resting and member.name in traces.matched]
        for domain, members in wanted.items()
    }
    if not kept["system_dynamics"]:
        return None
    there = {domain for domain, members in kept.items() if members}
    if any(member.uncertainty for member in kept["system_dynamics"]):
        there.add("measurement_uncertainty")
    total = sum(WEIGHTS[domain] for domain in there)
    weights = {domain: WEIGHTS[domain] / total for domain in WEIGHTS if domain in there}

    def assessed(rig: Mapping[str, np.ndarray]) -> Fidelity:
        dynamics, emulated = (
            {member.name: member.pair(rig[member.name], every) for member in kept[domain]}
            for domain in ("system_dynamics", "residual_vehicle_model")
        )
        longest = min(LONGEST_DELAY, float(traces.time[-1]) / 4)
        return fidelity_of_signals(
            traces.time[::every], dynamics, emulated, f_max=f_max, weights=weights, longest_delay=longest
        )

    return MatchFidelity(assessed(traces.rig), assessed(traces.matched), resting)


@dataclass(frozen=True)
class _Signal:
    """A trace of the rigs by name with the vehicle's (t,), the sensor's standard uncertainty."""

    name: str
    reference: np.ndarray
    uncertainty: float | None

    def pair(self, test: np.ndarray, every: int) -> SignalPair:
        u = None if self.uncertainty is None else COVERAGE_FACTOR * self.uncertainty
        return SignalPair(self.reference[::every], test[::every], u, COVERAGE_FACTOR, noise=(0.0, 0.0))


def _signals(parts: Parts, traces: Traces) -> dict[str, list[_Signal]]:
    sensors = {sensor.name: sensor for sensor in parts.case.rig.sensors}
    dynamics = []
    for dyno in parts.dynamometers:
        for name, sensor in (
            (f"shafts.{dyno.follows}.torque", dyno.torque_sensor),
            (f"interfaces.{dyno.follows}.speed", dyno.speed_sensor),
        ):
            dynamics.append(_Signal(name, traces.vehicle[name], sensors[sensor].uncertainty))
    behind = [_Signal(PLACE + name, traces.vehicle[name], None) for name in on_emulated_side(parts.case.vehicle, parts)]
    if not behind:  # the vehicle has no sensor there: the speed at the cuts that the residual vehicle asks for
        behind = [
            _Signal(PLACE + cut.speed, traces.vehicle[f"interfaces.{cut.shaft}.speed"], None) for cut in parts.cuts
        ]
    return {"system_dynamics": dynamics, "residual_vehicle_model": behind}


def _described(judged: Fidelity, drawn: FidelityDistribution) -> dict[str, Any]:
    total = drawn.summary()["total"]
    return {short: judged.domains.get(name) for name, short in SHORT.items()} | {
        "R_XiL": judged.total,
        "standard_uncertainty": total.standard_uncertainty,
        "interval": list(total.interval),
        "signals": {
            SHORT[domain]: [
                {
                    "name": member.name,
                    "R_NRMSE": member.nrmse,
                    "R_tau": member.delay_fidelity,
                    "delay": member.delay.value,
                    "delay_undetermined": member.delay.reason or None,
                }
                for member in members
            ]
            for domain, members in judged.signals.items()
        },
        "sensors": [{"name": sensor.name, "uncertainty_over_range": sensor.ratio} for sensor in judged.sensors],
    }
