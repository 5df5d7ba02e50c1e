"""The local quadratic model of χ² and its minimum within bounds: the linear problem of one Gauss–Newton step."""

from __future__ import annotations

import numpy as np
import scipy
from scipy.linalg import solve_triangular

RIDGE, RIDGE_OF_FACTOR = 1e-10, 1e-9  # added to the scaled normal equations, whose diagonal is 1: rounding only
BOUND_MARGIN = 1e-12  # scaled; SciPy's solver asks for a start strictly inside the bounds


class Quadratic:
    """Normal equations of a Jacobian (r, v), its columns scaled to length 1.

    The step minimises |r + J·step|² within bounds; SciPy's bounded-variable least squares (Stark and Parker 1995)
    solves it where the unbounded minimum is outside.
    """

    def __init__(self, jacobian: np.ndarray):
        products = jacobian.T @ jacobian
        lengths = np.sqrt(np.diag(products))
        self.moves = lengths > 0  # variables without influence stay where they are
        self.scale = np.where(self.moves, lengths, 1.0)
        scaled = np.where(np.outer(self.moves, self.moves), products / np.outer(self.scale, self.scale), 0.0)
        self.hessian = scaled + RIDGE * np.eye(len(scaled))
        self.factor = np.linalg.cholesky(self.hessian + RIDGE_OF_FACTOR * np.eye(len(scaled)))

    def length(self, step: np.ndarray) -> float:
        """How far a step (v,) moves the residual, in times the noise."""
        return float(np.linalg.norm(self.factor.T @ np.where(self.moves, step * self.scale, 0.0)))

    def step(self, gradient: np.ndarray, low: np.ndarray, high: np.ndarray, radius: float) -> tuple[np.ndarray, float]:
        """Step (v,) within bounds (v,) and radius, and the decrease of χ² that it promises.

        Parameters
        ----------
        gradient : ndarray (v,)
            Jᵀr.
        low, high : ndarray (v,)
            Bounds of the step.
        radius : float
            Largest length of the step, see :meth:`length`.
        """
        g = np.where(self.moves, gradient / self.scale, 0.0)
        target = solve_triangular(self.factor, -g, lower=True)
        z = solve_triangular(self.factor.T, target)
        z_low, z_high = low * self.scale, high * self.scale
        if np.any(z < z_low) or np.any(z > z_high):
            bounds = (np.minimum(z_low, -BOUND_MARGIN), np.maximum(z_high, BOUND_MARGIN))
            z = scipy.optimize.lsq_linear(self.factor.T, target, bounds, method="bvls").x
        z = np.where(self.moves, z, 0.0)
        length = float(np.linalg.norm(self.factor.T @ z))
        if length > radius:
            z *= radius / length
        return z / self.scale, float(-2 * g @ z - z @ self.hessian @ z)
