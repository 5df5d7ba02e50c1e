"""Manoeuvres: torques over time, as drivability is tested."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from modelling.errors import InputError, unknown
from modelling.recordings.read import read_signals
from modelling.recordings.recording import Recording
from modelling.system import System
from modelling.toml import no_pipe
from modelling.units import PEDAL_UNIT, in_unit, to_si

# --- Shapes of a torque over time, by name, as drivability is tested.

TORQUE_UNIT = "N*m"  # of what a manoeuvre changes, unless its input is a pedal
UNITS = {
    "amplitude": TORQUE_UNIT, "offset": TORQUE_UNIT, "creep": TORQUE_UNIT, "at": "s", "rise_time": "s", "duration": "s",
    "hold": "s", "first_frequency": "Hz", "last_frequency": "Hz",
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Manoeuvre:
    """A torque over time, or of a pedal its position.

    Attributes
    ----------
    amplitude : float
        N·m, by which the torque changes; of a pedal from 0 to 1.
    offset : float
        N·m or a pedal, before it begins.
    at : float
        s, when it begins.
    duration : float
        s, of the whole manoeuvre with what goes before and after.
    """

    kind: ClassVar[str] = ""
    amplitude: float
    offset: float = 0.0
    at: float = 0.2
    duration: float = 3.0

    def __post_init__(self) -> None:
        for entry in dataclasses.fields(self):
            value = getattr(self, entry.name)
            if isinstance(value, str):  # with a unit, such as "100 N*m"
                value = to_si(value, UNITS[entry.name], entry.name)
                object.__setattr__(self, entry.name, value)
            if not math.isfinite(value):
                raise InputError(entry.name, "is not finite", "write a finite number")
            if entry.name not in ("amplitude", "offset", "creep") and value < 0:
                raise InputError(entry.name, f"{value:g} is not possible", "0 or more is needed")
        if self.duration <= self.at:
            raise InputError(
                "duration", f"{self.duration:g} s ends before it begins at {self.at:g} s", "make it longer"
            )

    def torque(self, time: np.ndarray) -> np.ndarray:
        """Torque (t,) in N·m, or pedal, at times (t,) in s."""
        return self.offset + self.amplitude * self.shape(np.asarray(time, dtype=float) - self.at)

    def shape(self, since: np.ndarray) -> np.ndarray:
        """Share of the amplitude (t,) at times since the beginning (t,), s."""
        raise NotImplementedError

    @property
    def end(self) -> float:
        """Torque at its end, N·m."""
        return float(self.torque(np.array([self.duration]))[0])

    @property
    def largest(self) -> float:
        """Largest torque without its sign, N·m, of 2001 moments."""
        return float(np.abs(self._moments).max())

    @property
    def smallest(self) -> float:
        """Smallest torque, N·m, of 2001 moments."""
        return float(self._moments.min())

    @property
    def _moments(self) -> np.ndarray:
        return self.torque(np.linspace(0, self.duration, 2001))

    def time(self, rate: float = 1000.0) -> np.ndarray:
        """Time stamps (t,) in s at a rate in Hz."""
        return np.arange(round(self.duration * rate) + 1) / rate

    @property
    def words(self) -> str:
        """What it is, before "of … N·m"."""
        return self.kind.replace("_", "-")

    def table(self) -> Any:
        """As a case file holds it, SI."""
        return {"kind": self.kind} | {entry.name: getattr(self, entry.name) for entry in dataclasses.fields(self)}

    def inputs(self, time: np.ndarray, on: str, others: Mapping[str, float] | None = None) -> dict[str, np.ndarray]:
        """Torques (t,) in N·m by input at times (t,) in s: this one on the input ``on``, constant ones on others."""
        constant = {name: np.full(len(time), float(value)) for name, value in (others or {}).items()}
        return constant | {on: self.torque(time)}


@dataclass(frozen=True, kw_only=True)
class Step(Manoeuvre):
    """A jump."""

    kind = "step"

    def shape(self, since: np.ndarray) -> np.ndarray:
        """0, then 1 (t,)."""
        return (since >= 0).astype(float)


@dataclass(frozen=True, kw_only=True)
class TipIn(Manoeuvre):
    """The driver steps on the pedal: a ramp of ``rise_time`` (s) from offset to offset + amplitude."""

    kind = "tip_in"
    rise_time: float = 0.05

    def shape(self, since: np.ndarray) -> np.ndarray:
        """A ramp from 0 to 1."""
        return np.clip(since / max(self.rise_time, 1e-9), 0, 1)


@dataclass(frozen=True, kw_only=True)
class BackOut(TipIn):
    """The driver lifts the foot: a ramp down from offset + amplitude to offset."""

    kind = "back_out"

    def shape(self, since: np.ndarray) -> np.ndarray:
        """A ramp (t,) from 1 to 0."""
        return 1 - super().shape(since)


@dataclass(frozen=True, kw_only=True)
class DriveAway(TipIn):
    """From standstill: creep torque for ``hold`` (s), then a ramp to offset + amplitude, smooth at both ends."""

    kind = "drive_away"
    rise_time: float = 0.6
    creep: float = 0.0
    hold: float = 0.3

    def torque(self, time: np.ndarray) -> np.ndarray:
        """Creep, hold, rise."""
        since = np.asarray(time, dtype=float) - self.at
        creeping = self.creep * _smooth(since / max(self.hold, 1e-9))
        rising = _smooth((since - self.hold) / max(self.rise_time, 1e-9))
        return self.offset + creeping + (self.amplitude - self.creep) * rising


@dataclass(frozen=True, kw_only=True)
class Sweep(Manoeuvre):
    """A sine whose frequency rises evenly in octaves, from ``first_frequency`` to ``last_frequency`` (Hz)."""

    kind = "sweep"
    duration: float = 30.0
    first_frequency: float = 0.5
    last_frequency: float = 30.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 < self.first_frequency < self.last_frequency:
            raise InputError(
                "first_frequency", f"{self.first_frequency:g} … {self.last_frequency:g} Hz is no band", "first < last"
            )

    def shape(self, since: np.ndarray) -> np.ndarray:
        """An exponential chirp (t,)."""
        length, octaves = self.duration - self.at, np.log(self.last_frequency / self.first_frequency)
        inside = np.clip(since, 0, length)
        return np.sin(2 * np.pi * self.first_frequency * length / octaves * np.expm1(octaves * inside / length))


@dataclass(frozen=True, kw_only=True)
class Kick(TipIn):
    """A one-sided pulse: half a sine of ``rise_time`` (s) up and as long down; the torque never reverses."""

    kind = "kick"

    def shape(self, since: np.ndarray) -> np.ndarray:
        """Half a sine."""
        part = np.clip(since / max(2 * self.rise_time, 1e-9), 0, 1)
        return np.sin(np.pi * part)


KINDS: dict[str, type[Manoeuvre]] = {cls.kind: cls for cls in (Step, TipIn, BackOut, DriveAway, Sweep, Kick)}


def _smooth(part: np.ndarray) -> np.ndarray:
    """From 0 to 1 with level ends."""
    part = np.clip(part, 0, 1)
    return part * part * (3 - 2 * part)


# --- Manoeuvres of several segments, and recorded torques.


@dataclass(frozen=True, kw_only=True)
class Segments(Manoeuvre):
    """Manoeuvres that follow one another, each over its own duration; ``amplitude`` is the range of the torque."""

    kind = "segments"
    segments: tuple[Manoeuvre, ...]

    def __post_init__(self) -> None:
        """Each segment has checked itself."""

    @classmethod
    def of(cls, segments: Sequence[Manoeuvre]) -> Segments:
        """The sequence of segments."""
        made = cls(
            amplitude=0.0,
            offset=float(segments[0].torque(np.zeros(1))[0]),
            at=segments[0].at,
            duration=sum(segment.duration for segment in segments),
            segments=tuple(segments),
        )
        return replace(made, amplitude=float(np.ptp(made.torque(made.time()))))

    def torque(self, time: np.ndarray) -> np.ndarray:
        """Torque (t,) in N·m; before the first segment and after the last its end value holds."""
        time = np.asarray(time, dtype=float)
        ends = np.cumsum([segment.duration for segment in self.segments])
        which = np.minimum(np.searchsorted(ends, time, side="right"), len(ends) - 1)
        torque = np.empty(len(time))
        for i, segment in enumerate(self.segments):
            inside = which == i
            torque[inside] = segment.torque(np.minimum(time[inside], ends[i]) - ends[i] + segment.duration)
        return torque

    @property
    def words(self) -> str:
        """See :attr:`Manoeuvre.words`."""
        return f"{len(self.segments)} segments over {self.duration:g} s with a range"

    def table(self) -> Any:
        """As a case file holds it, SI."""
        return [segment.table() for segment in self.segments]


@dataclass(frozen=True, kw_only=True)
class RecordedTorque(Manoeuvre):
    """A recorded torque, straight between its samples; ``amplitude`` is its range.

    ``times`` (t,) in s from 0 on, ``torques`` (t,) in N·m.
    """

    kind = "recorded"
    times: tuple[float, ...]
    torques: tuple[float, ...]

    def __post_init__(self) -> None:
        """The recording was checked when it was read."""

    @classmethod
    def of(cls, time: np.ndarray, torque: np.ndarray) -> RecordedTorque:
        """From samples (t,) in s and N·m."""
        times = np.asarray(time, float) - time[0]
        return cls(
            amplitude=float(np.ptp(torque)),
            offset=float(torque[0]),
            at=0.0,
            duration=float(times[-1]),
            times=tuple(times.tolist()),
            torques=tuple(np.asarray(torque, float).tolist()),
        )

    def torque(self, time: np.ndarray) -> np.ndarray:
        """Torque (t,) in N·m; outside the record its first and last value hold."""
        return np.interp(time, self.times, self.torques)

    @property
    def words(self) -> str:
        """See :attr:`Manoeuvre.words`."""
        return f"recorded torque over {self.duration:.4g} s with a range"

    def csv(self, name: str, unit: str = TORQUE_UNIT) -> str:
        """The record as a CSV file with the input's name and SI unit."""
        rows = (f"{time!r},{torque!r}" for time, torque in zip(self.times, self.torques, strict=True))
        return "\n".join([f"time [s],{name} [{unit}]", *rows, ""])


