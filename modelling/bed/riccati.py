"""Stabilising solutions of discrete Riccati equations, for feedback, feed-forward and filter alike."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_discrete_are

from modelling.common.errors import InputError


def riccati(
    A: np.ndarray, B: np.ndarray, Q: np.ndarray, R: np.ndarray, S: np.ndarray | None = None, *, what: str
) -> np.ndarray:
    """The stabilising solution (x, x) of the equation for A, Q (x, x), B, S (x, u) and R (u, u).

    Parameters
    ----------
    what : str
        What it is for, as the error names it.

    Raises
    ------
    InputError
        If there is none.
    """
    try:
        return solve_discrete_are(A, B, Q, R, s=S)
    except (np.linalg.LinAlgError, ValueError) as fault:
        raise InputError(
            "loop",
            f"there is no stable {what} ({fault})",
            "check that each dynamometer reaches its cut and what the sensors see",
        ) from None
