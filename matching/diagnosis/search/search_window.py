"""A stretch of long data on which causes are sought: what they are shows in seconds, how large they are in all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from matching.diagnosis.data.preparation import SHORTEST
from matching.diagnosis.data.segments import Data, Segment
from matching.diagnosis.fitting.fit import Fit

LONG = 150_000  # readings of all sensors beyond which a search looks at a stretch
STRIDE = 8  # windows that are looked at begin this many times in the length of one


def stretch(base: Fit) -> Data | None:
    """The stretch of long data where a base fit is furthest off, of at most ``LONG`` readings; None of short data.

    Where segments are shorter than that, the next worst are taken beside it.
    """
    data = base.problem.data
    every = int(data.samples.sum())
    if every <= LONG:
        return None
    each = every / sum(len(segment.time) for segment in data.segments)  # readings a sample
    left, parts = int(LONG / each), []
    residuals = dict(enumerate(base.by_sensor()))
    while residuals and left >= SHORTEST:
        worst: tuple[float, int, int, int] = (-1.0, 0, 0, 0)
        for i, own in residuals.items():
            length = min(len(own), left)
            total = np.concatenate([[0.0], np.cumsum(np.sum(own**2, axis=1))])
            begins = np.unique(np.append(np.arange(0, len(own) - length, max(length // STRIDE, 1)), len(own) - length))
            squares = (total[begins + length] - total[begins]) / length
            k = int(np.argmax(squares))
            worst = max(worst, (float(squares[k]), i, int(begins[k]), length))
        _, i, first, length = worst
        del residuals[i]
        if length >= SHORTEST:
            parts.append((i, data.segments[i].part(first, first + length)))
            left -= length
    return replace(data, segments=tuple(part for _, part in sorted(parts, key=lambda one: one[0])))


def head(data: Data) -> Data:
    """The first ``LONG`` readings of data, by segments."""
    left, parts = LONG, list[Segment]()
    for segment in data.segments:
        count = min(len(segment.time), left // max(len(data.noise), 1))
        if count >= min(SHORTEST, len(segment.time)) and count:
            parts.append(segment.part(0, count))
            left -= count * len(data.noise)
    return replace(data, segments=tuple(parts))
