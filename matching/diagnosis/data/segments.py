"""What a fit sees of recordings: segments of time with inputs, readings and which of them count."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class Segment:
    """An uninterrupted stretch of a recording.

    Attributes
    ----------
    time : ndarray (t,)
        s, increasing, from the start of its recording.
    inputs : ndarray (t, u)
    readings : ndarray (t, y)
        SI, in the order of the model's sensors; NaN where there is none.
    name : str
        Which recording it is from.
    """

    time: np.ndarray
    inputs: np.ndarray
    readings: np.ndarray
    name: str = ""

    @property
    def counts(self) -> np.ndarray:
        """(t, y) whether a reading is there."""
        return np.isfinite(self.readings)

    def part(self, first: int, last: int) -> Segment:
        """Samples first … last − 1."""
        cut = slice(first, last)
        return replace(self, time=self.time[cut], inputs=self.inputs[cut], readings=self.readings[cut])


@dataclass(frozen=True)
class Data:
    """Segments and the standard uncertainty of each sensor (y,), which is also the noise a fit assumes."""

    segments: tuple[Segment, ...]
    noise: np.ndarray

    @property
    def samples(self) -> np.ndarray:
        """(y,) number of readings of each sensor."""
        return sum((segment.counts.sum(axis=0) for segment in self.segments), np.zeros(len(self.noise), dtype=int))

    def without(self, seconds: float) -> Data:
        """The same data with the first seconds of every segment not counted."""
        if seconds <= 0:
            return self
        kept = []
        for segment in self.segments:
            readings = segment.readings.copy()
            readings[segment.time < segment.time[0] + seconds] = np.nan
            kept.append(replace(segment, readings=readings))
        return replace(self, segments=tuple(kept))
