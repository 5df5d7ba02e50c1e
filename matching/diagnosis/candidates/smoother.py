"""A stationary Kalman smoother: states and unknown inputs of a linear system from noisy readings.

Forward filter and backward smoother (Rauch, Tung and Striebel, AIAA Journal 3, 1965) with the constant gains of the
stationary covariance, which SciPy finds from the discrete algebraic Riccati equation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_discrete_are


@dataclass(frozen=True)
class StationarySmoother:
    """Gains of x[k+1] = F·x[k] + w, y[k] = H·x[k] + v with covariances Q of w and R of v.

    Attributes
    ----------
    F : ndarray (x, x)
    H : ndarray (y, x)
    gain : ndarray (x, y)
        K of the filter.
    smoother_gain : ndarray (x, x)
        S of the smoother.
    """

    F: np.ndarray
    H: np.ndarray
    gain: np.ndarray
    smoother_gain: np.ndarray

    def smooth(self, y: np.ndarray) -> np.ndarray:
        """Readings (t, y) → states (t, x), beginning at rest."""
        keep = (np.eye(len(self.F)) - self.gain @ self.H) @ self.F
        driven = y @ self.gain.T
        states = np.empty((len(y), len(self.F)))
        x = np.zeros(len(self.F))
        for k, correction in enumerate(driven):
            x = keep @ x + correction
            states[k] = x
        anchored = states @ (np.eye(len(self.F)) - self.smoother_gain @ self.F).T
        for k in range(len(y) - 2, -1, -1):
            x = anchored[k] + self.smoother_gain @ x
            states[k] = x
        return states


def stationary_smoother(F: np.ndarray, H: np.ndarray, Q: np.ndarray, R: np.ndarray) -> StationarySmoother:
    """Constant gains of filter and smoother.

    Readings are scaled to unit noise first, so that the Riccati equation is well conditioned.

    Parameters
    ----------
    F, H : ndarray (x, x), (y, x)
        State from sample to sample, and readings of a state.
    Q : ndarray (x, x)
        Covariance of what enters the state within a sample.
    R : ndarray (y,)
        Variances of the readings.

    Raises
    ------
    numpy.linalg.LinAlgError
        If a growing state cannot be observed, so that there is no stationary covariance.
    """
    sigma = np.sqrt(R)
    scaled = H / sigma[:, None]
    unit = np.eye(len(R))
    predicted = solve_discrete_are(F.T, scaled.T, Q, unit)
    gain = np.linalg.solve(scaled @ predicted @ scaled.T + unit, scaled @ predicted).T
    filtered = predicted - gain @ scaled @ predicted
    smoother_gain = np.linalg.solve(predicted, F @ filtered).T
    return StationarySmoother(F, H, gain / sigma, smoother_gain)