# --- Manoeuvres from the entries of a case file: a shape by name, a list of segments, or a file with a recorded torque.

RAMP = {"to": TORQUE_UNIT, "over": "s", "hold": "s"}


def _of_input(unit: str, quantity: str) -> str:
    """The unit of a quantity of a manoeuvre on an input of a unit."""
    return unit if quantity == TORQUE_UNIT else quantity


def driven(system: System, torques: Mapping[str, Manoeuvre], rate: float = 1000.0) -> Recording:
    """Inputs of a system under manoeuvres, as a recording without sensors.

    Parameters
    ----------
    system : System
    torques : mapping of input to Manoeuvre
        Inputs that are not named are 0.
    rate : float
        Hz.

    Raises
    ------
    InputError
        If the system lacks an input, none is named, or what stands for one is no manoeuvre.
    """
    names = [part.name for part in system.inputs]
    for name in torques:
        if name not in names:
            raise InputError(name, "is no input of the model", f"its inputs are {', '.join(names)}")
        if not hasattr(torques[name], "torque"):
            wrong = f"{torques[name]!r} is no manoeuvre"
            raise InputError(name, wrong, "write one, such as rm.Step(amplitude=5) or rm.TipIn(amplitude=100)")
    if not torques:
        raise InputError("recording", "no input is named", f"write one of {', '.join(names)} with its manoeuvre")
    time = max(torques.values(), key=lambda torque: torque.duration).time(rate)
    still = np.zeros(len(time))
    return Recording(time, {name: torques[name].torque(time) if name in torques else still for name in names})


