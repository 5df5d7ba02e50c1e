"""Beds to record on: as an FMU stepped in real order, by hand in a folder, and as a system to be diagnosed."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Any, Self

import numpy as np

from matching.bed.excite import ExcitationPlan, bed_inputs
from matching.bed.proof import Proof
from matching.bed.verify import COVERAGE_FACTOR, TEXT, BedVerification, appeared, snapshots
from matching.match.box import Uncertain
from matching.match.case import Case
from matching.match.shifts import held_clutches
from modelling.bed.bed import Dynamometer
from modelling.bed.foreign_vehicle import ForeignVehicleLaw
from modelling.bed.stepped import Law, SteppedLaw
from modelling.controller.law import EMULATION, FAULTS, SPEED_HOLD, Answer, SupervisedController
from modelling.effects.effect import shared_place
from modelling.effects.friction_and_compliance import CoulombFriction, StribeckFriction
from modelling.effects.sensors_and_actuators import (
    AllPass,
    DeadTime,
    InputGain,
    Lag,
    SensorDelay,
    SensorDrift,
    SensorGain,
    SensorOffset,
)
from modelling.effects.torques import ConstantTorque
from modelling.errors import InputError
from modelling.linear.steady_motion import torques_of
from modelling.recordings.read import csv_text
from modelling.recordings.readers import READERS
from modelling.recordings.text import LARGEST_FILE, WINDOWS
from modelling.running.run import run
from modelling.running.vehicles import TimedVehicle
from modelling.system import Effect, Quantity, System
from modelling.writing import write_all

# --- Ranges of a system's quantities, in which recordings are to find them.

FIT_RANGE_RATIO = 2.0  # half-width of the range in a fit over that of the box, which may be too narrow
LEAST_SHARE_OF_VALUE = 1e-6  # bounds stay above it: only positive values make sense
_QUANTITIES = ("J", "drag", "stiffness", "damping", "ratio")


def around(value: float, half_width: float) -> Quantity:
    """A quantity with the range that a half-width of the box asks for."""
    reach = FIT_RANGE_RATIO * half_width
    return Quantity(value, max(value - reach, LEAST_SHARE_OF_VALUE * value), value + reach)


def with_quantities(system: System, quantities: Mapping[str, Quantity]) -> System:
    """A system with other quantities of inertias, shafts and effects, by name."""

    def changed(table: str, part: Any) -> Any:
        keys = [key for key in _QUANTITIES if getattr(part, key, None) is not None]
        return replace(part, **{key: quantities.get(f"{table}.{part.name}.{key}", getattr(part, key)) for key in keys})

    def of_effect(effect: Effect) -> Effect:
        values = {key: quantities.get(f"{effect.name}.{key}", quantity) for key, quantity in effect.parameters}
        return replace(effect, parameters=tuple(values.items()))

    return replace(
        system,
        inertias=tuple(changed("inertias", part) for part in system.inertias),
        shafts=tuple(changed("shafts", part) for part in system.shafts),
        effects=tuple(of_effect(effect) for effect in system.effects),
    )


# --- Sensors of a bed that read late, filtered or with a factor: what a diagnosis names of them enters the next match.
#
# The controller reads the sensor as it is, and vehicle and bed are compared by what the same sensor would read of both.
# So the sensor of the vehicle gets the same fault, whatever stands there on the road.

CONSTANT = (SensorOffset.kind, SensorDrift.kind)  # deviations from the state at the switch do not hold them
_TAKEN = (SensorDelay.kind, AllPass.kind, Lag.kind, SensorGain.kind)


def is_taken(effect: Effect) -> bool:
    """Whether a match can take an effect of a sensor."""
    return effect.at.startswith("sensors.") and effect.kind in _TAKEN


def with_faults(system: System, faults: Iterable[Effect]) -> System:
    """A system with faults of those sensors that it has; a fault that is there already is joined with the new one."""
    there = set(system.places())
    for fault in faults:
        at = shared_place(place for place in fault.places if place in there)
        if at:
            system = _joined(system, replace(as_states(fault), at=at))
    return system


def as_states(effect: Effect) -> Effect:
    """An effect that a linear model holds: a delay of a sensor as an all-pass."""
    return replace(effect, kind=AllPass.kind) if effect.kind == SensorDelay.kind else effect


def as_recorded(effect: Effect) -> Effect:
    """An effect as a recording is fitted: the delay itself in place of its all-pass."""
    return replace(effect, kind=SensorDelay.kind) if effect.kind == AllPass.kind else effect


def _joined(system: System, fault: Effect) -> System:
    known = {effect.name: effect for effect in system.effects}
    if fault.name not in known:
        return system.with_effects(fault)
    ((key, before),), ((_, new),) = known[fault.name].parameters, fault.parameters
    value = before.value * new.value if fault.kind == SensorGain.kind else before.value + new.value
    return replace(
        system,
        effects=tuple(
            replace(effect, parameters=((key, Quantity(value)),)) if effect.name == fault.name else effect
            for effect in system.effects
        ),
    )


# --- The bed without emulation as a model file's system, with a range on all that the case's box leaves open.


def names_in_system(case: Case) -> dict[str, str]:
    """Name in :func:`bed_system` of each uncertain quantity that a recording can tell, by its name in the box.

    The times of the loop are those of every dynamometer: see :func:`own_times`.
    """
    names = {}
    for quantity in case.uncertainty.uncertain:
        if quantity.name.startswith("rig."):
            names[quantity.name] = _as_recorded(quantity.name.removeprefix("rig."))
    for dynamometer in case.loop.dynamometers:
        names[f"dynamometers.{dynamometer.name}.torque_gain"] = (
            f"inputs.{dynamometer.torque_input}.{InputGain.kind}.factor"
        )
    return names


def own_times(dynamometer: Dynamometer) -> dict[str, str]:
    """Name in :func:`bed_system` of a dynamometer's delay and lags, by what the loop calls them."""
    command = f"inputs.{dynamometer.torque_input}"
    names = {"dead_time": f"{command}.{DeadTime.kind}.delay", "inverter_lag": f"{command}.{Lag.kind}.time_constant"}
    if dynamometer.torque_sensor:
        names["torque_sensor_lag"] = f"sensors.{dynamometer.torque_sensor}.{Lag.kind}.time_constant"
    return names


