"""Everything a tuned case is checked by, in one call."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from matching.match.beds import (
    BedsCheck,
    LoopFigures,
    check_beds,
    loop_figures,
    loop_frequencies,
    margins_of,
    noise_of_sensors,
    planned,
)
from matching.match.case import Case
from matching.match.damping import decay_rates, is_stable_loop, rates, stable_loops, without_resting
from matching.match.demands import stresses
from matching.match.kept import ReachedTarget, candidates_of, target_modes_of
from matching.match.loop import (
    Body,
    LinearBed,
    SampledController,
    bed_set,
    body,
    closed_poles,
    compared_sensors,
    control_law,
    controller_on,
    errors,
    frequency_response,
    interface_speed,
    linear_bed,
    shaft_torque,
    side_by_side,
    watched,
)
from matching.match.loop_modes import (
    PLACE,
    ClosedLoop,
    LoopMode,
    eigenvalue_of,
    emulated,
    neutral_motions,
    on_emulated_side,
)
from matching.match.requirements import Requirements, requirements
from matching.match.responses import ResponseError, error_figures
from matching.match.targets import target_modes
from modelling.bed.bed import ControlLaw
from modelling.bed.manoeuvres import Kick
from modelling.bed.nonlinear import BedHardware, NonlinearBeds
from modelling.equations.casadi_code import compiled
from modelling.fidelity.measures import (
    WEIGHTS,
    Fidelity,
    FidelityDistribution,
    SignalPair,
    fidelity_distribution,
    fidelity_of_signals,
)
from modelling.fidelity.over_range import REST, error_over_range
from modelling.linear.elements import elements
from modelling.linear.state_space import discretise
from modelling.linear.steady_motion import is_linear, operating_motion, torques_of
from modelling.modal.result import Mode
from modelling.modal.ringing import Ringing, read_modes
from modelling.running.beds import BedRows
from modelling.running.controllers import ControllerRows, Schedule, plain
from modelling.running.run import TOO_LARGE, grown, run
from modelling.simulation.stepping import SimulationError
from modelling.system import System, mirror_image

# --- Torques by input as columns.


def torque_columns(torques: Mapping[str, np.ndarray], names: Sequence[str], count: int) -> np.ndarray:
    """Torques (t, u) in N·m in the order of ``names``; 0 where one is not given for the ``count`` samples."""
    columns = [np.asarray(torques.get(name, np.zeros(count)), float) for name in names]
    return np.stack(columns, axis=1) if columns else np.zeros((count, 0))


# --- Time simulation of vehicle, rig without control and matched rig: one time base, a true delay line, sampled
# control.
#
# The controller runs at the loop's sample time. The dead time is counted from a sample to the middle of what its
# command does: the hold lags half a sample, so the delay line is half a sample shorter than the dead time (not below
# 0). Torques of the manoeuvre vary linearly between samples, for vehicle and rig alike.


@dataclass(frozen=True)
class Traces:
    """Vehicle, rig without control and matched rig over one manoeuvre, SI.

    Each of the three maps names to traces (t,), less their values at the operating point: sensors by name,
    ``interfaces.SHAFT.speed``, ``shafts.NAME.torque`` and ``.twist``; of both rigs ``residual_vehicle.SENSOR``, what
    the residual vehicle reads (:func:`.loop_modes.emulated`). Of the matched rig also ``dynamometers.NAME.torque``
    (air gap), ``.speed``, ``.power`` and ``.command``, which are absolute. ``operating`` holds the values of the
    matched rig's shafts at the operating point, ``applied_from_start`` the torques with what only leads in.
    """

    time: np.ndarray
    torques: dict[str, np.ndarray]
    vehicle: dict[str, np.ndarray] = field(repr=False)
    rig: dict[str, np.ndarray] = field(repr=False)
    matched: dict[str, np.ndarray] = field(repr=False)
    operating: dict[str, float] = field(repr=False, default_factory=dict)
    applied_from_start: dict[str, np.ndarray] = field(repr=False, default_factory=dict)

    def absolute(self, name: str) -> np.ndarray:
        """A trace (t,) of the matched rig with its value at the operating point."""
        return self.matched[name] + self.operating.get(name, 0.0)


def simulate_case(parts: LinearBed, torques: Mapping[str, np.ndarray], settle: int = 0) -> Traces:
    """Simulate all three on torques (t,) by input, one value a sample of the loop; inputs left out stay 0.

    Parameters
    ----------
    settle : int
        Samples at the beginning that are left out of the traces.
    """
    step, structure = parts.case.loop["sample_time"], parts.case.loop.structure
    vehicle = watched(parts.case.vehicle, parts.cuts, rig_side=False)
    count = len(next(iter(torques.values())))
    time = (np.arange(count) - settle) * step
    motions = (
        free_motion(vehicle, parts, torques, step),
        free_motion(parts.free.system, parts, torques, step),
        matched_motion(parts, torques),
    )
    motions[1].update(emulated(parts, motions[1], torques, tuned=False))
    motions[2].update(emulated(parts, motions[2], torques, tuned=not structure.has_feed_forward))
    vehicle_traces, free, matched = ({name: trace[settle:] for name, trace in motion.items()} for motion in motions)
    applied = {name: np.asarray(torque)[settle:] for name, torque in torques.items()}
    operating = operating_readings(parts.rig.system)
    return Traces(time[settle:], applied, vehicle_traces, free, matched, operating, dict(torques))


def free_motion(
    system: System, parts: LinearBed, torques: Mapping[str, np.ndarray], step: float
) -> dict[str, np.ndarray]:  # fmt: skip
    """Traces (t,) of a system without control under torques (t,) in N·m, in steps of s."""
    count = len(next(iter(torques.values())))
    loop = replace(parts.case.loop, values={**parts.case.loop.values, "sample_time": step})
    plant = BedRows(NonlinearBeds([system], loop))
    found = run(plant, None, _of_inputs(torques, plant.inputs), samples=count, states=True)
    if found.lost.any() or found.states is None:
        raise grown(count * step)
    beds = plant.beds
    return _traces(system, parts, found.readings[:, :, 0] - beds.steady[:, 0], *beds.twists(found.states[:, :, 0]))


def _of_inputs(torques: Mapping[str, np.ndarray], inputs: Sequence[str]) -> dict[str, np.ndarray]:
    """Those of some torques that act at these inputs."""
    return {name: np.asarray(torque) for name, torque in torques.items() if name in inputs}


def matched_motion(parts: LinearBed, torques: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Traces (t,) of the rig with its loop closed under torques (t,) in N·m: the exported code runs, unlimited.

    The bed is the nonlinear one, also where the rig is linear: nothing of it is what the controller was designed with.
    """
    loop, system = parts.case.loop, parts.rig.system
    law, count = control_law(parts), len(next(iter(torques.values())))
    inverters, flanges, delays = (
        tuple(each.tolist())
        for each in (loop.lags("inverter_lag"), loop.lags("torque_sensor_lag"), loop.command_delays())
    )
    hardware = BedHardware(inverters, flanges, delays, (1.0,) * len(parts.dynamometers))
    plant = BedRows(NonlinearBeds([system], loop, parts.dynamometers, [hardware]), law.sensors)
    beds = plant.beds
    at_flanges = tuple(-1 if one.torque_sensor is None else law.sensors.index(one.torque_sensor)
                       for one in parts.dynamometers)  # fmt: skip
    at_rotors = tuple(law.sensors.index(one.speed_sensor) for one in parts.dynamometers)
    rotors = [beds.model.sensors.index(one.speed_sensor) for one in parts.dynamometers]
    # a sample of speed hold at the operating point, from whose readings and commands the emulation counts
    schedule = Schedule.held_first(1, count + 1, beds.steady[rotors], beds.trim)
    controller = ControllerRows(plain(law, at_flanges, at_rotors), schedule)
    waiting = {name: np.r_[torque[0], torque] for name, torque in torques.items()}
    known = dict(zip(law.known, known_torques(parts, law, waiting).T, strict=True))
    found = run(plant, controller, _of_inputs(waiting, plant.inputs), known, samples=count + 1, states=True)
    if found.lost.any() or found.states is None:
        raise grown(count * loop["sample_time"])
    states, readings = found.states[1:, :, 0], found.readings[1:, :, 0]
    traces = _traces(system, parts, readings - beds.steady[:, 0], *beds.twists(states))
    added, held, turning = beds.air_gap(states), torques_of(system), operating_readings(system)
    for j, dyno in enumerate(parts.dynamometers):
        place, torque = f"dynamometers.{dyno.name}", added[:, j] + held[dyno.torque_input]
        speed = traces[dyno.speed_sensor] + turning[dyno.speed_sensor]
        traces |= {f"{place}.torque": torque, f"{place}.speed": speed, f"{place}.power": torque * speed}
        traces[f"{place}.command"] = found.commands[1:, j, 0]
    return traces


