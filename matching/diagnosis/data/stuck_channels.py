"""Channels that keep one value: the sensor hangs, or is at the end of its range."""

from __future__ import annotations

import numpy as np

LONGEST_CONSTANT = 0.05  # s that a sensor may show the same value
FEWEST_EQUAL = 8  # equal values one after another before a channel counts as stuck
COARSE_SHARE = 0.5  # of values equal to the one before: the resolution is coarse or the motion slow, nothing is stuck


def remove_stuck_values(values: np.ndarray, time: np.ndarray, name: str) -> tuple[np.ndarray, list[str]]:
    """A channel with NaN where it is stuck, and a note on each of these times.

    Parameters
    ----------
    values, time : ndarray (t,)
        Of the channel, and in s.
    name : str
        The sensor, for the notes.
    """
    cleaned, notes = values.copy(), []
    measured = values[np.isfinite(values)]
    if len(measured) > 1 and np.mean(np.diff(measured) == 0) > COARSE_SHARE:
        return cleaned, []
    low, high = np.nanmin(values, initial=np.inf), np.nanmax(values, initial=-np.inf)
    equals_next = np.concatenate([[False], np.diff(values) == 0, [False]])
    edges = np.flatnonzero(np.diff(equals_next.astype(int)))
    shortest = min(LONGEST_CONSTANT, 0.1 * float(np.ptp(time)))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        if last - first >= FEWEST_EQUAL and time[last] - time[first] >= shortest:
            where = "at the end of its range" if values[first] in (low, high) else "stuck"
            notes.append(f"{name} is {where} from {time[first]:g} to {time[last]:g} s; left out")
            cleaned[first : last + 1] = np.nan
    return cleaned, notes
