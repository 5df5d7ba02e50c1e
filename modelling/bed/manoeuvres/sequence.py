"""Manoeuvres of several segments, and recorded torques."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from modelling.bed.manoeuvres.shapes import Manoeuvre


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

    def csv(self, name: str) -> str:
        """The record as a CSV file with the input's name."""
        rows = (f"{time!r},{torque!r}" for time, torque in zip(self.times, self.torques, strict=True))
        return "\n".join([f"time [s],{name} [N*m]", *rows, ""])