def known_torques(parts: LinearBed, law: ControlLaw, torques: Mapping[str, np.ndarray]) -> np.ndarray:
    """Torques (t, w) in N·m as the controller knows them."""
    loop, count = parts.case.loop, len(next(iter(torques.values())))
    told = {name: torque for name, torque in torques.items() if name not in parts.drives or name in loop.measured}
    return torque_columns(told, law.known, count)


# --- Whether loop and simulation agree: the motion that the loop's own matrices foretell, against the simulated one.
#
# Poles, margins and errors come from matrices that a controller was designed with. A fault in these would be in all of
# them, and in the controller. The simulation steps the equations of motion, with a delay line of its own.

DISAGREEMENT = 5e-3  # rms of the difference over the range of a signal; steps of the simulation leave 1e-5


def foretold_motion(parts: LinearBed, torques: Mapping[str, np.ndarray], sensors: Sequence[str]) -> np.ndarray:
    """Readings and commands (t, y + k) of the bed as planned under control, by the matrices of the loop."""
    loop, law, bed = parts.case.loop, control_law(parts), parts.bed
    count, step = len(next(iter(torques.values()))), loop["sample_time"]
    drives, known = torque_columns(torques, parts.drives, count), known_torques(parts, law, torques)
    unlimited, sampled = np.full(len(parts.dynamometers), np.inf), bed.sampled
    of_torques = discretise(bed.A, bed.torques, step)
    rows, inputs = parts.rig.space.output, parts.rig.space.inputs
    C = np.stack([rows(name) for name in sensors])
    D = np.stack([parts.rig.space.D[parts.rig.space.outputs.index(name)] for name in sensors])
    D = D[:, [inputs.index(name) for name in parts.drives]]
    n, more = len(parts.rig.space.A), len(sampled.whole) - len(bed.A)
    x, state = np.zeros(len(sampled.whole)), np.zeros(len(law.A))
    read_by, push_held, push_ramp = (
        np.pad(bed.readings, ((0, 0), (0, more))),
        *(np.pad(part, ((0, more), (0, 0))) for part in (of_torques.held, of_torques.ramp)),
    )
    issued, read = np.zeros((count, len(parts.dynamometers))), np.empty((count, len(sensors)))
    for k in range(count):
        read[k] = C @ x[:n] + D @ drives[k]
        issued[k], state = law.step(state, read_by[: len(law.sensors)] @ x, known[k], unlimited)
        change = drives[min(k + 1, count - 1)] - drives[k]
        x = sampled.whole @ x + push_held @ drives[k] + push_ramp @ change
        for ago, push in ((sampled.delay, sampled.new), (sampled.delay + 1, sampled.old)):
            if k >= ago:
                x += push @ issued[k - ago]
        if not np.abs(x).max(initial=0.0) < TOO_LARGE:
            raise grown(count * step)
    return np.hstack([read, issued])


