"""How well a fit knows its parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from matching.diagnosis.fitting.fit import Fit
from matching.diagnosis.fitting.residual_statistics import effective_share

NOT_IDENTIFIABLE = 0.5  # of the uniform distribution's: a larger standard uncertainty is that of the range
FEWEST_READINGS = 64  # of a sensor whose residual is tested
TEST_SIGMA = 5.0  # standard deviations of the mean square beyond which a residual is more than noise
AT_BOUND_SHARE = 1e-6  # of the width of the range
SMALLEST_SINGULAR = 1e-10  # of the largest singular value; less is rounding


@dataclass(frozen=True)
class Estimate:
    """A fitted parameter, SI; ``note`` says if the data do not identify it, or a bound holds it."""

    value: float
    standard_uncertainty: float
    note: str = ""


def inflation(fit: Fit) -> float:
    """Factor (≥ 1) of the covariance where the residual is larger than the noise or not white: the worst sensor's.

    The variance of a mean of correlated values is larger by the number of samples over the number of independent ones.
    """
    worst = 1.0
    segments = fit.problem.data.segments
    for j in range(len(fit.problem.data.noise)):
        parts = [r[segment.measured[:, j], j] for r, segment in zip(fit.by_sensor(), segments, strict=True)]
        count = sum(len(part) for part in parts)
        if count < FEWEST_READINGS:
            continue
        mean_square = float(np.mean(np.concatenate(parts) ** 2))
        if mean_square > 1 + TEST_SIGMA * np.sqrt(2 / count):
            worst = max(worst, mean_square / effective_share(max(parts, key=len)))
    return worst


def estimates(
    fit: Fit, shift: np.ndarray | None = None, least: Mapping[str, float] | None = None
) -> dict[str, Estimate]:
    """Values and standard uncertainties of the free parameters, from the Jacobian at the end.

    Parameters
    ----------
    shift : ndarray (v,), optional
        How finer steps of the integration move the variables (:func:`discretisation_shift`); added in quadrature.
    least : dict of str to float, optional
        Standard uncertainties that are at least so large, SI by name.
    """
    width, at_bound = _ranges(fit)
    sigma = np.sqrt(np.diag(covariance(fit, inflation(fit))))
    out = {}
    for i, name in enumerate(fit.problem.free):
        uncertainty, notes = max(float(sigma[i]), (least or {}).get(name, 0.0)), []
        uniform = float(width[i]) / np.sqrt(12)
        if at_bound[i]:
            notes.append("at the bound of its range")
        if uncertainty > NOT_IDENTIFIABLE * uniform:
            uncertainty = min(uncertainty, uniform)
            notes.append("not identifiable: the data do not narrow its range")
        if shift is not None:
            uncertainty = float(np.hypot(uncertainty, shift[i]))
        if uncertainty == 0.0:
            uncertainty = np.inf
            notes.append("unknown: no reading depends on it")
        out[name] = Estimate(float(fit.v[i]), uncertainty, "; ".join(notes))
    return out


def at_least(estimates: Mapping[str, Estimate], uncertainties: Mapping[str, float]) -> dict[str, Estimate]:
    """Estimates no more certain than others have them."""
    return {
        name: replace(estimate, standard_uncertainty=max(estimate.standard_uncertainty, uncertainties.get(name, 0.0)))
        for name, estimate in estimates.items()
    }


def covariance(fit: Fit, factor: float = 1.0) -> np.ndarray:
    """Covariance (v, v) of the variables: (JᵀJ/factor + P)⁻¹ with the information P of the ranges.

    A range is knowledge: it enters as a uniform distribution over its width w, variance w²/12; for a parameter at a
    bound w²/3, the mean square distance from that bound, so that it is as uncertain for the others as for itself.

    By singular values of the Jacobian itself: directions known only from the ranges must not be lost to rounding.
    Variables without any influence on the readings have the variance 0 where nothing bounds them.
    """
    width, at_bound = _ranges(fit)
    prior = np.where(np.isfinite(width), np.sqrt(np.where(at_bound, 3.0, 12.0)) / np.maximum(width, 1e-300), 0.0)
    rows = np.linalg.qr(fit.jacobian, mode="r") / np.sqrt(factor)
    rows = np.vstack([rows, np.diag(prior)])
    scale = np.linalg.norm(rows, axis=0)
    scale[scale == 0] = np.inf
    _, values, directions = np.linalg.svd(rows / scale, full_matrices=False)
    keep = values > SMALLEST_SINGULAR * values.max(initial=0.0)
    half = directions[keep].T / values[keep] / scale[:, None]
    return half @ half.T


def discretisation_shift(fit: Fit) -> np.ndarray:
    """How far the variables (v,) move, to first order, when the integration takes steps half as long."""
    problem = fit.problem
    half = replace(problem, steps_per_second=2 * problem.steps_per_second, stick_speed=problem.stick_speed / 2)
    residual = half.residuals(fit.v[None])[0]
    if not np.isfinite(residual).all():
        return np.zeros(problem.size)
    return -covariance(fit) @ (fit.jacobian.T @ (residual - fit.residual))


def _ranges(fit: Fit) -> tuple[np.ndarray, np.ndarray]:
    """Widths (v,) of the ranges, infinite without one, and whether a variable is at an end of it."""
    problem, v = fit.problem, fit.v
    width = problem.upper - problem.lower
    near = AT_BOUND_SHARE * np.where(np.isfinite(width), width, np.abs(v) + 1e-9)
    return width, (v - problem.lower < near) | (problem.upper - v < near)
