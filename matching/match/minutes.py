"""The exported controller with its supervision for a minute at rest and a minute at speed, on beds that are not exact.

It may not leave emulation by itself, and a vehicle that stands has to stand: the stated noise of the sensors, zeros of
the flanges that drift, a gain error of each encoder and the tolerances of the bed are what is there every day.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from matching.match.beds import noise_of_sensors
from matching.match.case import Case
from matching.match.coupled import controller_rows
from matching.match.exported import exported_controller
from matching.match.findings import Finding
from matching.match.imperfections import (
    Imperfection,
    are_speeds,
    bed_rows,
    count_angles,
    known_at_operating_point,
    sensor_gains,
    vehicle_rows,
    white_noise,
    with_cut_sensors,
)
from matching.match.judgements import Judgement
from modelling.controller.law import EMULATION, FAULTS, SPEED_HOLD, ExportedController
from modelling.running.controllers import Schedule
from modelling.running.run import Motion, run
from modelling.running.sensors import NEVER, SensorErrors
from modelling.simulation.stepping import SimulationError
from modelling.system import Input
from modelling.topology import joints, speed_ratios


@dataclass(frozen=True)
class MinuteSettings:
    """What the minutes are like.

    Attributes
    ----------
    seconds : float
        Of emulation, at rest and at speed: an idle phase of a test run.
    settle : float
        s of speed hold before; the first half of it brings the rotors to their speed.
    drawn : int
        Beds drawn from the case's box, in addition to the bed as planned.
    offset : float
        Uncertainties of a sensor by which it drifts over the time at speed: a warm flange, one way or the other. An
        encoder that states its counts does not drift.
    encoder_gain : float
        Relative error of every encoder: an eccentric disc, averaged over a turn, leaves less.
    speed : float
        rad/s of the rotors in the run at speed, where no operating point states it and no limit is lower.
    speed_share : float
        Of the speed limit that the run at speed takes at most.
    pulse : float
        s, of the manoeuvre's largest torque and then of its opposite: at speed right after emulation has begun, at rest
        at the end, when it has been judged whether the bed stands.
    pulse_share : float
        Of that torque: it moves the bed and leaves its speed within all limits.
    zero : float
        Uncertainties of a flange torque by which its zero moves at rest, within ``zero_s`` from the begin of emulation
        on: alike at all dynamometers, against each other, and drawn.
    zero_s : float
        s: a flange's zero moves as its load goes, in some seconds.
    motion : float
        rad/s at a cut by which a bed may move at rest, in addition to what the vehicle itself would do under torques at
        its cuts that are off by the flanges' uncertainty: walking pace of a wheel is 4 rad/s.
    halvings : int
        Of the uncertainty that causes a motion, until the same bed stands.
    """

    seconds: float = 60.0
    settle: float = 3.0
    drawn: int = 1
    offset: float = 1.0
    encoder_gain: float = 1e-3
    speed: float = 50.0
    speed_share: float = 0.3
    pulse: float = 0.5
    pulse_share: float = 0.3
    zero: float = 1.0
    zero_s: float = 10.0
    motion: float = 1.0
    halvings: int = 5


@dataclass(frozen=True)
class Minute:
    """One run.

    Attributes
    ----------
    where : str
        ``at rest`` or ``at speed``, and on which bed.
    emulated : float
        s that the controller stayed in emulation.
    fault : str
        What ended it, in the words of :data:`modelling.controller.law.FAULTS`; empty where nothing did.
    drift : float
        rad/s: largest change of a rotor's speed over the run.
    motion, allowed : float or None
        rad/s: largest change of a speed at a cut at rest, and what is allowed there; None at speed.
    """

    where: str
    emulated: float
    fault: str
    drift: float
    motion: float | None = None
    allowed: float | None = None

    @property
    def stands(self) -> bool:
        """Whether a bed at rest stays there as the vehicle does."""
        return self.motion is None or self.allowed is None or self.motion <= self.allowed

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return dict(vars(self))


@dataclass(frozen=True)
class Minutes:
    """All runs of an exported controller; ``not_run`` is why there are none.

    ``cause`` is the sensors' uncertainty that moves a bed at rest most, ``cause_is`` what these sensors measure, and
    ``remedy`` a value (SI) of it with which the same controller on the worst of these beds stands; ``interpreted`` is
    whether
    there was no C compiler, ``step`` the controller's sample time, s.
    """

    seconds: float = 0.0
    runs: tuple[Minute, ...] = ()
    not_run: str = ""
    cause: str = ""
    cause_is: str = ""
    remedy: float | None = None
    interpreted: bool = False
    step: float = 1e-3

    @property
    def left(self) -> list[Minute]:
        """The runs that left emulation."""
        return [run for run in self.runs if run.fault]

    @property
    def moved(self) -> list[Minute]:
        """The runs at rest in which the bed did not stand."""
        return [run for run in self.runs if not run.stands]

    @property
    def judgements(self) -> list[Judgement]:
        """What is not kept."""
        found = []
        if self.left:
            first = min(self.left, key=lambda run: run.emulated)
            found.append(
                Judgement(
                    "emulation", first.emulated, self.seconds, "s", f"{first.where}: {first.fault}", len(self.left),
                    len(self.runs),
                )
            )  # fmt: skip
        if self.moved:
            worst = max(self.moved, key=_beyond)
            remedy = () if self.remedy is None else (self.cause, self.remedy)
            found.append(
                Judgement(
                    "standing", worst.motion or 0.0, worst.allowed or 0.0, "rad/s", worst.where, len(self.moved),
                    sum(run.motion is not None for run in self.runs), self.cause, remedy,
                )
            )  # fmt: skip
        return found

    @property
    def findings(self) -> list[Finding]:
        """What of it stands in the way of a match."""
        found = []
        for one in self.judgements:
            remedy = one.remedy[1] if one.remedy else None
            data = {"seconds": self.seconds, "cause_is": self.cause_is, "remedy": remedy, "step": self.step}
            causes = {"emulation": "emulation_left", "standing": "standstill"}
            found.append(
                Finding(causes[one.what], one.size, one.allowed, one.unit, one.where, (one.beds, one.of), data=data)
            )
        return found

    def notes(self) -> list[str]:
        """What else is to be said."""
        return ["no C compiler was found: everything in time was interpreted, which takes longer"] * self.interpreted

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return {
            "seconds": self.seconds, "runs": [run.to_dict() for run in self.runs], "not_run": self.not_run,
            "judgements": [one.to_dict() for one in self.judgements],
        }  # fmt: skip


def _beyond(run: Minute) -> float:
    return (run.motion or 0.0) - (run.allowed or 0.0)


def minutes(
    case: Case, controller: ExportedController, seed: int = 0, settings: MinuteSettings | None = None
) -> Minutes:  # fmt: skip
    """Run an exported controller of a tuned case at rest and at speed; where it cannot be run the result says why."""
    settings = settings or MinuteSettings()
    if case.loop.torqueless:
        return Minutes(not_run="the dynamometers give no torque")
    try:
        return _run(case, controller, seed, settings)
    except SimulationError as fault:
        return Minutes(not_run=str(fault))


def minutes_of(case: Case, seconds: float, seed: int = 0, settings: MinuteSettings | None = None) -> Minutes:
    """Export the controller of a tuned case and run it for so many seconds."""
    if case.loop.torqueless:
        return minutes_without("the dynamometers give no torque")
    return minutes(case, exported_controller(case), seed, replace(settings or MinuteSettings(), seconds=seconds))


def minutes_without(reason: str) -> Minutes:
    """No runs, and why."""
    return Minutes(not_run=reason)


# --- Rows: bed, whether at speed, and by how many uncertainties each flange's zero moves.

ALIKE, AGAINST, DRAWN = "alike", "against each other", "drawn"


@dataclass(frozen=True)
class _Row:
    where: str
    bed: Imperfection
    at_speed: bool
    zeros: np.ndarray  # (k,), in uncertainties of each flange


def _rows(case: Case, seed: int, settings: MinuteSettings) -> list[_Row]:
    """Beds at rest with the ways in which zeros may move, and beds at speed; with an operating point the latter."""
    k, random = len(case.loop.dynamometers), np.random.default_rng(seed)
    beds = [("the bed as planned", Imperfection(""))]
    beds += [
        (f"drawn bed {number}", Imperfection("", case.uncertainty.at(position)))
        for number, position in enumerate(case.uncertainty.draw(settings.drawn, seed), 1)
    ]
    rows = []
    if case.rig.operating_point is None:
        alike, against = np.ones(k), np.where(np.arange(k) % 2 == 0, 1.0, -1.0)
        for number, (name, bed) in enumerate(beds):
            ways = [alike, against] if number == 0 and k > 1 else [random.choice([-1.0, 1.0], k)]
            rows += [_Row(f"at rest on {name}", bed, False, settings.zero * way) for way in ways]
    return rows + [_Row(f"at speed on {name}", bed, True, np.zeros(k)) for name, bed in beds]


def _errors(
    case: Case, sensors: Sequence[str], rows: Sequence[_Row], begun: int, samples: int, seed: int,
    settings: MinuteSettings, step: float, uncertainty: np.ndarray,
) -> SensorErrors:  # fmt: skip
    """Noise of all sensors; at speed drifts and encoders' gains; at rest the zeros of the flanges."""
    random, speeds = np.random.default_rng(seed), are_speeds(case, sensors)
    shape, at_speed = (len(rows), len(sensors)), np.array([row.at_speed for row in rows])
    signs = random.choice([-1.0, 1.0], (2, *shape))
    gains = sensor_gains(sensors, [row.bed for row in rows])
    gains = gains * np.where(speeds & at_speed[:, None], 1 + settings.encoder_gain * signs[0], 1.0)
    share = uncertainty / noise_of_sensors(case, sensors)  # less than 1 where less is tried
    # what an encoder reads for want of finer counts is no drift: it counts whole turns exactly
    drift = np.where(at_speed[:, None], settings.offset * share * white_noise(case, sensors) * signs[1], 0.0)
    for j, dynamometer in enumerate(case.loop.dynamometers):
        if dynamometer.torque_sensor is not None:
            at = sensors.index(dynamometer.torque_sensor)
            for number, row in enumerate(rows):
                drift[number, at] += row.zeros[j] * uncertainty[at]
    noise = np.broadcast_to(share * white_noise(case, sensors), shape)
    count = np.broadcast_to(np.minimum(share, 1.0) * count_angles(case, sensors), shape)
    slow = round(settings.zero_s / step) if not at_speed.any() else samples
    return SensorErrors(
        tuple(sensors), gains, np.zeros(shape), drift, noise.copy(), count.copy(),
        np.full((2, *shape), NEVER, dtype=np.int64), begun, slow, seed,
    )  # fmt: skip


