"""Dry friction sharp enough: its sign turns over a stick speed that the steps can follow, and both are halved while
that pays.

A search begins with a stick speed that few steps a sample follow. What is then missing of the friction near rest
stays in the residual, where a friction that is higher near rest (Stribeck), or a second cause, would make up for it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from matching.diagnosis.fitting.fit import Fit, Quadratic, solve

SEARCH, FINAL, UTMOST = 8, 16, 256  # steps a sample at most
PAYS, SHARE = 3.0, 1e-4  # decrease of χ² that is worth another halving: so much, and so much of it
OF_MISFIT = 0.05  # the same beyond ``FINAL``, of the misfit beyond noise: what takes less is not what is missing


def resolved(fit: Fit, most: int = SEARCH) -> Fit:
    """The fit with its friction as sharp as pays, at ``most`` steps a sample; the same without dry friction."""
    segments = fit.problem.data.segments
    sampling = 1 / float(np.median(np.concatenate([np.diff(segment.time) for segment in segments])))
    while np.isfinite(fit.problem.stick) and fit.problem.steps < 0.75 * most * sampling:
        pays = max(PAYS, SHARE * fit.cost)
        if fit.problem.steps > 0.75 * FINAL * sampling:
            pays = max(pays, OF_MISFIT * (fit.cost - float(fit.problem.data.samples.sum())))
        half = replace(fit.problem, steps=2 * fit.problem.steps, stick=fit.problem.stick / 2)
        if fit.cost - _promised(fit, half.residuals(fit.v[None])[0]) < pays:
            break
        try:
            again = solve(half, fit.v, fit.jacobian, 12, exact=False)
        except (FloatingPointError, np.linalg.LinAlgError):
            break
        if again.cost > fit.cost - pays:
            break
        fit = again
    return fit


def _promised(fit: Fit, residual: np.ndarray) -> float:
    """χ² to first order once the variables have followed from the residual of a fit to another (r,)."""
    if not np.isfinite(residual).all():
        return np.inf
    problem = fit.problem
    step = Quadratic(fit.jacobian).step(fit.jacobian.T @ residual, problem.lower - fit.v, problem.upper - fit.v, np.inf)
    return float(residual @ residual) - step[1]