def friction_names(case: Case) -> dict[str, str]:
    """Name in :func:`bed_system` of the torque that resists each input's inertia in steady motion, by the inertia."""
    return {part.on: f"inertias.{part.on}.{ConstantTorque.kind}.torque" for part in case.rig.inputs
            if f"inertias.{part.on}" not in _resisted(case.rig)}  # fmt: skip


def bed_system(case: Case, *, turning: bool = False) -> System:
    """The rig with each dynamometer's dead time, lag and gain, and the lag of its torque sensor, as effects.

    Its inputs are torque commands as recorded, linear between samples: the half sample of hold that the loop's dead
    time counts is none of the delay here. Gains of sensors are taken as known; the box counts them after the fit.

    Parameters
    ----------
    turning : bool
        Of a recording in which nothing comes to rest: what torques act on then has a friction of any size up to the
        largest torque of a manoeuvre. It does not change while the bed turns, and no case states it.
    """
    box = {quantity.name: quantity for quantity in case.uncertainty.uncertain}
    loop = case.loop
    of_rig = {
        name.removeprefix("rig."): around(quantity.value, quantity.half_width)
        for name, quantity in box.items() if name.startswith("rig.")
    }  # fmt: skip
    effects = []
    for j, dynamometer in enumerate(loop.dynamometers):
        command = f"inputs.{dynamometer.torque_input}"
        delay = _of(box, "loop.dead_time", loop.command_delays()[j])  # without the half sample of hold
        lag = _of(box, "loop.inverter_lag", loop.lags("inverter_lag")[j])
        gain = _of(box, f"dynamometers.{dynamometer.name}.torque_gain", dynamometer.torque_gain)
        effects += [
            Effect(DeadTime.kind, command, (("delay", delay),)),
            Effect(Lag.kind, command, (("time_constant", lag),)),
            Effect(InputGain.kind, command, (("factor", gain),)),
        ]
        if dynamometer.torque_sensor:
            of_sensor = _of(box, "loop.torque_sensor_lag", loop.lags("torque_sensor_lag")[j])
            effects.append(Effect(Lag.kind, f"sensors.{dynamometer.torque_sensor}", (("time_constant", of_sensor),)))
    largest = case.largest_torque
    if turning and largest:
        effects += [
            Effect(ConstantTorque.kind, f"inertias.{at}", (("torque", Quantity(0.0, -largest, largest)),))
            for at in friction_names(case)
        ]
    return _with_ranges(case.rig, of_rig).with_effects(*effects)


