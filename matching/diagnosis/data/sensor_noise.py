"""The noise of a sensor that states no uncertainty, estimated from the scatter of its readings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

MEDIAN_OF_NORMAL = 0.6745  # median of |x| for x normal with standard deviation 1
SMALLEST_SHARE = 1e-6  # of the largest reading: less is rounding
SMALLEST = 1e-12  # SI, for readings that are all 0


def noise_from_scatter(parts: Sequence[np.ndarray]) -> float:
    """Standard deviation of white noise on a smooth signal.

    The second difference of white noise has six times its variance; a smooth signal hardly adds to it at high
    sampling. The median of its magnitude ignores jumps.

    Parameters
    ----------
    parts : sequence of ndarray (t,)
        Readings without gaps; NaN where there is none.
    """
    second_difference = np.concatenate([np.diff(part, 2) for part in parts])
    second_difference = second_difference[np.isfinite(second_difference)]
    scatter = 0.0
    if len(second_difference):
        scatter = float(np.median(np.abs(second_difference))) / MEDIAN_OF_NORMAL / np.sqrt(6)
    largest = float(np.nanmax(np.abs(np.concatenate(parts)), initial=0.0))
    return max(scatter, SMALLEST_SHARE * largest, SMALLEST)
