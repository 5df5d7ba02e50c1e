"""Long curves by fewer points, for figures: more than the eye can tell apart only make files large."""

from __future__ import annotations

import numpy as np

MOST_POINTS = 2000  # of a curve; of longer ones the least and the largest value of every part are kept


def decimated(x: np.ndarray, y: np.ndarray, most: int = MOST_POINTS) -> tuple[np.ndarray, np.ndarray]:
    """A curve (t,) by at most so many points: of every part its least and its largest value, in their order."""
    if len(x) <= most:
        return x, y
    edges = np.linspace(0, len(x), most // 2 + 1).astype(int)
    begins, ends = edges[:-1, None], edges[1:, None]
    at = begins + np.arange((ends - begins).max())
    values = np.where(at < ends, y[np.minimum(at, len(y) - 1)], np.nan)
    missing = np.isnan(values)
    least, largest = np.where(missing, np.inf, values).argmin(axis=1), np.where(missing, -np.inf, values).argmax(axis=1)
    kept = np.unique(begins[:, 0] + np.stack([least, largest]))
    return x[kept], y[kept]
