"""The end of a fit: central differences, so that nearly collinear parameters are moved and judged by true slopes.

A difference over a wide step errs: a stiffness a thousandth off is a phase out of step after some seconds. Where two
columns differ by less than that error, e.g. those of two springs in series, it passes for information, and
uncertainties come out too small. The steps are therefore as wide as χ² changes by about 1; with free play or dry
friction, where the misfit is rough on that scale, they stay wide.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from matching.diagnosis.fitting.fit import Fit, Quadratic, chi_square
from modelling.effects import EFFECTS

STEPS = 6  # Gauss–Newton steps at most
ENOUGH = 0.02  # decrease of χ² that is not worth a step


def sharpened(fit: Fit) -> Fit:
    """The fit moved to where central differences see no way down, with the Jacobian of that point."""
    problem, v, r, cost = fit.problem, fit.v, fit.residual, fit.cost
    h = widths(fit)
    jacobian = problem.jacobian(v, r, central=h)
    for _ in range(STEPS):
        quadratic = Quadratic(jacobian)
        low, high = problem.lower - v, problem.upper - v
        step, predicted = quadratic.step(jacobian.T @ r, low, high, np.inf)
        moved = False
        for share in (1.0, 0.3, 0.1):
            if predicted * share < ENOUGH:
                break
            tried = np.clip(v + share * step, problem.lower, problem.upper)
            residual = problem.residuals(tried[None])[0]
            new = chi_square(residual)
            if new < cost - 0.1 * ENOUGH:
                v, r, cost, moved = tried, residual, new, True
                break
        if not moved:
            break
        jacobian = problem.jacobian(v, r, central=h)
    return replace(fit, v=v, residual=r, jacobian=jacobian, cost=cost)


def widths(fit: Fit) -> np.ndarray:
    """(v,) steps over which χ² changes by about 1; unlimited where the misfit is rough on that scale."""
    length = np.linalg.norm(fit.jacobian, axis=0)
    h = np.full(fit.problem.size, np.inf)
    if not any(EFFECTS[effect.kind].abrupt for effect in fit.problem.system.effects):
        h[length > 0] = 1 / length[length > 0]
    return h
