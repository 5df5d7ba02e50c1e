"""Gaps of a recording, and the one rule for them.

A gap is a time without a value, whether rows are missing in the file or cells are empty, NaN or marked invalid.

- In an input, a gap of up to ``longest_bridge`` (0.1 s, or two sampling steps if that is more) is bridged by a straight
  line, and noted.
- A longer gap in an input divides the recording: the rows without the input are left out, and noted. A diagnosis takes
  the parts as separate recordings; a simulation and a fidelity refuse the recording.
- In a sensor, values that are missing are left out of every comparison; nothing is bridged.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

LONGEST_BRIDGE = 0.1  # s: a torque of drivability, below 30 Hz and sampled at 1 kHz, hardly changes its course in it
LONGEST_BRIDGE_STEPS = 2.0  # sampling steps, for slow recordings: one missing sample
REGULAR = 0.9  # of a slower channel's values that come as many rows after the one before
GAP_STEPS = 1.6  # sampling steps: a longer step of time is a gap


def longest_bridge(time: np.ndarray) -> float:
    """The longest gap in s between two values of a channel that a straight line bridges; time (t,) in s."""
    return max(LONGEST_BRIDGE, LONGEST_BRIDGE_STEPS * float(np.median(np.diff(time))) * (1 + 1e-6))


def long_gaps(time: np.ndarray) -> list[tuple[float, float]]:
    """Begin and end in s of the gaps in time (t,) that are too long to bridge."""
    index = np.flatnonzero(np.diff(time) > longest_bridge(time))
    return [(float(time[i]), float(time[i + 1])) for i in index]


def bridged(time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values (t,), not all NaN, at times (t,) in s with short gaps filled by straight lines.

    NaN stays in long gaps, before the first and after the last value.
    """
    known = np.flatnonzero(np.isfinite(values))
    filled = np.interp(time, time[known], values[known], left=np.nan, right=np.nan)
    longest = longest_bridge(time)
    for first, last in pairwise(known):
        if last > first + 1 and time[last] - time[first] > longest:
            filled[first + 1 : last] = np.nan
    return filled


def missing_note(name: str, time: np.ndarray, values: np.ndarray, treatment: str) -> str:
    """A note that values (t,) of a channel are missing, at what time (s) first, and what was done."""
    missing = ~np.isfinite(values)
    plural = "values are" if missing.sum() > 1 else "value is"
    return f"{name}: {missing.sum()} {plural} missing, first at {time[np.argmax(missing)]:g} s; {treatment}"


def rows_a_value(values: np.ndarray) -> int:
    """How many rows there are to a value (t,) of a channel that is sampled slower than the rows; 0 where it is not.

    It is where nearly every value (``REGULAR``) comes as many rows after the one before, give or take one.
    """
    apart = np.diff(np.flatnonzero(np.isfinite(values)))
    every = int(np.median(apart)) if len(apart) else 0
    return every if every > 1 and np.mean(np.abs(apart - every) <= 1) >= REGULAR else 0
