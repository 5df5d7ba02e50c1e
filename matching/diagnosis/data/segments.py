"""The data of a fit: segments of recordings with inputs and readings, and the noise of each sensor."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class Segment:
    """A part of a recording without gaps.

    Attributes
    ----------
    time : ndarray (t,)
        s, increasing, from the start of its recording.
    inputs : ndarray (t, u)
        SI, in the order of the model's inputs.
    readings : ndarray (t, y)
        SI, in the order of the model's sensors; NaN where nothing was measured.
    name : str
        The recording it is from.
    recording : int
        Its number, from 1.
    """

    time: np.ndarray
    inputs: np.ndarray
    readings: np.ndarray
    name: str = ""
    recording: int = 1

    @property
    def measured(self) -> np.ndarray:
        """(t, y) whether there is a reading."""
        return np.isfinite(self.readings)

    def part(self, first: int, last: int) -> Segment:
        """Samples first … last − 1."""
        samples = slice(first, last)
        return replace(self, time=self.time[samples], inputs=self.inputs[samples], readings=self.readings[samples])


@dataclass(frozen=True)
class FitData:
    """What a fit is given.

    Attributes
    ----------
    segments : tuple of Segment
    noise : ndarray (y,)
        Standard uncertainty of each sensor, SI; also the noise that a fit assumes.
    """

    segments: tuple[Segment, ...]
    noise: np.ndarray

    @property
    def readings_by_sensor(self) -> np.ndarray:
        """(y,) number of readings of each sensor."""
        return sum((segment.measured.sum(axis=0) for segment in self.segments), np.zeros(len(self.noise), dtype=int))

    @property
    def readings_count(self) -> int:
        """Number of readings of all sensors."""
        return int(self.readings_by_sensor.sum())

    @property
    def sampling_interval(self) -> float:
        """Median time between samples of the first segment, s."""
        return float(np.median(np.diff(self.segments[0].time)))
