"""Fidelity of base and extended model on held-out data: R_RVM and R_MU (Eqs. 18–23 of the paper).

A diagnosed model is what a residual vehicle model is cut from, so R_RVM is what its errors cost a test bed. Reference
is the measurement, test the free simulation; R_MU takes U = 2·u of the sensors.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from matching.diagnosis.data.holdout_residuals import HoldoutData
from modelling.fidelity.assess import assemble, assess_signal
from modelling.fidelity.distribution import fidelity_distribution
from modelling.fidelity.fidelity import Fidelity, FidelityMethod, SensorUncertainty, SignalFidelity, SignalPair
from modelling.fidelity.measures import WEIGHTS, delay_fidelity, dynamics_fidelity
from modelling.model.system import System

DRIVABILITY_HZ = 30.0  # f_max of the paper's manoeuvres
SHARE_OF_SAMPLING = 0.25  # f_max at most, of the sampling frequency
LONGEST_DELAY = 0.25  # s between measurement and simulation that is looked for
SHORT_GAP = 0.02  # s without a reading that is bridged by a straight line
FEWEST_SAMPLES = 64  # of a part without a longer gap
SMALLEST_RANGE = 4.0  # times the noise: a sensor that moves less says nothing about the dynamics
DRAWS = 5_000  # of the Monte Carlo for the uncertainty of the fidelity
COVERAGE_FACTOR = 2.0  # U = 2·u
DOMAINS = {"residual_vehicle_model": "R_RVM", "measurement_uncertainty": "R_MU"}


@dataclass(frozen=True)
class ModelFidelity:
    """Fidelity of one model: of its dynamics, of the measurement and in total, with standard uncertainties, and by
    signal."""

    r_rvm: float
    r_rvm_uncertainty: float
    r_mu: float
    r_xil: float
    r_xil_uncertainty: float
    signals: tuple[SignalFidelity, ...]

    def to_dict(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        return {
            "R_RVM": self.r_rvm,
            "R_MU": self.r_mu,
            "R_RVM_standard_uncertainty": self.r_rvm_uncertainty,
            "R_XiL": self.r_xil,
            "standard_uncertainty": self.r_xil_uncertainty,
            "signals": [
                {"name": signal.name, "R_NRMSE": signal.nrmse, "R_tau": signal.delay_fidelity,
                 "delay": signal.delay.value, "delay_standard_uncertainty": signal.delay.standard_uncertainty,
                 "delay_undetermined": signal.delay.reason or None}
                for signal in self.signals
            ],
        }  # fmt: skip


@dataclass(frozen=True)
class HoldoutFidelity:
    """Fidelity before and after the extension.

    Attributes
    ----------
    f_max : float
        Largest relevant frequency, Hz.
    weights : dict of str to float
        By domain.
    before, after : ModelFidelity
    noise_floor : float
        R_RVM of a perfect model: the measurement's noise counts against any.
    seconds : dict of str to float
        By sensor, how long the part is that was judged.
    notes : list of str
    """

    f_max: float
    weights: dict[str, float]
    before: ModelFidelity
    after: ModelFidelity
    noise_floor: float
    seconds: dict[str, float]
    notes: list[str]

    def to_dict(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        return {
            "f_max": self.f_max, "weights": {DOMAINS[name]: share for name, share in self.weights.items()},
            "before": self.before.to_dict(), "after": self.after.to_dict(),
            "noise_floor": {"R_RVM": self.noise_floor}, "judged_seconds": self.seconds, "notes": self.notes,
        }  # fmt: skip


@dataclass(frozen=True)
class _EvenPart:
    """A sensor's longest part without a long gap, at even steps: readings and residuals of both models (t,), SI."""

    measured: np.ndarray
    before: np.ndarray
    after: np.ndarray
    seconds: float


def fidelity(system: System, data: HoldoutData) -> HoldoutFidelity | None:
    """R_RVM and R_MU before and after the extension; None if no sensor can be judged.

    A sensor's figures are those of its longest part without a gap.
    """
    step = float(np.median(np.diff(data.time[data.parts[0]])))
    f_max = min(DRIVABILITY_HZ, SHARE_OF_SAMPLING / step)
    method = FidelityMethod(f_max, longest_delay=LONGEST_DELAY)
    before: list[SignalFidelity] = []
    after: list[SignalFidelity] = []
    sensors: list[SensorUncertainty] = []
    floor, seconds, notes = [], {}, []
    for j, sensor in enumerate(system.sensors):
        if not np.isfinite(data.measured[:, j]).any():
            continue
        part = _longest_part(data, j)
        if part is None:
            notes.append(f"{sensor.name} has no part of held-out data long enough for its fidelity")
            continue
        u, width = float(data.noise[j]), float(np.ptp(part.measured))
        if not width > SMALLEST_RANGE * u:
            notes.append(f"{sensor.name} hardly moves on held-out data and does not count in the fidelity")
            continue
        for scores, residual in ((before, part.before), (after, part.after)):
            if scores is after and np.array_equal(part.before, part.after):  # no cause: the delay is sought once
                scores.append(before[-1])
                continue
            pair = SignalPair(part.measured, part.measured - residual, noise=(u, 0.0))
            scores.append(assess_signal(sensor.name, pair, step, method))
        floor.append(max(0.0, 1 - u / width))
        sensors.append(SensorUncertainty(sensor.name, COVERAGE_FACTOR * u / width))
        seconds[sensor.name] = part.seconds
    if not sensors:
        return None
    total = sum(WEIGHTS[name] for name in DOMAINS)
    weights = {name: WEIGHTS[name] / total for name in DOMAINS}
    models = [
        _with_uncertainty(assemble({"residual_vehicle_model": tuple(scores)}, tuple(sensors), weights, method, step))
        for scores in (before, after)
    ]
    no_delay = [float(delay_fidelity(0.0, f_max))] * len(floor)
    return HoldoutFidelity(f_max, weights, models[0], models[1], dynamics_fidelity(floor, no_delay), seconds, notes)


def _longest_part(data: HoldoutData, j: int) -> _EvenPart | None:
    """A sensor's longest part without a long gap."""
    longest = np.empty(0, dtype=int)
    for part in data.parts:
        known = np.isfinite(data.measured[part, j]) & np.isfinite(data.before[part, j] + data.after[part, j])
        samples = np.flatnonzero(known) + part.start
        for piece in np.split(samples, np.flatnonzero(np.diff(data.time[samples]) > SHORT_GAP) + 1):
            if len(piece) > len(longest):
                longest = piece
    if len(longest) < FEWEST_SAMPLES:
        return None
    time = data.time[longest]
    step = float(np.median(np.diff(time)))
    even = time[0] + step * np.arange(int((time[-1] - time[0]) / step * (1 + 1e-9)) + 1)
    columns = (data.measured[longest, j], data.before[longest, j], data.after[longest, j])
    measured, before, after = (np.interp(even, time, column) for column in columns)
    return _EvenPart(measured, before, after, float(even[-1] - even[0]))


def _with_uncertainty(model: Fidelity) -> ModelFidelity:
    drawn = fidelity_distribution(model, DRAWS).summary()
    return ModelFidelity(
        model.domains["residual_vehicle_model"], drawn["residual_vehicle_model"].standard_uncertainty,
        model.domains["measurement_uncertainty"], model.total, drawn["total"].standard_uncertainty,
        model.signals["residual_vehicle_model"],
    )  # fmt: skip
