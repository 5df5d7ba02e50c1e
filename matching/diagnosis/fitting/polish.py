"""The end of a fit: Gauss–Newton steps with central differences over steps of about one standard uncertainty.

A forward difference over a wide step is wrong by its curvature: a stiffness a thousandth off is a phase out of step
after some seconds. Where two columns differ by less than that error, e.g. those of two springs in series, it looks like
information, and uncertainties come out too small. The steps are therefore as wide as χ² changes by about 1; with
backlash or dry friction, where χ² is rough on that scale, they stay wide.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from matching.diagnosis.fitting.finite_differences import jacobian
from matching.diagnosis.fitting.fit import Fit, chi_square
from matching.diagnosis.fitting.quadratic import Quadratic
from modelling.effects import EFFECTS

MOST_STEPS = 6  # Gauss–Newton steps
ENOUGH = 0.02  # decrease of χ² not worth a step
SHARES = (1.0, 0.3, 0.1)  # of a step that are tried
SMALLEST_DECREASE = 0.1 * ENOUGH  # of χ² for a step to be taken


def polished(fit: Fit) -> Fit:
    """The fit moved to where central differences promise no decrease, with the Jacobian of that point."""
    problem, v, r, cost = fit.problem, fit.v, fit.residual, fit.cost
    widest = difference_steps(fit)
    derivatives = jacobian(problem, v, r, largest_central=widest)
    for _ in range(MOST_STEPS):
        step, promised = Quadratic(derivatives).step(derivatives.T @ r, problem.lower - v, problem.upper - v, np.inf)
        for share in SHARES:
            if promised * share < ENOUGH:
                return replace(fit, v=v, residual=r, jacobian=derivatives, cost=cost)
            trial = np.clip(v + share * step, problem.lower, problem.upper)
            residual = problem.residuals(trial[None])[0]
            if chi_square(residual) < cost - SMALLEST_DECREASE:
                v, r, cost = trial, residual, chi_square(residual)
                break
        else:
            break
        derivatives = jacobian(problem, v, r, largest_central=widest)
    return replace(fit, v=v, residual=r, jacobian=derivatives, cost=cost)


def difference_steps(fit: Fit) -> np.ndarray:
    """(v,) steps over which χ² changes by about 1; infinite where χ² is rough on that scale."""
    length = np.linalg.norm(fit.jacobian, axis=0)
    steps = np.full(fit.problem.size, np.inf)
    if not any(EFFECTS[effect.kind].abrupt for effect in fit.problem.system.effects):
        steps[length > 0] = 1 / length[length > 0]
    return steps
