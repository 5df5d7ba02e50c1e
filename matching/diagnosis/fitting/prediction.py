"""How well a fit foretells data it never saw, given how well it knows its own variables.

A free simulation goes on with what a fit left uncertain: a speed that drifts away because a drag is known to a tenth
says nothing against the cause. So the residual e ahead is judged as what it is under the fit, normal with the
covariance c·1 + J Σ Jᵀ, Σ that of the variables and c the spread of the noise (the Laplace approximation of the
predictive density, e.g. Bishop, Pattern Recognition and Machine Learning, 2006, section 4.5.2). A kind that holds
another as a special case then foretells as well as that one, not better, where the data do not tell them apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from matching.diagnosis.fitting.fit import Fit
from matching.diagnosis.fitting.friction_regularisation import widths
from matching.diagnosis.fitting.holdout import Ahead
from matching.diagnosis.fitting.uncertainty import covariance


@dataclass(frozen=True)
class Prediction:
    """The least squares of unseen data over the variables of a fit, whitened by their covariance.

    Attributes
    ----------
    square : float
        Sum of squares of the residual e, in times the noise.
    gram : ndarray (v, v)
        AᵀA of the slopes A = J Σ½.
    along : ndarray (v,)
        Aᵀe.
    moved : list of ndarray (t, y)
        The residual once the variables have taken of it what they may.
    """

    square: float
    gram: np.ndarray
    along: np.ndarray
    moved: list[np.ndarray]

    def score(self, spread: float) -> float:
        """−2 ln of the predictive density, but for a constant: noise has the variance ``spread``.

        eᵀ(c·1 + AAᵀ)⁻¹e + ln det(1 + AAᵀ/c), written in the variables instead of the samples.
        """
        inner = np.eye(len(self.gram)) + self.gram / spread
        along = self.along / spread
        return float(self.square / spread - along @ np.linalg.solve(inner, along) + np.linalg.slogdet(inner)[1])


def prediction(fit: Fit, ahead: Sequence[Ahead], factor: float = 1.0) -> Prediction | None:
    """What a fit foretells of data it did not see; None where that does not simulate.

    Parameters
    ----------
    ahead : sequence of Ahead
        Simulations of those data.
    factor : float
        Of the covariance of the fit: its own spread.
    """
    half = _half(covariance(fit, factor))
    parts = [_whitened(fit, one, half) for one in ahead]
    slopes, residuals = [own[0] for own in parts], [own[1] for own in parts]
    if not all(np.isfinite(own).all() for own in (*slopes, *residuals)):
        return None
    square = sum(float(own @ own) for own in residuals)
    gram = sum((own.T @ own for own in slopes), np.zeros((half.shape[1],) * 2))
    along = sum((A.T @ e for A, e in zip(slopes, residuals, strict=True)), np.zeros(half.shape[1]))
    step = np.linalg.solve(np.eye(len(gram)) + gram, along)
    moved = []
    for one, A, e in zip(ahead, slopes, residuals, strict=True):
        own = np.zeros(len(one.residual))
        own[one.mask()] = e - A @ step
        moved += one.parts(own)
    return Prediction(square, gram, along, moved)


def _whitened(fit: Fit, one: Ahead, half: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slopes (r, v) by whitened variables of the fit, and residual (r,), of unseen samples.

    Start states that were found on these data have taken their share of both already.
    """
    problem, mask = one.problem, one.mask()
    jacobian = problem.jacobian(one.v, one.residual, central=_steps(fit, problem.size, one.carried))[mask]
    residual = one.residual[mask]
    if one.carried:
        return jacobian @ half, residual
    known = len(problem.free)
    slopes = jacobian[:, :known] @ half[:known]
    starts = np.linalg.qr(jacobian[:, known:])[0]
    return slopes - starts @ (starts.T @ slopes), residual - starts @ (starts.T @ residual)


def _steps(fit: Fit, size: int, carried: bool) -> np.ndarray:
    """(v,) steps of the differences: as for the fit; those of other start states as its widest, each state's own."""
    own, known = widths(fit), len(fit.problem.free)
    if carried:
        return own
    states = (len(own) - known) // len(fit.problem.data.segments)
    starts = own[known:].reshape(-1, states).min(axis=0)
    return np.concatenate([own[:known], np.tile(starts, (size - known) // max(states, 1))])


def _half(covariance: np.ndarray) -> np.ndarray:
    """A factor (v, v) of a covariance; a variable that has none does not move."""
    scale = np.sqrt(np.diag(covariance))
    safe = np.where(scale > 0, scale, 1.0)
    values, directions = np.linalg.eigh(covariance / np.outer(safe, safe))
    return scale[:, None] * directions * np.sqrt(np.maximum(values, 0.0))
