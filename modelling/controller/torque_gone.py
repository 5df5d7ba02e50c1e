"""When a flange torque counts as gone: a shaft broke, or a clutch at the flange opened."""

from __future__ import annotations

import numpy as np

REMEMBERED_SAMPLES = 3  # a torque gone within so many samples has gone at once
AVERAGED_SAMPLES = 3  # what a break leaves at the flange swings on about zero: the mean of so many samples shows it
KEPT_SAMPLES = 4  # torques kept: those of the mean but for the newest, and two before them
GONE = 0.2  # of the torque before: what is left of it counts as none


def has_gone(recent: np.ndarray, least: np.ndarray, left: float = GONE) -> np.ndarray:
    """Which flange torques are gone.

    Parameters
    ----------
    recent : ndarray (KEPT_SAMPLES + 1, …, k)
        Torques in N·m, the newest first.
    least : ndarray (k,)
        N·m: torques that were not larger are not judged.
    left : float
        Share of the torque before that counts as none.

    Returns
    -------
    ndarray of bool (…, k)
    """
    size = np.abs(recent)
    before = size[1 : 1 + REMEMBERED_SAMPLES].max(axis=0)
    at_once = (before > least) & (size[0] < left * before)
    earlier = size[AVERAGED_SAMPLES:].max(axis=0)
    about_zero = (earlier > least) & (np.abs(recent[:AVERAGED_SAMPLES].mean(axis=0)) < left * earlier)
    return at_once | about_zero