def read_manoeuvre(
    entry: Any, name: str, where: str, folder: Path, held: float = 0.0, unit: str = TORQUE_UNIT
) -> Manoeuvre:  # fmt: skip
    """A manoeuvre on the input ``name``.

    Parameters
    ----------
    entry : mapping or list
        A table with ``kind``; a list of such tables and of ramps ``{ to, over, hold }`` that follow one another; or
        ``{ file, absolute }``.
    folder : Path
        Where the case file stands.
    held : float
        N·m or pedal, the input's value at the operating point: subtracted from a recording that is absolute.
    unit : str
        SI unit of the input.

    Raises
    ------
    InputError
        Naming the key that is wrong.
    """
    made: Manoeuvre
    if isinstance(entry, Sequence) and not isinstance(entry, str):
        made = _segments(entry, where, unit)
    elif isinstance(entry, Mapping) and "file" in entry:
        made = _recorded(entry, name, where, folder, held, unit)
    else:
        made = from_table(entry, where, unit)
    if unit == PEDAL_UNIT and made.largest > 1:
        raise InputError(where, f"reaches {made.largest:.4g}, and a pedal is 0 to 1", 'write 0.5 or "50 %"')
    return made


def from_table(table: Mapping[str, Any], where: str, unit: str = TORQUE_UNIT) -> Manoeuvre:
    """A manoeuvre from a table of a case file: ``kind``, ``amplitude`` and what else the kind has.

    Raises
    ------
    InputError
        Naming the key that is wrong.
    """
    if not isinstance(table, Mapping):
        raise InputError(
            where, f"{type(table).__name__} where a table is expected", 'write kind = "tip_in", amplitude = 100, …'
        )
    if "kind" not in table:
        raise InputError(f"{where}.kind", "is missing", f"write one of {', '.join(KINDS)}")
    kind = table["kind"]
    if not isinstance(kind, str) or kind not in KINDS:
        raise unknown(str(kind), list(KINDS), f"{where}.kind")
    cls = KINDS[kind]
    known = {entry.name: entry for entry in dataclasses.fields(cls)}
    for key in table:
        if key != "kind" and key not in known:
            raise unknown(str(key), list(known), f"{where} ({kind})")
    for key, entry in known.items():
        if entry.default is dataclasses.MISSING and key not in table:
            raise InputError(
                f"{where} ({kind})", f"{key!r} is missing", f"give a number{in_unit(_of_input(unit, UNITS[key]))}"
            )
    values = {
        key: to_si(value, _of_input(unit, UNITS[key]), f"{where}.{key}")
        for key, value in table.items()
        if key != "kind"
    }
    try:
        return cls(**values)
    except InputError as fault:
        raise InputError(f"{where}.{fault.where}", fault.wrong, fault.right) from None


