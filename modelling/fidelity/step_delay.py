"""The delay between two step responses: the time between their 50 % crossings."""

from __future__ import annotations

import math

import numpy as np

from modelling.fidelity.delay import Delay


def step_delay(time: np.ndarray, reference: np.ndarray, test: np.ndarray) -> Delay:
    """Delay by comparing step responses (t,): the time between the 50 % crossings of both; ``time`` in s.

    Levels are the medians of the first and last tenth. The standard uncertainty is that of a straight line through the
    samples between 30 % and 70 % of each step. Undetermined where a signal has no step that stands out of its noise.
    """
    crossings = [_half_rise(time, signal) for signal in (reference, test)]
    for name, crossing in zip(("reference", "test"), crossings, strict=True):
        if crossing is None:
            return Delay(None, None, f"the {name} signal has no step")
    (first, u), (second, v) = crossings  # type: ignore[misc]
    return Delay(second - first, math.hypot(u, v), "", second - first)


def _half_rise(time: np.ndarray, signal: np.ndarray) -> tuple[float, float] | None:
    tenth = max(3, len(signal) // 10)
    before, after = signal[:tenth], signal[-tenth:]
    low, high = float(np.median(before)), float(np.median(after))
    noise = max(float(np.std(before)), float(np.std(after)))
    if not abs(high - low) > 5 * noise:
        return None
    level = (signal - low) / (high - low)
    rises = np.flatnonzero((level[:-1] < 0.5) & (level[1:] >= 0.5))
    if not len(rises):
        return None
    at = int(rises[0])
    left = at - int(np.argmax(level[at::-1] < 0.3)) if np.any(level[at::-1] < 0.3) else 0
    right = at + 1 + int(np.argmax(level[at + 1 :] > 0.7)) if np.any(level[at + 1 :] > 0.7) else len(level) - 1
    place, step = slice(left, right + 1), float(time[at + 1] - time[at])
    if right - left < 4:  # too steep for a line: interpolate, and the noise moves the crossing by noise over slope
        rise = level[at + 1] - level[at]
        crossing = float(time[at]) + step * (0.5 - level[at]) / rise
        return crossing, max(noise / abs(high - low) / rise * step, 1e-15)
    x, y = level[place], time[place]
    slope, offset = np.polyfit(y - y.mean(), x, 1)
    spread = float(np.std(x - slope * (y - y.mean()) - offset)) / math.sqrt(len(x))
    return float(y.mean() + (0.5 - offset) / slope), spread / abs(slope)
