"""How well a fit knows its parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from matching.diagnosis.fit import Fit
from matching.diagnosis.statistics import effective_share


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


def estimates(fit: Fit, coarse: Fit | None = None) -> dict[str, Estimate]:
    """Values and standard uncertainties of the free parameters, from the Jacobian at the end.

    Bounds act as they are: a parameter at its bound is held there for the others; its own uncertainty is what the bound
    leaves. With a fit of coarser steps, half of what the steps change is added in quadrature.
    """
    problem, v = fit.problem, fit.v
    scale = np.linalg.norm(fit.jacobian, axis=0)
    k = len(problem.free)
    width = problem.upper - problem.lower
    near = 1e-6 * np.where(np.isfinite(width), width, np.abs(v) + 1.0)
    at_bound = (v - problem.lower < near) | (problem.upper - v < near)
    used = np.flatnonzero((scale > 0) & ~at_bound)
    unit = fit.jacobian[:, used] / scale[used]
    covariance = np.linalg.pinv(unit.T @ unit, rcond=1e-12, hermitian=True) * inflation(fit)
    sigma = np.full(problem.size, np.inf)
    sigma[used] = np.sqrt(np.maximum(np.diag(covariance), 0.0)) / scale[used]
    out = {}
    for i in range(k):
        name, own, note = problem.free[i], float(sigma[i]), ""
        uniform = float(width[i]) / np.sqrt(12) if np.isfinite(width[i]) else np.inf
        if at_bound[i]:
            own, note = _alone(fit, i), "at the bound of its range"
        if own > 0.6 * uniform:
            own, note = min(own, uniform), "not identifiable: the data do not narrow its range"
        if coarse is not None and name in coarse.values:
            own = float(np.hypot(own, 0.5 * (float(v[i]) - coarse.values[name])))
        out[name] = Estimate(float(v[i]), own, note)
    return out


def _alone(fit: Fit, i: int) -> float:
    length = float(np.linalg.norm(fit.jacobian[:, i]))
    width = float(fit.problem.upper[i] - fit.problem.lower[i])
    uniform = width / np.sqrt(12) if np.isfinite(width) else np.inf
    return min(1 / length if length > 0 else np.inf, uniform)