def disagreement(parts: LinearBed, traces: Traces) -> float | None:
    """Largest difference of foretold and simulated readings and commands over their range, rms.

    A controller hides a fault from the readings as it hides any other disturbance; its commands show it. None where the
    rig is not linear.
    """
    if not is_linear(parts.case.rig):
        return None
    sensors = compared_sensors(parts.case)
    names = [*sensors, *(f"dynamometers.{dyno.name}.command" for dyno in parts.dynamometers)]
    wanted = np.stack([traces.matched[name] for name in names], axis=1)
    held, by_name = torques_of(parts.rig.system), {part.name: part.measures for part in parts.case.rig.sensors}
    wanted[:, len(sensors) :] -= [held[dyno.torque_input] for dyno in parts.dynamometers]
    torques = traces.applied_from_start
    foretold = foretold_motion(parts, torques, sensors)[len(next(iter(torques.values()))) - len(wanted) :]
    kinds = [*(by_name[name] for name in sensors), *["command"] * len(parts.dynamometers)]
    return float(error_over_range(wanted, foretold, kinds=kinds).largest)


def _traces(
    system: System, parts: LinearBed, values: np.ndarray, twists: np.ndarray, springs: tuple[str, ...]
) -> dict[str, np.ndarray]:
    """Traces by name from readings (t, y) and twists (t, s) of a system."""
    by_name = dict(zip([sensor.name for sensor in system.sensors], values.T, strict=True))
    traces = {name: values for name, values in by_name.items() if not name.startswith("verified_")}
    for shaft in system.shafts:
        traces[f"shafts.{shaft.name}.torque"] = by_name[shaft_torque(shaft.name)]
        if f"shafts.{shaft.name}" in springs:
            traces[f"shafts.{shaft.name}.twist"] = twists[:, springs.index(f"shafts.{shaft.name}")]
    for cut in parts.cuts:
        traces[f"interfaces.{cut.shaft}.speed"] = by_name[interface_speed(cut.shaft)]
    return traces


def operating_readings(system: System) -> dict[str, float]:
    """Readings (SI) of a watched system at its operating point by trace name, shaft twists too; 0 without one."""
    model, about = compiled(system), operating_motion(system)
    values = model.readings(about.state, about.inputs, model.p0, 0.0).full().ravel()
    readings = dict(zip(model.sensors, values.tolist(), strict=True))
    parts = elements(model, model.p0[None])
    twists = dict(zip(parts.springs, (parts.deflection_jacobian @ about.state).tolist(), strict=True))
    for shaft in system.shafts:
        readings[f"shafts.{shaft.name}.torque"] = readings[shaft_torque(shaft.name)]
        readings[f"shafts.{shaft.name}.twist"] = twists.get(f"shafts.{shaft.name}", 0.0)
    return readings


# --- XiL fidelity of a match on its manoeuvre (Eqs. 14 to 23), without control and matched, from the simulated traces.
#
# R_SD compares torque and speed at every cut, as the paper does with M and n of each load dynamometer; R_RVM the
# vehicle's sensors behind the cuts with what the residual vehicle reads (:func:`.loop_modes.emulated`);
# R_MU takes U = 2·u of the torque and speed sensor of every dynamometer over the range that the vehicle shows there.
# The simulated signals carry no noise, so the uncertainty stated is that of U as an offset and of the delays.

