"""A true delay line: commands issued at every sample, held, acting a dead time later."""

from __future__ import annotations

import numpy as np


def arrivals(delay: float, step: float, pieces: int) -> np.ndarray:
    """Which commands act when: weights (m, i) of the command issued i samples ago in the m-th piece of a sample.

    A sample of length ``step`` (s) is cut into equal ``pieces``; where a new command arrives inside a piece, both
    count by their share of it, so any ``delay`` (s) is met.
    """
    edges = (np.arange(pieces + 1) / pieces) - delay / step
    weights = np.zeros((pieces, int(np.ceil(delay / step - 1e-12)) + 1))
    for i in range(weights.shape[1]):
        # the command of i samples ago is held over [−i, 1 − i) of its own time
        inside = np.clip(edges, -i, 1 - i)
        weights[:, i] = np.diff(inside) * pieces
    return weights
