"""Long signals for a screen: the least and the largest sample of every column of pixels, so that no peak is lost."""

from __future__ import annotations

import numpy as np


def envelope(time: np.ndarray, values: np.ndarray, low: float, high: float, columns: int) -> tuple[np.ndarray, ...]:
    """A signal between two times, decimated to two samples a column.

    Parameters
    ----------
    time : ndarray (t,)
        Rising, s.
    values : ndarray (t,)
        NaN where nothing was recorded.
    low, high : float
        s; one sample beyond each end is kept, so that the curve reaches the edges.
    columns : int

    Returns
    -------
    time, values : ndarray (k,)
        All samples where they are fewer than two a column, else the extremes in the order in which they occur.
    """
    first = max(int(np.searchsorted(time, low)) - 1, 0)
    last = min(int(np.searchsorted(time, high, side="right")) + 1, len(time))
    t, y = time[first:last], values[first:last]
    size = len(t) // columns
    if size <= 2:
        return t, y
    whole = size * columns
    blocks = y[:whole].reshape(columns, size)
    gaps = np.isnan(blocks)
    least = (np.where(gaps, np.inf, blocks) if gaps.any() else blocks).argmin(axis=1)
    largest = (np.where(gaps, -np.inf, blocks) if gaps.any() else blocks).argmax(axis=1)
    places = np.sort(np.stack([least, largest], axis=1) + size * np.arange(columns)[:, None], axis=1).ravel()
    places = np.concatenate([places, np.arange(whole, len(t))]) if whole < len(t) else places
    return t[places], y[places]
