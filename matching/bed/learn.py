"""Learning over repetitions on the bed: recordings of one manoeuvre give the torques that are added the next time."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from matching.bed.excite import bed_inputs
from matching.bed.simulated_bed import FmuBed, emulated_recording
from matching.bed.verify import BedRecordings, read_recordings
from matching.dry_run import computing
from matching.match.case import Case
from matching.match.driving import vehicles_in
from matching.match.exported import exported_controller
from matching.match.imperfections import Imperfection
from matching.match.learning import LEARNING, Learner, added_to
from matching.match.operating_range import at_speed, body_speed
from modelling.bed.bed import Dynamometer
from modelling.bed.scheduled import ScheduledLaw
from modelling.controller.law import ExportedController
from modelling.display import Displayed
from modelling.errors import InputError
from modelling.fidelity.over_range import at_rest
from modelling.fmu.export import controller_fmu
from modelling.linear.steady_motion import speeds_of, torques_of
from modelling.recordings.read import Channel, csv_text, read_signals
from modelling.writing import strict_json, write_all

TABLE, RESULT, CONTROLLER = "learned.csv", "learned.json", "controller.fmu"


@dataclass(frozen=True)
class Learned(Displayed):
    """What repetitions of a manoeuvre say, and the torques of the next one; n samples, k dynamometers, c sensors.

    Errors are root mean squares of sensor less vehicle over the range of the vehicle's signal, of all compared sensors.

    Attributes
    ----------
    repetition : int
        How often torques were corrected, this time included.
    recordings : int
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
        if self.share == 0:
            return f"{said}; no torque improves every bed that may stand there, nothing is learned"
        if not self.worth:
            return f"{said}; another repetition is not worth it"
        return f"{said}; with the torques learned {100 * self.predicted:.2g} % is expected"

    def to_dict(self) -> dict[str, Any]:
        """As ``learned.json`` holds it."""
        return {
            "repetition": self.repetition, "recordings": self.recordings, "error": self.error, "noise": self.noise,
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
    law = exported.law.frozen(speed) if isinstance(exported.law, ScheduledLaw) else exported.law
    step = law.sample_time
    torques, readings = _together(recorded, step)
    count = readings.shape[1]
    added = np.zeros((count, len(law.dynamometers)))
    if before is not None:
        shared = min(count, len(before.torques))
        added[:shared] = before.torques[:shared]
    driven = dict(zip(recorded.inputs, torques.mean(axis=0).T, strict=True))
    vehicle = vehicles_in(own, driven, [Imperfection("")], recorded.sensors)[:, :, 0]
    ranges = np.ptp(vehicle, axis=0)
    if (resting := at_rest(vehicle)).any():
        still = recorded.sensors[int(np.argmax(resting))]
        right = "record the manoeuvre from its trigger on"
        raise InputError(Path(recordings[0]).name, f"moves nothing that {still} reads", right)
    errors = readings - vehicle
    compared = tuple(pair for pair in own.compared if pair.sensor in recorded.sensors)
    learner = Learner.of(replace(own, compared=compared), law, count)
    correction = learner.correction(errors, ranges)
    mean = errors.mean(axis=0)
    unexplained = None
    if before is not None:
        shared = min(count, len(before.predicted))
        off = learner.size(mean[:shared] - before.predicted[:shared], ranges)
        unexplained = float(np.sqrt(max(off**2 - 2 * correction.noise**2, 0.0)))
    table = added + correction.torques
    units = {sensor.name: sensor.unit for sensor in own.rig.sensors}
    return Learned(
        repetition=1 + (0 if before is None else len(before.history)), recordings=len(recordings),
        time=np.arange(count) * step, dynamometers=law.dynamometers, sensors=recorded.sensors,
        units=tuple(units[name] for name in recorded.sensors), torques=table, error=correction.size,
        noise=correction.noise, predicted=correction.left, unexplained=unexplained,
        share=correction.share, history=() if before is None else before.history,
        controller=replace(exported, learned=table), traces=(mean, correction.predicted),
    )  # fmt: skip


def _together(recorded: BedRecordings, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Torques (r, n, u) and readings (r, n, c) on one clock, less their values at the begin, aligned by the torques."""
    signals = []
    for recording in recorded.recordings:
        time = recording.time - recording.time[0]
        torques, readings = recorded.signals(recording)
        grid = np.arange(int(time[-1] / step + 1e-9) + 1) * step
        both = np.hstack([torques, readings])
        signals.append(np.stack([np.interp(grid, time, column) for column in both.T], axis=1))
    shifts = [_shift(signals[0], each, len(recorded.inputs), step) for each in signals]
    first = max(max(-shift, 0) for shift in shifts)
    count = min(len(each) - first - shift for each, shift in zip(signals, shifts, strict=True))
    cut = np.stack([each[first + shift : first + shift + count] for each, shift in zip(signals, shifts, strict=True)])
    begin = max(round(LEARNING.begin / step), 1)
    cut = cut - cut[:, :begin].mean(axis=1, keepdims=True)
    inputs = len(recorded.inputs)
    return cut[:, :, :inputs], cut[:, :, inputs:]


def _shift(first: np.ndarray, other: np.ndarray, inputs: int, step: float) -> int:
    """By how many samples the trigger of a recording is later than that of the first, by its torques."""
    most, count = round(LEARNING.latest_trigger / step), min(len(first), len(other))
    one, two = (np.diff(each[:count, :inputs], axis=0).ravel(order="F") for each in (first, other))
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
    sensors = [sensor.name for sensor in case.rig.sensors]
    step = case.loop["sample_time"]
    duration = max(torque.duration for torque in case.manoeuvre.values())
    time = np.arange(round(duration / step) + 1) * step
    held, turning, on = torques_of(own.rig), speeds_of(own.rig), {part.name: part.on for part in own.rig.inputs}
    torques = [torque.torque(time) + held.get(name, 0.0) for name, torque in case.manoeuvre.items()]
    driven = tuple(case.manoeuvre), np.stack(torques, axis=1)
    speed = float(np.mean([turning[on[one.torque_input]] for one in own.loop.dynamometers]))
    found: list[Learned] = []
    controller, played = exported_controller(case), None
    for number in range(1, repetitions + 1):
        folder = out / f"repetition_{number}"
        paths = []
        for recording in range(1, RECORDINGS + 1):
            with FmuBed(bed, bed_inputs(case), sensors) as slave:
                text = emulated_recording(slave, own, controller.law, controller.running(), driven, speed)
            write_all(folder, {f"recording_{recording}.csv": text})
            paths.append(folder / f"recording_{recording}.csv")
        learned = learn(case, paths, played=played, vehicle_speed=vehicle_speed)
        write_all(folder, {TABLE: learned.table(), RESULT: strict_json(learned.to_dict())})
        tell(learned.sentence())
        found.append(learned)
        controller, played = learned.controller, folder
    return found
