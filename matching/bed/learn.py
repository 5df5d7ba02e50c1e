"""Learning over repetitions on the bed: recordings of one manoeuvre give the torques that are added the next time."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from matching.bed.simulated_bed import bed_of, emulated_recording
from matching.bed.vehicle_beside import vehicle_beside
from matching.bed.verify import BedRecordings, read_recordings
from matching.dry_run import computing
from matching.match.case import Case
from matching.match.coupled import run_in_of
from matching.match.driving import vehicles_in
from matching.match.exported import exported_controller
from matching.match.imperfections import Imperfection, known_at_operating_point
from matching.match.learning import LEARNING, CutReadings, Learner, added_to, cut_readings
from matching.match.operating_range import at_speed, body_speed
from modelling.bed.bed import Dynamometer
from modelling.bed.stepped import SteppedLaw, stepped_vehicle
from modelling.controller.law import NO_LIMIT, ExportedController
from modelling.display import Displayed
from modelling.errors import InputError
from modelling.fmu.export import controller_fmu
from modelling.linear.steady_motion import speeds_of, torques_of
from modelling.recordings.read import Channel, csv_text, read_signals
from modelling.writing import strict_json, write_all

TABLE, RESULT, CONTROLLER = "learned.csv", "learned.json", "controller.fmu"


@dataclass(frozen=True)
class Learned(Displayed):
    """What repetitions of a manoeuvre say, and the torques of the next one; n samples, k dynamometers, c sensors.

    The error is that at the cut: the speed there less what the residual vehicle answers to the torque that was
    measured, over the range of that answer. What the specimen does is in that torque: nothing of it is learned away.
    Where a dynamometer has no torque flange, it is that of the compared sensors against the vehicle of the file.

    Attributes
    ----------
    repetition : int
        How often torques were corrected, this time included.
    recordings : int
        That were learned from.
    left_out : tuple of str
        Those that are no repetition, and why.
    time : ndarray (n,)
        s from the trigger on.
    dynamometers, sensors, units : tuple of str
        Units are those of the sensors, SI.
    torques : ndarray (n, k)
        N·m, to be added in the next repetition.
    error, noise : float
        Of the mean of the recordings, and what of it does not repeat.
    predicted : float
        The error that the bed as planned will have.
    unexplained : float or None
        What the error differs by from what was predicted the last time, beyond the noise: what is nonlinear, or what
        the bed is other than planned. None the first time.
    share : float
        Of the norm-optimal correction: as much as improves every drawn bed.
    history : tuple of float
        Errors of the repetitions before, the first one first.
    controller : ExportedController
        With the torques, played from its trigger on.
    traces : (ndarray (n, c), ndarray (n, c))
        Mean error, and the predicted one.
    """

    repetition: int
    recordings: int
    time: np.ndarray = field(repr=False)
    dynamometers: tuple[str, ...]
    sensors: tuple[str, ...]
    units: tuple[str, ...]
    torques: np.ndarray = field(repr=False)
    error: float
    noise: float
    predicted: float
    unexplained: float | None
    share: float
    history: tuple[float, ...]
    controller: ExportedController = field(repr=False)
    traces: tuple[np.ndarray, np.ndarray] = field(repr=False)
    left_out: tuple[str, ...] = ()

    @property
    def worth(self) -> bool:
        """Whether another repetition gains more than the noise hides, and more than a little."""
        gains = LEARNING.gains
        falls = self.error - self.predicted > gains * self.error
        fell = not self.history or self.history[-1] - self.error > gains * self.history[-1]
        beyond = self.error**2 - self.predicted**2 > (LEARNING.beyond_noise * self.noise) ** 2
        return self.share > 0 and falls and fell and beyond

    def sentence(self) -> str:
        """The error, what of it repeats, and whether another repetition is worth it."""
        off = 100 * self.error
        of_noise = f"{100 * self.noise:.2g} % of it does not repeat" if self.noise > 0.01 * self.error else "it repeats"
        said = f"repetition {self.repetition}: the error is {off:.2g} % of the range, {of_noise}"
        if self.unexplained is not None and self.unexplained > 0.01 * self.error:
            said += f", {100 * self.unexplained:.2g} % is not as predicted"
        if self.left_out:
            said = f"left out: {'; '.join(self.left_out)}. {said[0].upper()}{said[1:]}"
        if self.share == 0:
            return f"{said}; no torque improves every bed that may stand there, nothing is learned"
        if not self.worth:
            return f"{said}; another repetition is not worth it"
        return f"{said}; with the torques learned {100 * self.predicted:.2g} % is expected"

    def to_dict(self) -> dict[str, Any]:
        """As ``learned.json`` holds it."""
        return {
            "repetition": self.repetition, "recordings": self.recordings, "left_out": list(self.left_out),
            "error": self.error, "noise": self.noise,
            "predicted": self.predicted, "unexplained": self.unexplained, "share": self.share, "worth": self.worth,
            "sentence": self.sentence(), "history": list(self.history), "sensors": list(self.sensors),
            "dynamometers": list(self.dynamometers), "largest_torque": float(np.abs(self.torques).max(initial=0.0)),
            "step": float(self.time[1]),
            "predicted_error": self.traces[1].tolist(),
        }  # fmt: skip

    def table(self) -> str:
        """The torques as a CSV file."""
        names = [added_to(name) for name in self.dynamometers]
        columns = dict(zip(names, self.torques.T, strict=True))
        return csv_text(self.time, columns, dict.fromkeys(names, "N*m"))

    def fmu(self) -> bytes:
        """The controller with the table, as an FMU for co-simulation."""
        return controller_fmu(self.controller).content


@dataclass(frozen=True)
class Played:
    """Torques (n, k) that the recordings were made with, the error (n, c) that was predicted, and errors before."""

    torques: np.ndarray
    predicted: np.ndarray
    history: tuple[float, ...]


def read_played(directory: Path, dynamometers: Sequence[Dynamometer]) -> Played:
    """What a repetition before wrote.

    Raises
    ------
    InputError
        If the directory lacks it, or it belongs to other dynamometers.
    """
    file = directory / RESULT
    if not file.is_file():
        raise InputError(str(file), "does not exist", "name the directory that the last `rigmatch learn` wrote")
    content = json.loads(file.read_text(encoding="utf-8"))
    names = [added_to(one.name) for one in dynamometers]
    table = read_signals(directory / TABLE, names)
    if missing := [name for name in names if name not in table.channels]:
        raise InputError(str(directory / TABLE), f"has no column {missing[0]!r}", "it belongs to another case")
    torques = np.stack([table[name] for name in names], axis=1)
    return Played(torques, np.array(content["predicted_error"]), (*content["history"], content["error"]))


def case_of_manoeuvre(case: Case, vehicle_speed: float | None) -> tuple[Case, float]:
    """The case at the operating point where the manoeuvre begins, and the vehicle's speed there, rad/s of its bodies.

    Raises
    ------
    InputError
        If a case without a range is asked for another speed than its own.
    """
    about = case.operating_range
    if about is None:
        if vehicle_speed is not None:
            right = "leave it out: the case has one operating point"
            raise InputError("vehicle_speed", "is for a case with [operating_range]", right)
        return case, 0.0
    if vehicle_speed is None:
        return replace(case, operating_range=None), body_speed(case)
    return at_speed(case, vehicle_speed), vehicle_speed / about.rolling_radius


def learn(
    case: Case, recordings: Sequence[Path], channels: Mapping[str, Channel] | None = None,
    played: Path | None = None, vehicle_speed: float | None = None,
) -> Learned:  # fmt: skip
    """The next torques from recordings of one manoeuvre, all made with the same torques added.

    Parameters
    ----------
    case : Case
        Tuned.
    recordings : sequence of Path
        Each begins at the trigger of the manoeuvre, with the torques that were demanded and the compared sensors.
    played : Path, optional
        Directory of the repetition before, whose torques were added; none were without.
    vehicle_speed : float, optional
        m/s at which the manoeuvre begins, of a case with a range of speeds.

    Raises
    ------
    InputError
        If the recordings do not fit the case, each other or what was played.
    """
    if not case.loop.structure.is_observer:
        raise InputError(
            "loop.structure", f"{case.loop.structure.name!r} does not know of torques that are added",
            'match the case with structure = "observer"',
        )  # fmt: skip
    own, speed = case_of_manoeuvre(case, vehicle_speed)
    recorded = read_recordings(recordings, own, channels, any_length=True)
    before = read_played(played, own.loop.dynamometers) if played is not None else None
    computing(lambda: dict.fromkeys(map(str, recordings), "a recording of a manoeuvre on the controlled bed"))
    exported = exported_controller(case)
    law = exported.law.frozen(speed) if isinstance(exported.law, SteppedLaw) else exported.law
    step, ends = law.sample_time, cut_readings(own)
    for one in recorded.recordings if ends is not None else ():
        for name in _needed(ends or {}):
            if name not in one.channels:
                raise InputError(one.source, f"has no {name!r}", "record flange torques and rotor speeds")
    sensors = recorded.sensors if ends is None else _needed(ends)
    speeds = {sensor.name for sensor in own.rig.sensors if sensor.measures == "speed"}
    kept, left_out = _repetitions(recorded, sensors, speeds, step)
    torques, readings = np.stack([one[0] for one in kept]), np.stack([one[1] for one in kept])
    driven = dict(zip(recorded.inputs, torques.mean(axis=0).T, strict=True))
    if ends is None:
        vehicle = vehicles_in(own, driven, [Imperfection("")], sensors)[None, :, :, 0]
        found, names = readings, sensors
    else:
        found, into = _at_cuts(readings, sensors, ends, step)
        vehicle = _residual_speeds(own, into, driven, step)
        names = tuple(one.speed_sensor for one in ends.values())
    ranges = np.ptp(vehicle.mean(axis=0), axis=0)
    if not (ranges > 0).all():
        still = names[int(np.argmin(ranges))]
        right = "record the manoeuvre from its trigger on"
        raise InputError(Path(recordings[0]).name, f"moves nothing that {still} reads", right)
    errors = found - vehicle
    if ends is not None:
        errors = _without_zeros(errors, own, into[0], driven, step)
    over = [float((np.sqrt(np.mean(each**2, axis=0)) / ranges).max()) for each in errors]
    ended = [number for number, size in enumerate(over) if size > LEARNING.ended]
    if len(ended) == len(errors):
        right = "repeat the manoeuvre with emulation on until its end"
        raise InputError(recorded.recordings[0].source, f"is off by {100 * min(over):.3g} % of the range", right)
    sources = [one[2] for one in kept]
    left_out += [
        f"{sources[number]}: off by {100 * over[number]:.3g} % of the range, emulation has ended" for number in ended
    ]
    errors = np.delete(errors, ended, axis=0)
    count = errors.shape[1]
    added = np.zeros((count, len(law.dynamometers)))
    if before is not None:
        shared = min(count, len(before.torques))
        added[:shared] = before.torques[:shared]
    if ends is None:
        compared = tuple(pair for pair in own.compared if pair.sensor in sensors)
        learner = Learner.of(replace(own, compared=compared), law, count)
    else:
        learner = Learner.at_cuts(own, law, count, ends)
    correction = learner.correction(errors, ranges, added, np.minimum(own.limits_of("torque"), NO_LIMIT))
    mean = errors.mean(axis=0)
    unexplained = None
    if before is not None and before.predicted.shape[1:] == mean.shape[1:]:
        shared = min(count, len(before.predicted))
        off = learner.size(mean[:shared] - before.predicted[:shared], ranges)
        unexplained = float(np.sqrt(max(off**2 - 2 * correction.noise**2, 0.0)))
    table = added + correction.torques
    units = {sensor.name: sensor.unit for sensor in own.rig.sensors}
    return Learned(
        repetition=1 + (0 if before is None else len(before.history)), recordings=len(errors),
        time=np.arange(count) * step, dynamometers=law.dynamometers, sensors=names,
        units=tuple(units[name] for name in names), torques=table, error=correction.size,
        noise=correction.noise, predicted=correction.left, unexplained=unexplained,
        share=correction.share, history=() if before is None else before.history,
        controller=replace(exported, learned=table), traces=(mean, correction.predicted), left_out=tuple(left_out),
    )  # fmt: skip


def _needed(ends: Mapping[str, CutReadings]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(name for one in ends.values() for name in (one.torque_sensor, one.speed_sensor)))


def _at_cuts(
    readings: np.ndarray, sensors: Sequence[str], ends: Mapping[str, CutReadings], step: float
) -> tuple[np.ndarray, np.ndarray]:
    """Speeds at the cuts and torques into the vehicle (r, n, k) by what was read (r, n, c), less the begin."""
    speeds, torques = [], []
    for one in ends.values():
        torque, speed = (readings[:, :, sensors.index(name)] for name in (one.torque_sensor, one.speed_sensor))
        speeds.append(one.speed_by_speed * speed + one.speed_by_torque * np.gradient(torque, step, axis=1))
        torques.append(one.torque_by_torque * torque + one.torque_by_speed * np.gradient(speed, step, axis=1))
    return np.stack(speeds, axis=2), np.stack(torques, axis=2)


def _residual_speeds(case: Case, torques: np.ndarray, driven: Mapping[str, np.ndarray], step: float) -> np.ndarray:
    """Speeds (r, n, k) at the cuts, less the begin, of the residual vehicle under torques (r, n, k) there, less the
    begin; of a case with a vehicle of others that is its FMU."""
    if case.vehicle_in_the_loop is not None:
        return _speeds_of_others(case, torques, driven, step)
    residual, loop = case.residual_vehicle, case.loop
    vehicle = stepped_vehicle([residual], loop, (), 1.0)
    acting = {name: value for part in residual.parts for name, value in torques_of(part).items()}
    cuts = [next(cut for cut in residual.interfaces if cut.shaft == one.follows) for one in loop.dynamometers]
    held = np.array([acting.get(cut.torque, 0.0) for cut in cuts])
    own = np.array([acting.get(name, 0.0) for name in vehicle.inputs])
    moved = _middles(_by_input(driven, vehicle.inputs, torques.shape[1]))
    found = np.stack([
        vehicle.drive(vehicle.steady[0], held + _middles(each), own + moved, vehicle.as_planned) @ vehicle.wheel.T
        for each in torques
    ])  # fmt: skip
    if not np.isfinite(found).all():
        raise InputError(
            "recordings", "drive the residual vehicle out of bounds", "check signs and units of the torques"
        )
    return found - found[:, :1]


def _by_input(driven: Mapping[str, np.ndarray], inputs: Sequence[str], samples: int) -> np.ndarray:
    """Torques (n, r) of these inputs; 0 of those that are not driven."""
    rest = np.zeros(samples)
    return np.stack([driven.get(name, rest) for name in inputs], axis=1) if inputs else np.zeros((samples, 0))


def _middles(values: np.ndarray) -> np.ndarray:
    """Means (n − 1, …) over each sample of values (n, …) that are straight in between."""
    return (values[:-1] + values[1:]) / 2


def _speeds_of_others(case: Case, torques: np.ndarray, driven: Mapping[str, np.ndarray], step: float) -> np.ndarray:
    """As :func:`_residual_speeds`, of the FMU of a case: one instance a row, all from the speeds of the case."""
    loop, others = case.loop, case.vehicle_in_the_loop
    assert others is not None
    rows, samples, k = torques.shape
    every, turning = others.timing(step).steps, speeds_of(case.vehicle)
    cuts = [case.residual_vehicle.cut_at(one.follows) for one in loop.dynamometers]
    begin = np.array([[turning[cut.vehicle_end]] * rows for cut in cuts])
    own = _middles(_by_input(driven, [name for name, _ in others.inputs], samples))
    middles = _middles(np.swapaxes(torques, 0, 1))
    at, speeds = [0], [begin]
    with others.started(run_in_of(case), rows) as fmu:
        speeds[0] = fmu.begin(begin, np.zeros_like(begin))
        for first in range(0, samples - 1, every):
            part = slice(first, min(first + every, samples - 1))
            mean = middles[part].mean(axis=0).T
            given = np.repeat(own[part].mean(axis=0)[:, None], rows, axis=1)
            speeds.append(fmu.step(fmu.held + mean, given, every * step))
            at.append(first + every)
    stacked, found = np.array(speeds), np.empty((rows, samples, k))
    for row in range(rows):
        for j in range(k):
            found[row, :, j] = np.interp(np.arange(samples), at, stacked[:, j, row])
    return found - found[:, :1]


def _without_zeros(
    errors: np.ndarray, case: Case, torques: np.ndarray, driven: Mapping[str, np.ndarray], step: float
) -> np.ndarray:
    """Errors (r, n, k) less what wrong zeros of torques and speeds make of them, by least squares of each recording.

    A recording's begin is a short mean on a bed that moves a little. A torque that is off by 2 N·m all the time moves
    the answer of a car by a per cent in three seconds, and no torque can be learned from it.
    """
    shape, k = errors.shape[1:], errors.shape[2]
    more = np.repeat(torques[None], 1 + k, axis=0)
    more[1 + np.arange(k), :, np.arange(k)] += 1.0
    before, *after = _residual_speeds(case, more, driven, step)
    columns = [np.tile(one, (shape[0], 1)) for one in np.eye(k)] + [each - before for each in after]
    basis = np.stack([column.ravel() for column in columns], axis=1)
    flat = errors.reshape(len(errors), -1).T
    left: np.ndarray = flat - basis @ np.linalg.lstsq(basis, flat, rcond=None)[0]
    return left.T.reshape(errors.shape)


def _repetitions(
    recorded: BedRecordings, sensors: Sequence[str], speeds: Collection[str], step: float
) -> tuple[list[tuple[np.ndarray, np.ndarray, str]], list[str]]:
    """Torques (n, u), readings (n, c) and source of each repetition on one clock, less their begin; and what is none.

    All are compared with the recording that most of the others are like; with two, that is the first.
    """
    signals, begins, sources = [], [], [one.source for one in recorded.recordings]
    begin = max(round(LEARNING.begin / step), 1)
    for recording in recorded.recordings:
        time = recording.time - recording.time[0]
        torques, _ = recorded.signals(recording)
        both = np.hstack([torques, np.stack([recording[name] for name in sensors], axis=1)])
        grid = np.arange(int(time[-1] / step + 1e-9) + 1) * step
        both = np.stack([np.interp(grid, time, column) for column in both.T], axis=1)
        begins.append(both[:begin].mean(axis=0))
        signals.append(both - begins[-1])
    inputs, turning = (
        len(recorded.inputs),
        [len(recorded.inputs) + number for number, name in enumerate(sensors) if name in speeds],
    )
    faults = [
        [_no_repetition(signals, begins, one, other, inputs, turning, step) for other in range(len(signals))]
        for one in range(len(signals))
    ]
    like = [sum(not (row[other] or faults[other][one]) for other in range(len(row))) for one, row in enumerate(faults)]
    chosen = int(np.argmax(like))
    left_out: list[str] = []
    kept: list[tuple[int]] = []
    for number, source in enumerate(sources):
        fault = faults[chosen][number] or faults[number][chosen] if number != chosen else ""
        twins = [other for other, *_ in kept if np.array_equal(signals[other], signals[number])]
        if not fault and twins:
            fault = f"holds the same values as {sources[twins[0]]}: they are one recording"
        if fault:
            left_out.append(f"{source} {fault}")
        else:
            kept.append((number,))
    count = min(len(signals[number]) for number, *_ in kept)
    cut = [signals[number][:count] for number, *_ in kept]
    names = [sources[number] for number, *_ in kept]
    return [(each[:, :inputs], each[:, inputs:], name) for each, name in zip(cut, names, strict=True)], left_out


def _no_repetition(
    signals: Sequence[np.ndarray], begins: Sequence[np.ndarray], one: int, other: int, inputs: int,
    turning: Sequence[int], step: float,
) -> str:  # fmt: skip
    """Why one recording is no repetition of another, in words; empty where it is."""
    first, second, settings = signals[one], signals[other], LEARNING
    if len(second) < settings.same_length * len(first):
        return f"ends after {step * len(second):.3g} s, another one after {step * len(first):.3g} s"
    apart = begins[other][list(turning)] - begins[one][list(turning)]
    if len(apart) and np.abs(apart).max() > settings.same_speed:
        return f"begins at rotor speeds that differ by {np.abs(apart).max():.3g} rad/s"
    shift = _shift(first, second, inputs, step)
    if abs(shift) * step > settings.same_trigger:
        return f"is {abs(1e3 * shift * step):.3g} ms {'late' if shift > 0 else 'early'}: let the trigger begin it"
    count = min(len(first), len(second))
    a, b = first[:count], second[:count]
    sizes = np.ptp(a[:, :inputs], axis=0)
    off = np.sqrt(np.mean((b - a)[:, :inputs] ** 2, axis=0))
    if (off > settings.same_torque * sizes).any():
        share = 100 * float((off / np.maximum(sizes, 1e-12)).max())
        return f"was driven with torques that differ by {share:.3g} % of their range"
    ranges = np.ptp(a[:, inputs:], axis=0), np.ptp(b[:, inputs:], axis=0)
    if (ranges[1] < settings.dead * ranges[0]).any():
        return "has a channel that does not move"
    return ""


def _shift(first: np.ndarray, other: np.ndarray, inputs: int, step: float) -> int:
    """By how many samples the trigger of a recording is later than that of the first, by its torques."""
    most, count = round(LEARNING.latest_trigger / step), min(len(first), len(other))
    one, two = (np.diff(each[:count, :inputs], axis=0).ravel(order="F") for each in (first, other))
    if not one.any() or not two.any():  # torques that do not change tell nothing
        return 0
    correlation = np.correlate(two, one, "full")
    centre = len(one) - 1
    window = correlation[centre - most : centre + most + 1] if centre >= most else correlation
    return int(np.argmax(window)) - min(most, centre)


# --- A simulated bed: repetitions one after the other.

RECORDINGS = 2  # of every repetition on a simulated bed: two tell what does not repeat


def learn_on_bed(
    case: Case, bed: Path, out: Path, repetitions: int, vehicle_speed: float | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> list[Learned]:  # fmt: skip
    """Repeat the case's manoeuvre on the FMU of a bed, and learn after every repetition; a folder each."""
    own, _ = case_of_manoeuvre(case, vehicle_speed)
    step = case.loop["sample_time"]
    duration = max(torque.duration for torque in case.manoeuvre.values())
    time = np.arange(round(duration / step) + 1) * step
    held, turning = known_at_operating_point(own), speeds_of(own.rig)
    on = {part.name: part.on for part in own.rig.inputs}
    torques = [torque.torque(time) + held.get(name, 0.0) for name, torque in case.manoeuvre.items()]
    driven = tuple(case.manoeuvre), np.stack(torques, axis=1)
    speed = float(np.mean([turning[on[one.torque_input]] for one in own.loop.dynamometers]))
    found: list[Learned] = []
    controller, played = exported_controller(case), None
    for number in range(1, repetitions + 1):
        folder = out / f"repetition_{number}"
        paths = []
        for recording in range(1, RECORDINGS + 1):
            with (
                bed_of(bed, case) as slave,
                vehicle_beside(case, controller.law, speed) as vehicle,
            ):
                running = controller.running()
                text = emulated_recording(slave, own, controller.law, running, driven, speed, vehicle=vehicle)
            write_all(folder, {f"recording_{recording}.csv": text})
            paths.append(folder / f"recording_{recording}.csv")
        learned = learn(case, paths, played=played, vehicle_speed=vehicle_speed)
        write_all(folder, {TABLE: learned.table(), RESULT: strict_json(learned.to_dict())})
        tell(learned.sentence())
        found.append(learned)
        controller, played = learned.controller, folder
    return found