@dataclass(frozen=True)
class _Played:
    """What rows did: speeds at the cuts and of the rotors (t, k, b) from the begin of emulation on, until the pulse."""

    motion: Motion
    at_cuts: np.ndarray
    rotors: np.ndarray
    faults: list[str]
    emulated: np.ndarray


WATCHED_S = 0.01  # of speeds, between two that are looked at


def _played(
    case: Case, controller: ExportedController, rows: Sequence[_Row], seed: int, settings: MinuteSettings,
    uncertainty: np.ndarray | None = None,
) -> _Played:  # fmt: skip
    """Rows that are all at rest, or all at speed, under a controller with its supervision."""
    law, loop, size, k = controller.law, case.loop, len(rows), len(case.loop.dynamometers)
    step, sensors = law.sample_time, list(law.sensors)
    begun = max(round(settings.settle / step), 1)
    samples = begun + round(settings.seconds / step)
    made, _, at_cuts = with_cut_sensors(case)
    u = noise_of_sensors(case, sensors) if uncertainty is None else uncertainty
    errors = _errors(case, sensors, rows, begun, samples - begun, seed, settings, step, u)
    plant = bed_rows(made, sensors, [row.bed for row in rows], errors)
    read = [plant.beds.model.sensors.index(one.speed_sensor) for one in loop.dynamometers]
    about = plant.beds.steady[read]
    at_speed = rows[0].at_speed
    above = _hold_speeds(case, settings) * at_speed
    ramp = np.minimum(2.0 * np.arange(samples) / begun, 1.0)[:, None, None]
    mode = np.where(np.arange(samples) < begun, SPEED_HOLD, EMULATION).astype(np.int32)
    hold, added = about + ramp * above, (mode == SPEED_HOLD)[:, None, None] * plant.beds.trim
    schedule = Schedule(mode, hold, added, np.zeros(samples, np.int32))
    length = round(settings.pulse / step)
    start = begun + length if at_speed else max(samples - 6 * length, begun)
    torques = _pulse(case, plant.inputs, start, length, samples, settings)
    trim = known_at_operating_point(case)
    known = {name: torques.get(name, np.zeros(samples)) * (name in loop.measured) + trim.get(name, 0.0)
             for name in law.known}  # fmt: skip
    keep = [*at_cuts, *(one.speed_sensor for one in loop.dynamometers)]
    every = max(round(WATCHED_S / step), 1)
    rows_of = controller_rows(case, controller, schedule, size)
    found = run(plant, rows_of, torques, known, samples=samples, keep=keep, every=every)
    first, until = -(-begun // every), -(-(samples if at_speed else start) // every)
    faults, emulated = [], np.full(size, settings.seconds)
    for b in range(size):
        gone, at = bool(found.lost[b]), int(found.fault_at[b])
        faults.append(FAULTS[int(found.fault[b])] if at >= 0 else "the bed grows out of bounds" if gone else "")
        if at >= 0:
            emulated[b] = (at - begun) * step
        elif gone:
            emulated[b] = max(int(np.isfinite(found.readings[:, 0, b]).sum()) * every - begun, 0) * step
    after = found.readings[first : max(until, first + 1)]
    for b in range(size):  # what a controller that gave up does is no motion of the emulation
        ends = first + round(emulated[b] / step / every)
        after[max(ends - first, 1) :, :, b] = np.nan
    return _Played(found, after[:, :k] - after[:1, :k], after[:, k:] - after[:1, k:], faults, emulated)


def _largest(changes: np.ndarray) -> np.ndarray:
    """Largest magnitude (k, b) of changes (t, k, b), those that are no numbers aside."""
    return np.abs(np.nan_to_num(changes, nan=0.0)).max(axis=0, initial=0.0)


def _run(case: Case, controller: ExportedController, seed: int, settings: MinuteSettings) -> Minutes:
    runs: list[Minute] = []
    rows = _rows(case, seed, settings)
    resting, turning = ([row for row in rows if row.at_speed == fast] for fast in (False, True))
    cause, cause_is, remedy, interpreted = "", "", None, False
    for some in (resting, turning):
        if not some:
            continue
        found = _played(case, controller, some, seed, settings)
        interpreted |= found.motion.interpreted
        drift, moved = _largest(found.rotors).max(axis=0), _largest(found.at_cuts)
        allowed = None if some[0].at_speed else _allowed(case, some, settings)
        for b, row in enumerate(some):
            if allowed is None:
                runs.append(Minute(row.where, float(found.emulated[b]), found.faults[b], float(drift[b])))
                continue
            at = int((moved[:, b] - allowed[:, b]).argmax())
            runs.append(
                Minute(
                    row.where, float(found.emulated[b]), found.faults[b], float(drift[b]), float(moved[at, b]),
                    float(allowed[at, b]),
                )
            )  # fmt: skip
        if allowed is not None and (moved > allowed).any():
            worst = int((moved - allowed).max(axis=0).argmax())
            cause, cause_is, remedy = _cause(case, controller, some[worst], allowed[:, [worst]], seed, settings)
    step = controller.law.sample_time
    return Minutes(settings.seconds, tuple(runs), "", cause, cause_is, remedy, interpreted, step)


def _allowed(case: Case, rows: Sequence[_Row], settings: MinuteSettings) -> np.ndarray:
    """rad/s at each cut (k, b) that a bed may move: as the vehicle under flange torques off by their uncertainty."""
    loop, cuts = case.loop, case.residual_vehicle.interfaces
    made, _, at_cuts = with_cut_sensors(case)
    pushes = [Input(f"push_{cut.shaft}", cut.vehicle_end) for cut in cuts]
    by_shaft = {one.follows: j for j, one in enumerate(loop.dynamometers)}
    if case.vehicle_in_the_loop is None:
        vehicle = replace(made.vehicle, inputs=(*made.vehicle.inputs, *pushes))
        made = replace(made, vehicle=vehicle)
    in_order = sorted(zip(cuts, pushes, strict=True), key=lambda pair: by_shaft[pair[0].shaft])
    plant = vehicle_rows(made, [row.bed for row in rows], [push.name for _, push in in_order])
    step = loop["sample_time"]
    samples = round(settings.seconds / step)
    u, ratios = _flange_uncertainty(case), _rotor_over_cut(case)
    rise = np.minimum(np.arange(samples) * step / max(settings.zero_s, step), 1.0)[:, None]
    torques = {}
    for cut, push in zip(cuts, pushes, strict=True):
        j = by_shaft[cut.shaft]
        torques[push.name] = rise * np.array([abs(ratios[j]) * u[j] * row.zeros[j] for row in rows])
    every = max(round(WATCHED_S / step), 1)
    found = run(plant, None, torques, samples=samples, keep=at_cuts, every=every)
    if found.lost.any():
        raise SimulationError("simulation", "the motion of the vehicle grows out of bounds", "check its parameters")
    allowed: np.ndarray = np.abs(found.readings).max(axis=0) + settings.motion
    return allowed


def _flange_uncertainty(case: Case) -> np.ndarray:
    """N·m (k,) of every dynamometer's flange torque; 0 without one, which has no zero."""
    names = [one.torque_sensor for one in case.loop.dynamometers]
    return np.array([0.0 if name is None else noise_of_sensors(case, [name])[0] for name in names])


def _rotor_over_cut(case: Case) -> np.ndarray:
    """Speed of every rotor over that of its cut (k,), which is torque at the cut over torque at the rotor; 1 where no
    fixed ratio connects them."""
    ends = {cut.shaft: cut.rig_end for cut in case.residual_vehicle.interfaces}
    on, fixed = {part.name: part.on for part in case.rig.inputs}, joints(case.rig)
    made = []
    for one in case.loop.dynamometers:
        ratios = speed_ratios(ends[one.follows], fixed)
        made.append(ratios.get(on[one.torque_input], 1.0))
    return np.array(made)


def _cause(
    case: Case, controller: ExportedController, row: _Row, allowed: np.ndarray, seed: int, settings: MinuteSettings
) -> tuple[str, str, float | None]:  # fmt: skip
    """The uncertainty that moves a bed at rest most, as a key, what it is of, and a value with which the bed stands."""
    sensors, loop = list(controller.law.sensors), case.loop
    u = noise_of_sensors(case, sensors)
    groups = {
        "speed_sensor": [sensors.index(one.speed_sensor) for one in loop.dynamometers],
        "torque_sensor": [sensors.index(one.torque_sensor) for one in loop.dynamometers if one.torque_sensor],
    }

    def moves(factors: np.ndarray) -> float:
        found = _played(case, controller, [row], seed, settings, u * factors)
        return float((_largest(found.at_cuts) / allowed).max())

    alone = {}
    for key, at in groups.items():
        only = np.zeros(len(sensors))
        only[at] = 1.0
        alone[key] = moves(only) if at else 0.0
    key = max(alone, key=lambda name: alone[name])
    at, factors = groups[key], np.ones(len(sensors))
    name = f"sensors.{sensors[at[0]]}.uncertainty"
    for _ in range(settings.halvings):
        factors[at] /= 2
        if moves(factors) <= 1:
            return name, key.removesuffix("_sensor"), float(u[at[0]] * factors[at[0]])
    return name, key.removesuffix("_sensor"), None


def _hold_speeds(case: Case, settings: MinuteSettings) -> float:
    """rad/s above the operating point in the run at speed."""
    if case.rig.operating_point is not None:
        return 0.0
    limit = case.limits.get("dynamometer_speed", np.inf)
    return min(settings.speed, settings.speed_share * limit)


def _pulse(
    case: Case, drives: Sequence[str], start: int, length: int, samples: int, settings: MinuteSettings
) -> dict[str, np.ndarray]:  # fmt: skip
    """A pulse (t,) of the manoeuvre's largest torque, and its opposite, where the manoeuvre drives hardest."""
    driven = {name: one.torque(one.time()) for name, one in case.manoeuvre.items() if name in drives}
    if not driven:
        return {}
    name = max(driven, key=lambda one: float(np.abs(case.torque_made(one, driven[one])).max()))
    size, made = settings.pulse_share * float(np.abs(driven[name]).max()), np.zeros(samples)
    made[start : start + length] = size
    made[start + length : start + 2 * length] = -size
    return {name: made}
