"""How well a fit knows its parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from matching.diagnosis.fitting.fit import Fit
from matching.diagnosis.fitting.statistics import effective_share

NARROWED = 0.5  # of the uniform distribution's: a larger standard uncertainty is the range's own


@dataclass(frozen=True)
class Estimate:
    """A fitted parameter; ``note`` says if the data do not tell it, or a bound holds it."""

    value: float
    standard_uncertainty: float
    note: str = ""


def inflation(fit: Fit) -> float:
    """Factor (≥ 1) of the covariance where the residual is larger than the noise or not white, the worst sensor's.

    The variance of a mean of correlated values is larger by the number of samples over the effective number of samples.
    """
    worst = 1.0
    residuals = fit.by_sensor()
    for j in range(len(fit.problem.data.noise)):
        own = [r[s.counts[:, j], j] for r, s in zip(residuals, fit.problem.data.segments, strict=True)]
        total = np.concatenate(own)
        if len(total) < 64:
            continue
        square = float(np.mean(total**2))
        if square > 1 + 5 * np.sqrt(2 / len(total)):
            worst = max(worst, square / effective_share(max(own, key=len)))
    return worst


def estimates(fit: Fit, shift: np.ndarray | None = None) -> dict[str, Estimate]:
    """Values and standard uncertainties of the free parameters, from the Jacobian at the end.

    A range is knowledge: it enters as the variance of a uniform distribution over it, a third of its width squared
    for a parameter at a bound, which then is as uncertain for the others as it is itself.

    Parameters
    ----------
    shift : ndarray (v,), optional
        What finer steps of the integration change (:func:`discretisation`); added in quadrature.
    """
    problem, v = fit.problem, fit.v
    width, at_bound = _ranges(fit)
    sigma = np.sqrt(np.diag(covariance(fit, inflation(fit))))
    out = {}
    for i, name in enumerate(problem.free):
        own, note = float(sigma[i]), ""
        uniform = float(width[i]) / np.sqrt(12) if np.isfinite(width[i]) else np.inf
        if own > NARROWED * uniform:
            own, note = min(own, uniform), "not identifiable: the data do not narrow its range"
        if at_bound[i]:
            note = f"at the bound of its range{'; ' * bool(note)}{note}"
        if shift is not None:
            own = float(np.hypot(own, shift[i]))
        out[name] = Estimate(float(v[i]), own, note)
    return out


def covariance(fit: Fit, factor: float = 1.0) -> np.ndarray:
    """Covariance (v, v) of the variables: information of the data, divided by ``factor``, and of the ranges.

    By singular values of the Jacobian itself: directions that only the ranges tell must not be lost to rounding.
    Variables without any influence on the readings have the variance 0 where nothing bounds them.
    """
    width, at_bound = _ranges(fit)
    prior = np.where(np.isfinite(width), np.sqrt(np.where(at_bound, 3.0, 12.0)) / np.maximum(width, 1e-300), 0.0)
    rows = np.linalg.qr(fit.jacobian, mode="r") / np.sqrt(factor)
    rows = np.vstack([rows, np.diag(prior)])
    scale = np.linalg.norm(rows, axis=0)
    scale[scale == 0] = np.inf
    _, values, directions = np.linalg.svd(rows / scale, full_matrices=False)
    keep = values > 1e-10 * values.max(initial=0.0)
    half = directions[keep].T / values[keep] / scale[:, None]
    return half @ half.T


def discretisation(fit: Fit) -> np.ndarray:
    """How far the variables (v,) move, to first order, when the integration takes half its steps."""
    problem = fit.problem
    half = replace(problem, steps=2 * problem.steps, stick=problem.stick / 2)
    residual = half.residuals(fit.v[None])[0]
    if not np.isfinite(residual).all():
        return np.zeros(problem.size)
    return covariance(fit) @ (fit.jacobian.T @ (residual - fit.residual))


def _ranges(fit: Fit) -> tuple[np.ndarray, np.ndarray]:
    """Widths (v,) of the ranges, infinite without one, and whether a variable is at an end of it."""
    problem, v = fit.problem, fit.v
    width = problem.upper - problem.lower
    near = 1e-6 * np.where(np.isfinite(width), width, np.abs(v) + 1e-9)
    return width, (v - problem.lower < near) | (problem.upper - v < near)