def _resisted(rig: System) -> set[str]:
    """Places with a friction of their own in the model."""
    return {place for effect in rig.effects for place in effect.places
            if effect.kind in (ConstantTorque.kind, CoulombFriction.kind, StribeckFriction.kind)}  # fmt: skip


def _of(box: dict[str, Uncertain], name: str, value: float) -> Quantity:
    return around(value, box[name].half_width) if name in box else Quantity(float(value))


def _as_recorded(name: str) -> str:
    """Name of a rig's quantity in the system that recordings are fitted with."""
    return name.replace(f".{AllPass.kind}.", f".{SensorDelay.kind}.")


def _with_ranges(rig: System, ranges: dict[str, Quantity]) -> System:
    """The rig with ranges on some of its quantities, by name, and on no other; late sensors as recordings have them."""
    of_effects = {f"{effect.name}.{key}" for effect in rig.effects for key, _ in effect.parameters}
    fixed = {name: Quantity(quantity.value) for name, quantity in rig.parameters.items() if name not in of_effects}
    rig = with_quantities(rig, fixed | ranges)
    return replace(rig, effects=tuple(as_recorded(effect) for effect in rig.effects), operating_point=None)


# --- Recordings that a person puts into a folder, whole or while they are being written.

Tell = Callable[[str], None]
KEPT = "recording"  # name of a step's recording, less the end that says its format


class Waiting(Exception):
    """A recording is not there yet: ``what`` says which, and where to put it."""

    def __init__(self, what: str):
        super().__init__(what)
        self.what = what


def so_far(verification: BedVerification) -> str:
    """What a verification of a part of a recording shows, in words."""
    errors = [
        f"{error.name} torques {error.value:.3g} ± {COVERAGE_FACTOR * error.uncertainty:.2g}"
        for error in verification.errors
    ]
    return f"so far {verification.status}: response error to {', '.join(errors)}"


@dataclass(frozen=True)
class HandedRecording:
    """A recording as a step keeps it: the name of its file, and its content; text is kept as text."""

    name: str
    content: str | bytes


def kept_recording(folder: Path) -> Path:
    """Where a step keeps its recording, of whatever format it is."""
    kept = [path for path in _places(folder, KEPT) if path.is_file()]
    return kept[0] if kept else folder / f"{KEPT}.csv"


def keep_recording(folder: Path, recording: HandedRecording) -> None:
    """Write the recording of a step; one of another format, of an earlier run, goes away."""
    write_all(folder, {recording.name: recording.content})
    for path in _places(folder, KEPT):
        if path.name != recording.name:
            path.unlink(missing_ok=True)