COVERAGE_FACTOR = 2.0
LONGEST_DELAY = 0.25  # s: a delay beyond it counts as none of the fidelity, and so does a tenth of it at 30 Hz
DRAWS = 5_000
RATE = 8.0  # samples a period of f_max that are enough; simulated signals carry no noise to average
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


def match_fidelity(parts: LinearBed, traces: Traces) -> MatchFidelity | None:
    """Fidelity of free and matched rig; None where the manoeuvre leaves every cut at rest.

    Parameters
    ----------
    parts : LinearBed
        Of the tuned case.
    traces : Traces
        Of its manoeuvre.
    """
    f_max = parts.case.band[1]
    every = max(int(1 / (RATE * f_max * parts.case.loop["sample_time"])), 1)
    wanted = _signals(parts, traces)
    resting = tuple(
        member.name for members in wanted.values() for member in members if np.ptp(member.reference) <= REST.smallest
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


def _signals(parts: LinearBed, traces: Traces) -> dict[str, list[_Signal]]:
    sensors = {sensor.name: sensor for sensor in parts.case.rig.sensors}
    dynamics = []
    for dyno in parts.dynamometers:
        for name, sensor in (
            (f"shafts.{dyno.follows}.torque", dyno.torque_sensor),
            (f"interfaces.{dyno.follows}.speed", dyno.speed_sensor),
        ):
            known = None if sensor is None else sensors[sensor].uncertainty
            dynamics.append(_Signal(name, traces.vehicle[name], known))
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


# --- Largest torques, twists, speeds and powers over the manoeuvre, held against the limits of the case.


@dataclass(frozen=True)
class Violation:
    """A limit of the case that is broken: its key, where, the value and what is allowed, SI."""

    limit: str
    where: str
    value: float
    allowed: float


class LeastDamped(NamedTuple):
    """A mode by its damping ratio and frequency, Hz, and the damping ratio that it is asked for."""

    damping_ratio: float
    frequency: float
    asked: float


def peaks_of(parts: LinearBed, traces: Traces) -> dict[str, float]:
    """Largest magnitudes of the matched rig's dynamometer and shaft traces, operating point included, by name.

    Of a shaft by its drawing shear stresses as well, see :func:`matching.match.demands.stresses`;
    ``dynamometers.NAME.torque_over_speed`` is the largest share of the torque that the dynamometer has at its speed.
    """
    names = [f"dynamometers.{dyno.name}.{what}" for dyno in parts.dynamometers for what in ("torque", "speed", "power")]
    names += [f"shafts.{shaft.name}.{what}" for shaft in parts.case.rig.shafts for what in ("torque", "twist")]
    peaks = {name: float(np.abs(traces.absolute(name)).max()) for name in names if name in traces.matched}
    for shaft in parts.case.rig.shafts:
        if shaft.drawing is not None and f"shafts.{shaft.name}.torque" in peaks:
            found = stresses(shaft.drawing, traces.absolute(f"shafts.{shaft.name}.torque"))
            peaks |= {f"shafts.{shaft.name}.{what}": stress for what, stress in found.items()}
    curve = parts.case.torque_curve
    if curve is not None:
        for place in (f"dynamometers.{dyno.name}" for dyno in parts.dynamometers):
            used = curve.used(traces.matched[f"{place}.torque"], traces.matched[f"{place}.speed"])
            peaks[f"{place}.torque_over_speed"] = used
    return peaks


def violations_of(
    case: Case, peaks: Mapping[str, float], margin: float, least: LeastDamped | None
) -> tuple[Violation, ...]:
    """Broken limits, furthest off first."""
    violations = []
    for limit, allowed in case.limits.items():
        if limit == "modulus_margin":
            if margin < allowed:
                violations.append(Violation(limit, "feedback loop", margin, allowed))
        elif limit == "damping_ratio":
            if least is not None and least.damping_ratio < least.asked:
                where = f"mode at {least.frequency:.3g} Hz"
                violations.append(Violation(limit, where, least.damping_ratio, least.asked))
        elif limit.startswith("dynamometer_"):
            what = limit.removeprefix("dynamometer_")
            values = {
                name: peak
                for name, peak in peaks.items()
                if name.startswith("dynamometers.") and name.endswith(f".{what}") and name not in case.limits
            }
            violations += [Violation(limit, name, value, allowed) for name, value in values.items() if value > allowed]
        elif peaks.get(limit, 0.0) > allowed:
            violations.append(Violation(limit, limit, peaks[limit], allowed))
    return tuple(sorted(violations, key=_excess, reverse=True))


def _excess(violation: Violation) -> float:
    value, allowed = violation.value, violation.allowed
    return value / allowed if value > allowed else allowed / max(value, 1e-12)


# --- Target modes read off simulated motion, for vehicle and matched rig alike.

PERIODS = 8.0  # that an excitation of its own is watched for
NEIGHBOUR_WITHIN = 0.25  # relative in frequency: a mode so near might be taken for the target's
SAME_EIGENVALUE = 0.05  # |ln s/s₀| between what is read off a simulation and the eigenvalue of the linear model
NEIGHBOUR_DAMPING = 3.0  # times the target's: what is damped more dies away before it could be taken for it


@dataclass(frozen=True)
class IdentifiedMode:
    """A target mode as the simulation shows it; None where it is not found.

    ``excited_by`` is ``manoeuvre`` or the input that an excitation of its own acted on, because the manoeuvre left the
    mode at rest or too little free motion after it.
    """

    vehicle_mode: int
    vehicle: Ringing | None
    matched: Ringing | None
    excited_by: str

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        entry = {"vehicle_mode": self.vehicle_mode, "excited_by": self.excited_by}
        return entry | {
            key: None if reading is None else dict(vars(reading))
            for key, reading in (("vehicle", self.vehicle), ("matched", self.matched))
        }


def manoeuvre_torques(parts: LinearBed) -> tuple[dict[str, np.ndarray], int]:
    """Torques (t,) in N·m of the case's manoeuvre at the samples of the loop, and how many samples only lead in.

    Where torques do not begin at 0 they rise smoothly over 2 s before.
    """
    step, manoeuvres = parts.case.loop["sample_time"], parts.case.manoeuvre
    time = np.arange(round(max(manoeuvre.duration for manoeuvre in manoeuvres.values()) / step) + 1) * step
    torques = {name: manoeuvre.torque(time) for name, manoeuvre in manoeuvres.items()}
    if not any(torque[0] for torque in torques.values()):
        return torques, 0
    rise = np.linspace(0, 1, round(2 / step), endpoint=False)
    rise = rise * rise * (3 - 2 * rise)
    return {name: np.concatenate([torque[0] * rise, torque]) for name, torque in torques.items()}, len(rise)


def identified_modes(parts: LinearBed, traces: Traces) -> tuple[IdentifiedMode, ...]:
    """Read every target mode off the traces of the manoeuvre, or off a kick where they do not show it in the
    vehicle.
    """
    vehicle = body(watched(parts.case.vehicle, parts.cuts, rig_side=False))
    pairs = target_modes(parts.case)
    targets = [plain for plain, _ in pairs]
    swinging = swinging_modes(vehicle)
    chosen = [int(np.argmin(np.abs(swinging.values - eigenvalue_of(damped)))) for _, damped in pairs]
    top = max(parts.case.band[1], *(1.5 * mode.frequency for mode in targets))
    read = _read(parts, vehicle, traces, swinging, chosen, top)
    identified = []
    for mode, index, (of_vehicle, rig) in zip(targets, chosen, read, strict=True):
        by = "manoeuvre"
        if of_vehicle is None and mode.frequency > 0:
            kicked = _kick(parts, vehicle, mode)
            if kicked is not None:
                by, torques = kicked
                traces = simulate_case(parts, torques)
                of_vehicle, rig = _read(parts, vehicle, traces, swinging, [index], top)[0]
        identified.append(IdentifiedMode(mode.number, of_vehicle, rig, by))
    return tuple(identified)


@dataclass(frozen=True)
class SwingingModes:
    """Modes of the damped vehicle that swing: eigenvalues (m,), rad/s, and eigenvectors (x, m)."""

    values: np.ndarray
    vectors: np.ndarray


def swinging_modes(vehicle: Body) -> SwingingModes:
    """None of them overdamped."""
    values, vectors = np.linalg.eig(vehicle.space.A)
    upper = values.imag > 0
    return SwingingModes(values[upper], vectors[:, upper])


def neighbours(swinging: SwingingModes, chosen: list[int]) -> list[int]:
    """Indices of modes that might be taken for one of the chosen: near in frequency, and not damped much more."""
    sizes = np.abs(swinging.values)
    damping = -swinging.values.real / np.maximum(sizes, 1e-300)
    close = set[int]()
    for index in chosen:
        if index is not None:
            near = np.abs(sizes / sizes[index] - 1) < NEIGHBOUR_WITHIN
            close |= set(np.flatnonzero(near & (damping < NEIGHBOUR_DAMPING * damping[index])).tolist())
    return sorted(close - set(chosen))


def _read(
    parts: LinearBed, vehicle: Body, traces: Traces, swinging: SwingingModes, chosen: list[int], top: float
) -> list[tuple[Ringing | None, Ringing | None]]:
    """(vehicle, matched) for every chosen mode, off what follows the last change of a torque."""
    changes = [np.flatnonzero(np.diff(torque)) for torque in traces.torques.values()]
    first = max((int(change[-1]) + 2 for change in changes if len(change)), default=0)
    step = float(traces.time[1] - traces.time[0])
    names = list(dict.fromkeys(pair.sensor for pair in parts.case.compared))
    rows = [vehicle.space.output(name) for name in names]
    rows += [vehicle.space.output(interface_speed(cut.shaft)) for cut in parts.cuts]
    names += [f"interfaces.{cut.shaft}.speed" for cut in parts.cuts]
    amplitudes = np.array(rows) @ swinging.vectors  # (c, m)
    shapes = amplitudes[:, chosen].T
    around = neighbours(swinging, chosen)
    others, known = amplitudes[:, around].T, swinging.values[[*chosen, *around]]
    pair = []
    for trace in (traces.vehicle, traces.matched):
        signals = np.stack([trace[name][first:] for name in names], axis=1)
        nothing: list[Ringing | None] = [None] * len(shapes)
        pair.append(read_modes(signals, step, shapes, top, others, known) if len(signals) >= 40 else nothing)
    read = zip(*pair, known, strict=False)
    return [(vehicle, rig) if is_mode(vehicle, value) else (None, None) for vehicle, rig, value in read]


def is_mode(reading: Ringing | None, eigenvalue: complex) -> bool:
    """Whether what was read off a motion is the mode with that eigenvalue, rad/s."""
    if reading is None:
        return False
    return abs(np.log(eigenvalue_of(reading) / eigenvalue)) <= SAME_EIGENVALUE


def modes_of_targets(
    identified: Iterable[IdentifiedMode], targets: Iterable[LoopMode | None], modes: Sequence[LoopMode]
) -> tuple[IdentifiedMode, ...]:
    """Readings of the matched rig, without those that are another mode of the loop than the one the target became.

    A few sensors move alike in modes that every inertia and cut together tell apart. What is no mode of the loop stays:
    there simulation and loop disagree.

    Parameters
    ----------
    targets : iterable of LoopMode or None
        What each target became, in the order of ``identified``.
    modes : sequence of LoopMode
        Every mode of the loop.
    """
    kept = []
    for reading, target in zip(identified, targets, strict=True):
        others = [mode for mode in modes if mode is not target and mode.frequency > 0]
        of_target = target is not None and is_mode(reading.matched, eigenvalue_of(target))
        if not of_target and any(is_mode(reading.matched, eigenvalue_of(mode)) for mode in others):
            reading = replace(reading, matched=None)
        kept.append(reading)
    return tuple(kept)


def _kick(parts: LinearBed, vehicle: Body, mode: Mode) -> tuple[str, Mapping[str, np.ndarray]] | None:
    """A one-sided pulse, half a period long, on the input that moves the mode most."""
    known = parts.measured or (*parts.drives, *parts.simulated)  # an unmeasured torque shows the feedback's modes
    inputs = [name for name in known if name in vehicle.space.inputs]
    on = {torque.name: f"inertias.{torque.on}" for torque in vehicle.system.inputs}
    push = {name: abs(mode.shape[on[name]]) for name in dict.fromkeys(inputs)}
    if not push or max(push.values()) < 1e-6:
        return None
    best = max(push, key=lambda name: push[name])
    rise = 0.25 / mode.frequency
    kick = Kick(amplitude=500.0, at=0.05, rise_time=rise, duration=0.05 + 2 * rise + PERIODS / mode.frequency)
    time = kick.time(1 / parts.case.loop["sample_time"])
    return best, {best: kick.torque(time)}


# --- What must be known how well: the rig differs from what the controller was tuned for, one quantity at a time.

RELATIVE_CHANGE = 0.05  # of a stiffness or inertia: what is usually known of one that was not identified
DEAD_TIME_CHANGE = 5e-4  # s: half a sample time of 1 ms
DEVIATION_POINTS = 100  # log-spaced frequencies over the band


@dataclass(frozen=True)
class Deviation:
    """What one wrong quantity does.

    Attributes
    ----------
    name : str
        ``rig.…`` (a mirror image is wrong alike) or ``loop.dead_time``.
    change : float
        Relative; in s for the dead time.
    stable : bool
    spectral_abscissa, modulus_margin : float
        Of the feedback loop, the margin counted as for the nominal one.
    response_error : float
        Against the vehicle, which has the wrong value too where it shares the component.
    """

    name: str
    change: float
    stable: bool
    spectral_abscissa: float
    modulus_margin: float
    response_error: float


def response_deviations(
    case: Case, controller: SampledController, required: Requirements, neutral: int
) -> tuple[Deviation, ...]:
    """Every stiffness and inertia of the rig 5 % off either way, the dead time 0.5 ms; worst first."""
    rows: list[tuple[str, float, dict[str, float]]] = []
    done: set[str] = set()
    for name, quantity in case.rig.parameters.items():
        if name in done or name.rsplit(".", 1)[1] not in ("J", "stiffness") or name.count(".") != 2:
            continue
        together = {name, mirror_image(name, case.rig)}
        done |= together
        for change in (RELATIVE_CHANGE, -RELATIVE_CHANGE):
            values = {f"rig.{member}": quantity.value * (1 + change) for member in together}
            rows.append((f"rig.{name}", change, values))
    for change in (DEAD_TIME_CHANGE, -DEAD_TIME_CHANGE):
        late = max(case.loop["dead_time"] + change, 0.0)
        if late != case.loop["dead_time"]:
            rows.append(("loop.dead_time", late - case.loop["dead_time"], {"loop.dead_time": late}))
    beds = bed_set(case, [values for _, _, values in rows], np.geomspace(*case.band, DEVIATION_POINTS))
    poles = closed_poles(beds.sampled, controller)
    largest, stable = np.abs(poles).max(axis=1), stable_loops(poles, neutral)
    acting = frequency_response(controller, beds.frequencies)
    response_errors = np.sqrt(errors(beds, acting, case.loop.measured).mean(axis=1))
    every = loop_frequencies(case)
    counted = every[every >= min(required.margin_from, every[-1])]
    margins = margins_of(bed_set(case, [values for _, _, values in rows], counted), controller)
    deviations = [
        Deviation(
            name, change, bool(kept), float(np.log(size) / controller.sample_time), float(margin), float(error),
        )
        for (name, change, _), kept, size, margin, error in zip(
            rows, stable, largest, margins, response_errors, strict=True
        )
    ]  # fmt: skip
    return tuple(sorted(deviations, key=lambda deviation: (deviation.stable, -deviation.response_error)))


# --- Verify

FRESH = 1_000_003  # added to the seed: beds that the search has not drawn


class OwnMode(NamedTuple):
    """A mode of what runs on known torques alone: its frequency, Hz, and rate of decay, 1/s."""

    frequency: float
    rate: float


@dataclass(frozen=True)
class Verification:
    """A tuned case, checked: by the exact loop, and by simulating the running controller on the nonlinear bed.

    Attributes
    ----------
    stable : bool
        The poles of the sampled loop, those of what runs on known torques alone, and the simulation all say so.
    checks : dict of str to bool
        Each of them.
    spectral_abscissa : float
        1/s, largest real part of all poles of the closed loop. A rigid motion that drag alone slows counts with its
        slow decay.
    required : Requirements
    loop : LoopFigures
        Margin, roll-off and command noise of the bed as planned.
    poles, own_poles : ndarray
        Poles z of the feedback loop, and of the controller's model that runs on known torques alone.
    modes : tuple of LoopMode
        Of the closed loop: first those that known torques alone excite.
    targets : tuple of ReachedTarget
        The mode that each target became: where a model runs on known torques, among its modes.
    least_damping : tuple of (damping ratio, Hz)
        The smallest of all modes.
    slowest_own : OwnMode or None
        The slowest mode of what runs on known torques alone; None where nothing does or nothing swings.
    identified : tuple of IdentifiedMode
        Read off the simulation.
    peaks : dict of str to float
        Largest magnitudes over the manoeuvre, by trace name of the matched rig.
    violations : tuple of Violation
        Limits of the case that are broken.
    errors : ResponseError
    robustness : tuple of Deviation
        Worst first.
    traces : Traces or None
        None where the loop grows out of bounds.
    notes : tuple of str
        What the user should know.
    beds : BedsCheck or None
        Fresh beds; None where none were drawn.
    """

    stable: bool
    checks: dict[str, bool]
    spectral_abscissa: float
    required: Requirements
    loop: LoopFigures
    poles: np.ndarray = field(repr=False)
    own_poles: np.ndarray = field(repr=False)
    modes: tuple[LoopMode, ...] = field(repr=False)
    targets: tuple[ReachedTarget, ...]
    least_damping: tuple[float, float]
    slowest_own: OwnMode | None
    identified: tuple[IdentifiedMode, ...]
    peaks: dict[str, float]
    violations: tuple[Violation, ...]
    errors: ResponseError
    robustness: tuple[Deviation, ...]
    traces: Traces | None = field(repr=False)
    notes: tuple[str, ...]
    beds: BedsCheck | None = field(default=None, repr=False)

    @property
    def modulus_margin(self) -> float:
        """Least singular value of I + L from where it counts on."""
        return self.loop.modulus_margin

    @property
    def margin_from(self) -> float:
        """Hz, from where on the margin counts."""
        return self.required.margin_from

    def to_dict(self) -> dict[str, Any]:
        """Plain values; traces and beds are left out."""
        return {
            "stable": self.stable,
            "checks": dict(self.checks),
            "spectral_abscissa": self.spectral_abscissa,
            "modulus_margin": self.modulus_margin,
            "margin_frequency": self.loop.margin_at,
            "modulus_margin_from": self.margin_from,
            "largest_sampled_pole": float(np.abs(self.poles).max()),
            "largest_feed_forward_pole": max(np.abs(self.own_poles).tolist(), default=None),
            "least_damping": {"damping_ratio": self.least_damping[0], "frequency": self.least_damping[1]},
            "slowest_feed_forward": None if self.slowest_own is None else self.slowest_own._asdict(),
            "targets": [
                {
                    "vehicle_mode": target.vehicle_mode,
                    "mode": None if target.mode is None else target.mode.to_dict(),
                    "mac": target.mac,
                }
                for target in self.targets
            ],
            "identified": [mode.to_dict() for mode in self.identified],
            "peaks": dict(self.peaks),
            "violations": [dict(vars(violation)) for violation in self.violations],
            "robustness": [dict(vars(deviation)) for deviation in self.robustness],
            "notes": list(self.notes),
        }  # fmt: skip


def verify(
    case: Case, untuned: System | None = None, *, deviations: bool = True, beds: int = 0, seed: int = 0
) -> Verification:  # fmt: skip
    """Check a tuned case of any structure.

    Parameters
    ----------
    untuned : System, optional
        The rig before it was tuned, which the figures compare with; the case's own unless given.
    deviations : bool
        Whether to work out :attr:`Verification.robustness`.
    beds, seed : int
        How many fresh beds judge it, and their seed.
    """
    bed = linear_bed(case, untuned=untuned)
    controller, required, neutral = controller_on(bed), requirements(case), neutral_motions(bed)
    loop = ClosedLoop.of(bed, controller)
    poles, own_poles, modes = loop.poles, loop.own_poles, loop.modes()
    figures = loop_figures(planned(case, noise_of_sensors(case, controller.sensors)), controller, required)
    checks = {"sampled loop": is_stable_loop(poles, neutral)}
    if len(own_poles):
        checks["feed-forward poles"] = is_stable_loop(own_poles, neutral)
    notes: list[str] = []
    traces, identified = _simulated(bed, notes)
    checks["simulation"] = traces is not None
    apart = None if traces is None else disagreement(bed, traces)
    if apart is not None:
        checks["loop and simulation agree"] = apart <= DISAGREEMENT
    targets = target_modes_of(case, candidates_of(case, modes))
    swinging = [(mode.damping_ratio, mode.frequency) for mode in modes if mode.frequency > 0]
    least = min(swinging, default=(1.0, 0.0))
    peaks = {} if traces is None else peaks_of(bed, traces)
    every = np.concatenate([poles, own_poles])
    return Verification(
        all(checks.values()), checks, float(np.log(np.abs(every).max()) / controller.sample_time), required, figures,
        poles, own_poles, modes, targets, least, slowest_own(own_poles, neutral, controller.sample_time),
        modes_of_targets(identified, (target.mode for target in targets), modes), peaks,
        violations_of(case, peaks, figures.modulus_margin, least_damped(bed, modes, required)),
        error_figures(case, bed),
        response_deviations(case, controller, required, neutral) if deviations else (), traces,
        (*notes, *remarks_on(case, neutral)),
        check_beds(case, controller, neutral, required, beds, seed + FRESH) if beds else None,
    )  # fmt: skip


def slowest_own(own_poles: np.ndarray, neutral: int, step: float) -> OwnMode | None:
    """The slowest of the poles z of what runs on known torques alone that swings; ``step`` in s."""
    if not len(own_poles):
        return None
    z = without_resting(own_poles[None], neutral)
    decay = decay_rates(z, step)[0]
    number = int(decay.argmin())
    if not np.isfinite(decay[number]):
        return None
    return OwnMode(float(abs(rates(z, step)[0, number])) / (2 * np.pi), float(decay[number]))


def least_damped(bed: LinearBed, modes: Sequence[LoopMode], required: Requirements) -> LeastDamped | None:
    """The mode of the feedback loop that has least of what ``limits.damping_ratio`` asks of it.

    That of a mode of the vehicle, or of the bed's own, is no more than :mod:`matching.match.damping` says.
    """
    swinging = [mode for mode in modes if mode.belongs_to == "feedback" and mode.frequency > 0]
    if not swinging:
        return None
    step, limit = bed.case.loop["sample_time"], replace(required, damping_ratio=bed.case.limits["damping_ratio"])
    z = np.exp(np.array([[mode.eigenvalue for mode in swinging]]) * step)
    asked = side_by_side([bed.bed]).asked_damping(z, step, limit)[0]
    ratios = np.array([mode.damping_ratio for mode in swinging])
    worst = int((ratios / asked).argmin())
    return LeastDamped(float(ratios[worst]), swinging[worst].frequency, float(asked[worst]))


def _simulated(bed: LinearBed, notes: list[str]) -> tuple[Traces | None, tuple[IdentifiedMode, ...]]:
    """The manoeuvre and the modes identified from it; no traces, and why in the notes, where the loop runs away."""
    try:
        traces = simulate_case(bed, *manoeuvre_torques(bed))
        return traces, identified_modes(bed, traces)
    except SimulationError as fault:
        notes.append(f"simulation: {fault.wrong}")
        return None, tuple(IdentifiedMode(target.mode, None, None, "nothing") for target in bed.case.targets)


def remarks_on(case: Case, neutral: int) -> list[str]:
    """What of case and simulation differs, in sentences; ``neutral`` rigid motions coast."""
    remarks = []
    if not is_linear(case.vehicle) or not all(is_linear(part) for part in case.residual_vehicle.parts):
        remarks.append("the controller's residual vehicle is linear; the simulated vehicle has all its effects")
    if case.loop["dead_time"] < case.loop["sample_time"] / 2:
        remarks.append("the hold of a sample alone takes longer than the dead time: simulated with the hold")
    if neutral:
        rigid = "1 rigid motion stands" if neutral == 1 else f"{neutral} rigid motions stand"
        remarks.append(f"{rigid} at 0 without drag and coast, as in the vehicle")
    return remarks
