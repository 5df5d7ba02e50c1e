"""A time window of long data in which causes are searched for: their kind shows in seconds, their size in all data."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from matching.diagnosis.data.segmentation import FEWEST_SAMPLES
from matching.diagnosis.data.segments import FitData, Segment
from matching.diagnosis.fitting.fit import Fit

MOST_READINGS = 150_000  # of all sensors, in a search: 37 s at 1 kHz and four sensors
WINDOWS_PER_LENGTH = 8  # windows that are compared begin this many times in the length of one


@dataclass(frozen=True)
class _SearchWindow:
    """Samples of a segment and the mean of their squared residuals (all sensors)."""

    square: float
    segment: int
    first: int
    last: int


def search_window(base: Fit) -> FitData | None:
    """The window of long data where a base fit is worst, of at most ``MOST_READINGS`` readings; None of short data.

    Where segments are shorter than that, the next worst windows are taken too.
    """
    data = base.problem.data
    if data.readings_count <= MOST_READINGS:
        return None
    readings_per_sample = data.readings_count / sum(len(segment.time) for segment in data.segments)
    left = int(MOST_READINGS / readings_per_sample)
    windows: list[_SearchWindow] = []
    residuals = dict(enumerate(base.by_sensor()))
    while residuals and left >= FEWEST_SAMPLES:
        worst = max((_worst_window(i, r, left) for i, r in residuals.items()), key=lambda window: window.square)
        del residuals[worst.segment]
        if worst.last - worst.first >= FEWEST_SAMPLES:
            windows.append(worst)
            left -= worst.last - worst.first
    windows.sort(key=lambda window: window.segment)
    return replace(data, segments=tuple(data.segments[w.segment].part(w.first, w.last) for w in windows))


def _worst_window(segment: int, residual: np.ndarray, most: int) -> _SearchWindow:
    """The window of at most so many samples with the largest mean square of a residual (t, y)."""
    length = min(len(residual), most)
    total = np.concatenate([[0.0], np.cumsum(np.sum(residual**2, axis=1))])
    last_start = len(residual) - length
    starts = np.unique(np.append(np.arange(0, last_start, max(length // WINDOWS_PER_LENGTH, 1)), last_start))
    squares = (total[starts + length] - total[starts]) / length
    worst = int(np.argmax(squares))
    return _SearchWindow(float(squares[worst]), segment, int(starts[worst]), int(starts[worst]) + length)


def first_readings(data: FitData) -> FitData:
    """The first ``MOST_READINGS`` readings of data, segment by segment."""
    left, sensors, parts = MOST_READINGS, max(len(data.noise), 1), list[Segment]()
    for segment in data.segments:
        count = min(len(segment.time), left // sensors)
        if count >= min(FEWEST_SAMPLES, len(segment.time)) and count:
            parts.append(segment.part(0, count))
            left -= count * sensors
    return replace(data, segments=tuple(parts))
