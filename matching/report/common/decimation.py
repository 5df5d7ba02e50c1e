"""Long curves by fewer points, for figures: more than the eye can tell apart only make files large."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

MOST_POINTS = 2000  # of a curve; of longer ones the least and the largest value of every part are kept


def decimated(x: np.ndarray, y: np.ndarray, most: int = MOST_POINTS) -> tuple[np.ndarray, np.ndarray]:
    """A curve (t,) by at most so many points: of every part its least and its largest value, in their order."""
    if len(x) <= most:
        return x, y
    edges = np.linspace(0, len(x), most // 2 + 1).astype(int)
    kept = []
    for begin, end in pairwise(edges):
        part = y[begin:end]
        if np.isnan(part).all():
            kept += [begin]
        else:
            kept += sorted({begin + int(np.nanargmin(part)), begin + int(np.nanargmax(part))})
    return x[kept], y[kept]