@dataclass(frozen=True)
class ByHand:
    """A folder for recordings; ``follow`` (s) says how long one that grows has to stand still, None: it is whole."""

    folder: Path
    follow: float | None
    tell: Tell

    def recording(
        self, name: str, files: Mapping[str, str], what: str, estimate: Callable[[Path], str]
    ) -> HandedRecording:
        """``NAME.csv`` of the folder, or in another format; until it is there, what it needs lies beside its place.

        Parameters
        ----------
        files : mapping of str to str
            By the end of their name.
        what : str
            What to record.
        estimate : callable
            What a recording shows so far, in words; it may raise an InputError.
        """
        places = _places(self.folder, name)
        if not any(place.is_file() for place in places):
            write_all(self.folder, {f"{name}_{file}": text for file, text in files.items()})
            if self.follow is None:
                raise Waiting(f"{places[0]}: {what}; then run the same command again")
            self.tell(f"waiting for {places[0]}: {what}")
            appeared(places)
        present = [place for place in places if place.is_file()]
        if len(present) > 1:
            raise InputError(str(present[0]), f"is there as {present[1].name} too", "leave one of them")
        return self._taken(present[0], estimate)

    def unchanged(self, name: str, kept: Path) -> bool:
        """Whether the folder holds no recording of that name any more, or only the one that a step kept."""
        present = [place for place in _places(self.folder, name) if place.is_file()]
        return not present or (
            [place.suffix for place in present] == [kept.suffix]
            and _content(present[0], present[0]) == _content(kept, kept)
        )

    def _taken(self, place: Path, estimate: Callable[[Path], str]) -> HandedRecording:
        """The recording as it is, or as it is when it has stood still; what it shows until then is said."""
        name = f"{KEPT}{place.suffix}"
        if self.follow is None:
            return HandedRecording(name, _content(place, place))
        content: str | bytes = ""
        with TemporaryDirectory(prefix="rigmatch-") as folder:
            for (copy,) in snapshots([place], self.follow, Path(folder)):
                content = _content(copy, place)
                try:
                    self.tell(f"{place.name}: {estimate(copy)}")
                except InputError as fault:
                    self.tell(f"{place.name}: not yet: {str(fault).replace(str(copy), str(place))}")
        return HandedRecording(name, content)


def _places(folder: Path, name: str) -> list[Path]:
    """Where a recording of a name may lie, as CSV first."""
    return [folder / f"{name}{suffix}" for suffix in READERS]


def _content(path: Path, place: Path) -> str | bytes:
    """Content of a recording, text in an encoding that recordings are read in."""
    if path.stat().st_size > LARGEST_FILE:
        raise InputError(str(place), "is too large", "cut the recording: at most 2 GB are read")
    if path.suffix not in TEXT:
        return path.read_bytes()
    return _text(path, place)


def _text(path: Path, place: Path) -> str:
    """Text of a recording in either encoding."""
    for encoding in ("utf-8-sig", WINDOWS):
        try:
            return path.read_text(encoding=encoding)
        except UnicodeDecodeError:
            continue
    raise InputError(str(place), "is no text", "save it as UTF-8 CSV")


# --- A bed as an FMU, stepped in real order: readings, controller, commands, one sample of the bed.

START_SPEED = "start_speed"  # parameter of a bed's FMU, rad/s of its rotors, where it has one


def check_bed(bed: Path) -> None:
    """A folder for recordings need not be there yet; an FMU has to be."""
    if not (bed.is_file() or bed.is_dir()) and (bed.exists() or bed.suffix.lower() == ".fmu"):
        wrong = "is no regular file and no folder" if bed.exists() else "does not exist"
        raise InputError(str(bed), wrong, "give the FMU of a bed, or a folder for its recordings")


