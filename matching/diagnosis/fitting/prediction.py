"""How well a fit predicts held-out data, given how well it knows its own variables.

A free simulation carries on what a fit left uncertain: a speed that drifts because a drag is known to a tenth says
nothing against the cause. So the held-out residual e is judged as what it is under the fit: normal with the covariance
c·1 + J Σ Jᵀ, Σ that of the variables and c the variance of the noise (Laplace approximation of the predictive density,
e.g. Bishop, Pattern Recognition and Machine Learning, 2006, section 4.5.2). A kind that contains another as a special
case then predicts as well as that one, not better, where the data do not distinguish them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from matching.diagnosis.fitting.finite_differences import jacobian
from matching.diagnosis.fitting.fit import Fit
from matching.diagnosis.fitting.holdout import HoldoutRun
from matching.diagnosis.fitting.polish import difference_steps
from matching.diagnosis.fitting.uncertainty import covariance


@dataclass(frozen=True)
class Prediction:
    """Least squares of held-out data over the variables of a fit, whitened by their covariance.

    Attributes
    ----------
    square : float
        |e|², the sum of squares of the residual e in times the noise.
    gram : ndarray (v, v)
        AᵀA of the derivatives A = J Σ½.
    projection : ndarray (v,)
        Aᵀe.
    updated : list of ndarray (t, y)
        The residual after the variables have adapted to it within their covariance.
    """

    square: float
    gram: np.ndarray
    projection: np.ndarray
    updated: list[np.ndarray]

    def score(self, variance: float) -> float:
        """−2 ln of the predictive density but for a constant, for noise of that variance (in times the stated one).

        eᵀ(c·1 + AAᵀ)⁻¹e + ln det(1 + AAᵀ/c), by Woodbury's identity in the variables instead of the samples.
        """
        inner = np.eye(len(self.gram)) + self.gram / variance
        scaled = self.projection / variance
        return float(self.square / variance - scaled @ np.linalg.solve(inner, scaled) + np.linalg.slogdet(inner)[1])


def prediction(fit: Fit, runs: Sequence[HoldoutRun], factor: float = 1.0) -> Prediction | None:
    """What a fit predicts of held-out data; None where that does not simulate.

    Parameters
    ----------
    runs : sequence of HoldoutRun
        Simulations of those data with the fit.
    factor : float
        Of the covariance of the fit, see :func:`matching.diagnosis.fitting.uncertainty.covariance`.
    """
    half = _square_root(covariance(fit, factor))
    whitened = [_whitened(fit, run, half) for run in runs]
    if not all(np.isfinite(part).all() for pair in whitened for part in pair):
        return None
    square = sum(float(e @ e) for _, e in whitened)
    gram = sum((A.T @ A for A, _ in whitened), np.zeros((half.shape[1],) * 2))
    projection = sum((A.T @ e for A, e in whitened), np.zeros(half.shape[1]))
    step = np.linalg.solve(np.eye(len(gram)) + gram, projection)
    updated = []
    for run, (A, e) in zip(runs, whitened, strict=True):
        residual = np.zeros(len(run.residual))
        residual[run.mask()] = e - A @ step
        updated += run.parts(residual)
    return Prediction(square, gram, projection, updated)


def _whitened(fit: Fit, run: HoldoutRun, half: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives A (r, v) by whitened variables of the fit, and residual e (r,), of held-out readings.

    Start states that were fitted to these data have taken their share of both already.
    """
    problem, mask = run.problem, run.mask()
    steps = _difference_steps(fit, problem.size, run.continued)
    derivatives = jacobian(problem, run.v, run.residual, largest_central=steps)[mask]
    residual = run.residual[mask]
    if run.continued:
        return derivatives @ half, residual
    k = len(problem.free)
    A = derivatives[:, :k] @ half[:k]
    starts = np.linalg.qr(derivatives[:, k:])[0]
    return A - starts @ (starts.T @ A), residual - starts @ (starts.T @ residual)


def _difference_steps(fit: Fit, size: int, continued: bool) -> np.ndarray:
    """(v,) steps of the differences: those of the fit; of other start states, the smallest over the fit's segments."""
    steps, k = difference_steps(fit), len(fit.problem.free)
    if continued:
        return steps
    states = len(fit.problem.free_states)
    starts = steps[k:].reshape(-1, states).min(axis=0)
    return np.concatenate([steps[:k], np.tile(starts, (size - k) // max(states, 1))])


def _square_root(covariance: np.ndarray) -> np.ndarray:
    """A square root (v, v) of a covariance; a variable without variance does not move."""
    sigma = np.sqrt(np.diag(covariance))
    safe = np.where(sigma > 0, sigma, 1.0)
    values, directions = np.linalg.eigh(covariance / np.outer(safe, safe))
    return sigma[:, None] * directions * np.sqrt(np.maximum(values, 0.0))
