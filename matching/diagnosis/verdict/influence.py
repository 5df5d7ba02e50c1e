"""How uncertain parameters are where the residual is no white noise of the stated size: model error that is left over.

A fit moves a parameter by the sum over time of the influence of each sample: the residuals of all sensors at that time,
weighted by the covariance and the Jacobian. For white noise the squares of these add up to the covariance. What a model
leaves is correlated over time and over sensors (an angle and the speed beside it err together), so the variance of the
sum is that of correlated values: the sum of squares times their integrated autocorrelation time (sandwich covariance;
White, Econometrica 50, 1982, and for dependent data Newey and West, Econometrica 55, 1987).

An error that is the same all along shows in no scatter. Weighted with a memory, which looks at fast changes, and
without it, which looks at slow ones, a right model has the same parameters but for noise; what they differ by is what
the model's error does to them (Hausman, Econometrica 46, 1978).
"""

from __future__ import annotations

import numpy as np

from matching.diagnosis.fitting.fit import Fit
from matching.diagnosis.fitting.quadratic import Quadratic
from matching.diagnosis.fitting.residual_statistics import effective_share
from matching.diagnosis.fitting.reweighting import discrepancy, reweighted
from matching.diagnosis.fitting.uncertainty import covariance


def influences(fit: Fit) -> np.ndarray:
    """(t, p) by how much the readings of each time moved each fitted parameter, SI; segments one after another."""
    count = len(fit.problem.free)
    weights = fit.jacobian @ covariance(fit)[:, :count]
    weights *= fit.residual[:, None]
    sensors = len(fit.problem.data.noise)
    return weights.reshape(-1, sensors, count).sum(axis=1)


def correlated_uncertainties(fit: Fit) -> dict[str, float]:
    """Standard uncertainties of the fitted parameters by the scatter of what the samples ask for, SI by name."""
    shift = shift_by_memory(fit)
    out = {}
    for name, influence, moved in zip(fit.problem.free, influences(fit).T, shift, strict=False):
        square = float(influence @ influence)
        scatter = float(np.sqrt(square / effective_share(influence))) if square > 0 else 0.0
        out[name] = max(scatter, abs(float(moved)) / np.sqrt(3))  # anywhere within ±moved (JCGM 100, 4.3.7)
    return out


def shift_by_memory(fit: Fit) -> np.ndarray:
    """How far the variables (v,) move, to first order, where sensors are weighted without memory instead of with it, or
    the other way round; 0 where that does not simulate."""
    problem = fit.problem
    other = reweighted(fit, problem.weighting.without_memory if problem.weighting else discrepancy(fit))
    if not np.isfinite(other.cost):
        return np.zeros(problem.size)
    gradient = other.jacobian.T @ other.residual
    return Quadratic(other.jacobian).step(gradient, problem.lower - fit.v, problem.upper - fit.v, np.inf)[0]