class Slave:
    """An FMI 2.0 co-simulation FMU, spoken to by the names of its variables."""

    def __init__(self, path: Path, needed: Sequence[str]):
        try:
            import fmpy
            from fmpy.fmi2 import FMU2Slave
        except ImportError:
            raise InputError(str(path), "needs FMPy to run", 'in rigmatch\'s folder: pip install -e ".[fmu]"') from None
        try:
            about = fmpy.read_model_description(str(path))
        except Exception as fault:  # FMPy raises what its parsers raise
            raise InputError(
                str(path), f"cannot be read as an FMU: {fault or type(fault).__name__}", "give an FMU or a folder"
            ) from None
        if about.fmiVersion != "2.0" or about.coSimulation is None:
            raise InputError(str(path), "is no FMI 2.0 FMU for co-simulation", "export the bed as one")
        self._references = {variable.name: variable.valueReference for variable in about.modelVariables}
        for name in needed:
            if name not in self._references:
                raise InputError(str(path), f"has no variable {name!r}", "its names are those of the rig file")
        self._path, self._time = path, 0.0
        with self._said():
            self._folder = fmpy.extract(str(path))
            self._slave: Any = FMU2Slave(
                guid=about.guid, unzipDirectory=self._folder, modelIdentifier=about.coSimulation.modelIdentifier,
                instanceName="rigmatch",
            )  # fmt: skip
            self._slave.instantiate()

    @contextlib.contextmanager
    def _said(self) -> Iterator[None]:
        """What the FMU, or FMPy for it, complains of in one line."""
        try:
            yield
        except Exception as fault:  # FMPy raises plain exceptions
            raise InputError(f"{self._path}: t = {self._time:g} s", f"does not run: {fault}", "mend the FMU") from None

    def initialise(self, values: Mapping[str, float]) -> None:
        """Set parameters, SI, of which those that the FMU lacks are left out, and begin."""
        with self._said():
            self._slave.setupExperiment(startTime=0.0)
        self.set({name: value for name, value in values.items() if name in self._references})
        with self._said():
            self._slave.enterInitializationMode()
            self._slave.exitInitializationMode()

    def set(self, values: Mapping[str, float]) -> None:
        """Values by name, SI."""
        if values:
            with self._said():
                self._slave.setReal(
                    [self._references[name] for name in values], [float(value) for value in values.values()]
                )

    def get(self, names: Sequence[str]) -> np.ndarray:
        """Values (v,) by name, SI."""
        with self._said():
            return np.array(self._slave.getReal([self._references[name] for name in names]))

    def advance(self, span: float) -> None:
        """One communication step, s."""
        with self._said():
            self._slave.doStep(currentCommunicationPoint=self._time, communicationStepSize=span)
        self._time += span

    def close(self) -> None:
        """Leave nothing behind."""
        with contextlib.suppress(Exception):  # it may have ended with an error already
            self._slave.terminate()
            self._slave.freeInstance()
        shutil.rmtree(self._folder, ignore_errors=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class FmuBed(Slave):
    """A bed whose FMU's inputs are the rig's inputs (u) and whose outputs are the rig's sensors (y).

    ``clutches`` are N·m by input of what clutches of the FMU carry all the time, None where nobody says.
    """

    def __init__(
        self, path: Path, inputs: Sequence[str], sensors: Sequence[str],
        clutches: Mapping[str, float | None] = MappingProxyType({}),
    ):  # fmt: skip
        super().__init__(path, [*inputs, *sensors])
        self.inputs, self.sensors = tuple(inputs), tuple(sensors)
        self._clutches = {name: torque for name, torque in clutches.items() if torque is not None}
        for name in clutches.keys() - self._clutches.keys():
            if name in self._references:
                self.close()
                right = f"state {name} = 400 or the like under [operating_point] of the case"
                raise InputError(str(path), f"has a clutch {name!r} that nothing closes", right)

    def begin(self, speed: float) -> None:
        """Start with rotors at a speed, rad/s, where the FMU lets that be chosen; else at rest."""
        self.initialise({START_SPEED: speed, **self._clutches})

    def readings(self) -> np.ndarray:
        """What the sensors (y,) read now, SI."""
        return self.get(self.sensors)

    def step(self, commands: np.ndarray, span: float) -> None:
        """Torques (u,), N·m, held over a span, s."""
        self.set(dict(zip(self.inputs, commands, strict=True)))
        self.advance(span)


def bed_of(path: Path, case: Case) -> FmuBed:
    """The FMU of a case's bed, its gearboxes in the case's gear.

    Raises
    ------
    InputError
        If it cannot be run, lacks a signal, or has a clutch that nothing closes.
    """
    sensors = [sensor.name for sensor in case.rig.sensors]
    return FmuBed(path, bed_inputs(case), sensors, held_clutches(case))


class FmuController(Slave):
    """The exported controller's FMU, with the step of :class:`modelling.controller.law.SupervisedController`."""

    def __init__(self, path: Path, law: Law):
        self._commands = [f"{name}.command" for name in law.dynamometers]
        self._hold = [f"{name}.hold_speed" for name in law.dynamometers]
        self._added = [f"{name}.added_torque" for name in law.dynamometers]
        foreign = isinstance(law, ForeignVehicleLaw)
        self._wheel, self._cut = (
            [f"cut.{name}.{what}" for name in law.dynamometers if foreign] for what in ("speed", "torque")
        )
        needed = [*law.sensors, *law.known, *self._commands, *self._hold, *self._added, *self._wheel, *self._cut]
        super().__init__(path, needed)
        self._law = law
        self.cut_torque = np.zeros(len(law.dynamometers))  # N·m, into a vehicle that is stepped outside
        self.initialise({})

    def step(
        self, readings: np.ndarray, known: np.ndarray, mode: int, hold: np.ndarray, life: int,
        added: np.ndarray | None = None, trigger: bool = False, wheel: np.ndarray | None = None,
    ) -> Answer:  # fmt: skip
        """One sample: readings (y,), known torques (w,), N·m, mode asked for, speeds to hold (k,), rad/s, torques that
        are added (k,), N·m, the trigger of what was learned, which an FMU without that has not, and speeds (k,), rad/s,
        of a vehicle that is stepped outside."""
        more = np.zeros(len(hold)) if added is None else added
        names = (*self._law.sensors, *self._law.known, *self._hold, *self._added)
        values = dict(zip(names, (*readings, *known, *hold, *more), strict=True))
        played = {"trigger": float(trigger)} if "trigger" in self._references else {}
        turning = {} if wheel is None else dict(zip(self._wheel, wheel, strict=True))
        self.set(values | {"mode": float(mode), "life": float(life)} | played | turning)
        self.advance(self._law.sample_time)
        if self._cut:
            self.cut_torque = self.get(self._cut)
        *commands, active, fault = self.get([*self._commands, "active_mode", "fault"])
        return Answer(np.array(commands), int(active), int(fault))


def held_as_linear(torques: np.ndarray) -> np.ndarray:
    """Samples (t, u) whose straight connection acts like ``torques`` (t, u) held over each sample.

    A recording is read as straight between its samples. The four coefficients make both alike to the fourth order of
    frequency over sampling frequency.
    """
    padded = np.vstack([torques[:1], torques[:1], torques, torques[-1:]])
    return (7 * (padded[2:-1] + padded[1:-2]) - (padded[3:] + padded[:-3])) / 12


def columns(names: Sequence[str], values: np.ndarray) -> Mapping[str, np.ndarray]:
    """Columns (t,) of values (t, y) by name."""
    return {name: values[:, i] for i, name in enumerate(names)}


# --- Runs

SETTLING_SECONDS = 2.0  # of speed hold before anything is recorded


class FmuPlant:
    """A bed's FMU as a :class:`modelling.running.plant.Plant`; ``commands`` are those inputs that a controller gives.

    Parameters
    ----------
    bed : FmuBed
    commands : sequence of str
    speed : float
        rad/s of the rotors at the start, where the FMU lets that be chosen.
    """

    count = 1

    def __init__(self, bed: FmuBed, commands: Sequence[str], speed: float):
        self.bed, self.speed, self.sensors, self.commands = bed, speed, bed.sensors, tuple(commands)
        self.inputs = tuple(name for name in bed.inputs if name not in commands)
        self.last = np.zeros(len(bed.sensors))  # what was read last

    def begin(self, torques: np.ndarray) -> None:
        """See :class:`modelling.running.plant.Plant`."""
        self.bed.begin(self.speed)

    def readings(self) -> np.ndarray:
        """See :class:`modelling.running.plant.Plant`."""
        self.last = self.bed.readings()
        return self.last[:, None]

    def step(self, commands: np.ndarray, torques: np.ndarray, after: np.ndarray, span: float) -> None:
        """See :class:`modelling.running.plant.Plant`; an FMU holds all its inputs over a step."""
        given = dict(zip((*self.commands, *self.inputs), (*commands[:, 0], *torques[:, 0]), strict=True))
        self.bed.step(np.array([given[name] for name in self.bed.inputs]), span)


@dataclass
class _Excitation:
    """Planned torques (t, u) on all inputs of a bed, and a PI speed hold of the rotors beside them."""

    sensors: tuple[str, ...]
    demands: np.ndarray
    proportional: np.ndarray
    integral: np.ndarray
    speed: float
    span: float
    known: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        self._total = np.zeros(len(self.proportional))

    def step(self, sample: int, readings: np.ndarray, known: np.ndarray) -> np.ndarray:
        """See :class:`modelling.running.plant.Controller`."""
        error, sent = self.speed - readings[:, 0], self.demands[sample].copy()
        sent[: len(error)] += self.proportional * error + self._total
        self._total = self._total + self.integral * self.span * error
        return sent[:, None]


def excited_recording(bed: FmuBed, case: Case, plan: ExcitationPlan) -> str:
    """Text of the CSV recording of a planned excitation on a bed."""
    step = case.loop["sample_time"]
    proportional, integral = (np.array([hold[i] for hold in plan.hold.values()]) for i in (0, 1))
    before = round(SETTLING_SECONDS / step)
    demands = np.vstack([np.zeros((before, len(plan.inputs))), plan.torques])
    speeds = tuple(dynamometer.speed_sensor for dynamometer in case.loop.dynamometers)
    hold = _Excitation(speeds, demands, proportional, integral, plan.speed, step)
    found = run(FmuPlant(bed, bed.inputs, plan.speed), hold, samples=len(demands), sample_time=step)
    sent, readings = found.commands[:, :, 0], found.readings[:, :, 0]
    return run_csv(case, bed, step, held_as_linear(sent)[before:], readings[before:], plan.inputs)


class Tripped(InputError):
    """The controller gave up; ``recording`` is the text of what was recorded up to there."""

    def __init__(self, time: float, fault: str, reason: str, recording: str):
        because = f" ({reason})" if reason else ""
        super().__init__(
            "bed", f"{time:.3f} s after the start the controller gave up: {fault}{because}",
            "look at the recording, limits and watchdogs",
        )  # fmt: skip
        self.recording = recording


def proof_recording(
    bed: FmuBed,
    case: Case,
    law: Law,
    controller: FmuController | SupervisedController,
    wanted: Proof,
    speed: float,
    replayed: SupervisedController | None = None,
    vehicle: TimedVehicle | None = None,
) -> str:
    """Text of the CSV recording of the controlled bed under a proof's torques; see :func:`emulated_recording`."""
    return emulated_recording(bed, case, law, controller, (wanted.inputs, wanted.torques), speed, replayed, vehicle)


def emulated_recording(
    bed: FmuBed, case: Case, law: Law, controller: FmuController | SupervisedController,
    driven: tuple[Sequence[str], np.ndarray], speed: float, replayed: SupervisedController | None = None,
    vehicle: TimedVehicle | None = None,
) -> str:  # fmt: skip
    """Text of the CSV recording of the controlled bed under torques, emulation on; the trigger rises with its begin.

    Parameters
    ----------
    driven : (sequence of str, ndarray (t, u))
        Inputs of rig and vehicle and their torques, N·m, one row a sample of the law.
    speed : float
        rad/s of the rotors before.
    replayed : SupervisedController, optional
        The same controller in Python, at its beginning. After a fault it gets what ``controller`` got, and says which
        reading led to it.
    vehicle : TimedVehicle, optional
        A vehicle of others beside the controller, begun at the rotors' speed.

    Raises
    ------
    Tripped
        If the controller gives up.
    """
    (inputs, asked), step = driven, case.loop["sample_time"]
    before = round(SETTLING_SECONDS / step)
    commanded = [dynamometer.torque_input for dynamometer in case.loop.dynamometers]
    # mean torques, which keep free play closed, rise in speed hold
    rising = np.minimum(np.arange(before) / max(before // 4, 1), 1.0)[:, None] * asked[0]
    torques = np.vstack([rising, asked])
    plant = FmuPlant(bed, commanded, speed)
    # the bed holds a motor's torque over a sample; one of the road is only read by the controller, at the sample
    as_linear = np.where([name in plant.inputs for name in inputs], held_as_linear(torques), torques)
    acting = {name: torques[:, i] for i, name in enumerate(inputs) if name in plant.inputs}
    told = {name: as_linear[:, i] for i, name in enumerate(inputs) if name in law.known}
    held_inputs = {**case.closed_clutches, **_held_pedals(case, law, speed)}
    told |= {name: np.full(len(torques), value) for name, value in held_inputs.items() if name not in told}
    asks = _Emulation(controller, tuple(law.sensors), tuple(law.known), np.full(len(commanded), speed), before, vehicle)
    found = run(plant, asks, acting, told, samples=len(torques), sample_time=step)
    sent, readings = found.commands[:, :, 0], found.readings[:, :, 0]
    if asks.fault:
        i = len(sent)
        if replayed is not None:
            for n, (one, wheel) in enumerate(zip(asks.given, asks.wheels, strict=True)):
                replayed.step(*one, trigger=n >= before, wheel=wheel)
        sent, readings = np.vstack([sent, np.zeros(len(commanded))]), np.vstack([readings, plant.last])
        held = np.hstack([as_linear[: i + 1], held_as_linear(sent)])
        text = run_csv(case, bed, step, held, readings, (*inputs, *commanded))
        raise Tripped((i - before) * step, FAULTS[asks.fault], getattr(replayed or controller, "reason", ""), text)
    held = np.hstack([as_linear, held_as_linear(sent)])[before:]
    return run_csv(case, bed, step, held, readings[before:], (*inputs, *commanded))


def _held_pedals(case: Case, law: Law, speed: float) -> dict[str, float]:
    """Pedals of the vehicle that hold the rotors' speed, rad/s, of a case at one speed that of its operating point."""
    held = {name: pedal for name, pedal in torques_of(case.vehicle).items() if name in case.vehicle.pedals}
    if isinstance(law, SteppedLaw):
        rotor = speed * float(law.rotor_shares.sum())
        own = zip(law.vehicle.inputs, law.vehicle.steady_own.T, strict=True)
        held |= {name: float(np.interp(rotor, law.rotor_speeds, each)) for name, each in own if name in held}
    return held


@dataclass
class _Emulation:
    """A supervised controller: half the settling time speed hold, then emulation; it ends the run with its fault."""

    controller: FmuController | SupervisedController
    sensors: tuple[str, ...]
    known: tuple[str, ...]
    hold: np.ndarray
    before: int
    vehicle: TimedVehicle | None = None
    fault: int = 0
    wheels: list[np.ndarray | None] = field(default_factory=list)
    given: list[tuple[np.ndarray, np.ndarray, int, np.ndarray, int]] = field(default_factory=list)

    def step(self, sample: int, readings: np.ndarray, known: np.ndarray) -> np.ndarray | None:
        """See :class:`modelling.running.plant.Controller`."""
        mode = SPEED_HOLD if sample < self.before // 2 else EMULATION
        self.given.append((readings[:, 0], known[:, 0], mode, self.hold, sample))
        trigger = sample >= self.before
        if self.vehicle is None:
            self.wheels.append(None)
            answer = self.controller.step(*self.given[-1], trigger=trigger)
        else:
            wheel = self.vehicle.read()[:, 0]
            self.wheels.append(wheel)
            answer = self.controller.step(*self.given[-1], trigger=trigger, wheel=wheel)
            if mode == EMULATION:  # while the speeds are held the vehicle waits at them
                own = np.array([known[self.known.index(name)] for name in self.vehicle.vehicle.own]).reshape(-1, 1)
                self.vehicle.go_on(self.controller.cut_torque[:, None], own)
        self.fault = answer.fault
        return None if answer.fault else answer.commands[:, None]


def run_csv(
    case: Case, bed: FmuBed, step: float, torques: np.ndarray, readings: np.ndarray, inputs: tuple[str, ...]
) -> str:
    """Text of the CSV recording of a run: torques and pedals (t, u), readings (t, y), SI."""
    of_inputs = {**case.vehicle.input_units, **case.rig.input_units}
    units = {sensor.name: sensor.unit for sensor in case.rig.sensors} | {name: of_inputs[name] for name in inputs}
    return csv_text(
        np.arange(len(torques)) * step, {**columns(inputs, torques), **columns(bed.sensors, readings)}, units
    )
