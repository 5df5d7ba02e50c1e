"""A linear system from sample to sample, exactly: inputs that are held, and inputs that grow evenly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm


@dataclass(frozen=True)
class Discretised:
    """What one step does: x⁺ = transition·x + held·u + ramp·(u⁺ − u) for inputs that vary linearly over it.

    Attributes
    ----------
    transition : ndarray (x, x)
    held, ramp : ndarray (x, u)
        Of inputs at 1 all the time, and of inputs that grow evenly from 0 to 1.
    """

    transition: np.ndarray
    held: np.ndarray
    ramp: np.ndarray


def discretise(A: np.ndarray, B: np.ndarray, step: float) -> Discretised:
    """Exact solution of ẋ = A (x, x)·x + B (x, u)·u over a step, s, by one matrix exponential (Van Loan, 1978)."""
    n, m = B.shape
    block = np.zeros((n + 2 * m, n + 2 * m))
    block[:n, :n], block[:n, n : n + m], block[n : n + m, n + m :] = A * step, B * step, np.eye(m)
    over = expm(block)[:n]
    return Discretised(over[:, :n], over[:, n : n + m], over[:, n + m :])