def _segments(entries: Sequence[Any], where: str, unit: str) -> Segments:
    """Segments one after the other; a ramp begins at the torque where the segment before it ends."""
    if not entries:
        raise InputError(
            where, "has no segments", 'write { to = 120, over = 0.05, hold = 2 } or { kind = "tip_in", … }'
        )
    made: list[Manoeuvre] = []
    for number, entry in enumerate(entries, 1):
        place = f"{where}[{number}]"
        if isinstance(entry, Mapping) and "kind" not in entry:
            made.append(_ramp(entry, made[-1].end if made else 0.0, place, unit))
        else:
            made.append(from_table(entry, place, unit))
    return Segments.of(made)


def _ramp(entry: Mapping[str, Any], begin: float, where: str, of_input: str) -> TipIn:
    for key in entry:
        if key not in RAMP:
            raise unknown(str(key), [*RAMP, "kind"], where)
    if "to" not in entry:
        raise InputError(where, "'to' is missing", f"give where the ramp ends, a number{in_unit(of_input)}")
    to, over, hold = (
        to_si(entry.get(key, 0.0), _of_input(of_input, unit), f"{where}.{key}") for key, unit in RAMP.items()
    )
    if min(over, hold) < 0 or not over + hold > 0:
        raise InputError(where, "takes no time", "give over and hold in s")
    return TipIn(amplitude=to - begin, offset=begin, at=0.0, rise_time=over, duration=over + hold)


def _recorded(
    entry: Mapping[str, Any], name: str, where: str, folder: Path, held: float, of_input: str
) -> RecordedTorque:  # fmt: skip
    for key in entry:
        if key not in ("file", "absolute"):
            raise unknown(str(key), ["file", "absolute"], where)
    file, absolute = entry["file"], entry.get("absolute", False)
    if not isinstance(file, str) or not file:
        raise InputError(f"{where}.file", "is no text", f'write file = "trace.csv" with columns time and {name}')
    if not isinstance(absolute, bool):
        raise InputError(f"{where}.absolute", "is no true or false", "true where the operating point is in the record")
    recording = read_signals(no_pipe(folder / file, where), [name])
    if name not in recording.channels:
        raise InputError(f"{where}.file", f"{file} has no column {name!r}", "call its torque as the input is called")
    if unit := recording.units.get(name):
        to_si(f"1 {unit}", of_input, f"{where}.file: {name}")
    return RecordedTorque.of(recording.time, recording[name] - (held if absolute else 0.0))


# --- Manoeuvres

# fmt: skip
