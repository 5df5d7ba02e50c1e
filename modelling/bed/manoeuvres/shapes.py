"""Shapes of a torque over time, by name, as drivability is tested."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from modelling.common.errors import InputError

UNITS = {
    "amplitude": "N*m", "offset": "N*m", "creep": "N*m", "at": "s", "rise_time": "s", "duration": "s",
    "hold": "s", "first_frequency": "Hz", "last_frequency": "Hz",
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Manoeuvre:
    """A torque over time.

    Attributes
    ----------
    amplitude : float
        N·m, by which the torque changes.
    offset : float
        N·m, before it begins.
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
            if not math.isfinite(value):
                raise InputError(entry.name, "is not finite", "write a finite number")
            if entry.name not in ("amplitude", "offset", "creep") and value < 0:
                raise InputError(entry.name, f"{value:g} is not possible", "0 or more is needed")
        if self.duration <= self.at:
            raise InputError(
                "duration", f"{self.duration:g} s ends before it begins at {self.at:g} s", "make it longer"
            )

    def torque(self, time: np.ndarray) -> np.ndarray:
        """Torque (t,) in N·m at times (t,) in s."""
        return self.offset + self.amplitude * self.shape(np.asarray(time, dtype=float) - self.at)

    def shape(self, since: np.ndarray) -> np.ndarray:
        """Share of the amplitude (t,) at times since the beginning (t,), s."""
        raise NotImplementedError

    @property
    def end(self) -> float:
        """Torque at its end, N·m."""
        return float(self.torque(np.array([self.duration]))[0])

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
