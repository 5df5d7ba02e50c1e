"""Dry friction as sharp as the data ask for: the speed over which its sign changes is halved while χ² falls.

A search begins with a stick speed that few integration steps a sample resolve. What is then missing of the friction
near rest stays in the residual, where a kind that is higher near rest (Stribeck), or a second cause, would explain it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from matching.diagnosis.fitting.fit import Fit, FitOptions, chi_square, solve
from matching.diagnosis.fitting.quadratic import Quadratic
from modelling.common.time_limit import time_is_over

SEARCH_STEPS, FINAL_STEPS, MOST_STEPS = 8, 16, 256  # integration steps a sample at most
ALMOST = 0.75  # of the most steps: halving once more would exceed them
DECREASE, DECREASE_SHARE = 3.0, 1e-4  # of χ² that is worth another halving: absolute, and of χ² itself
EXCESS_SHARE = 0.05  # the same beyond ``FINAL_STEPS``, of the misfit beyond noise
ITERATIONS = 12


def with_sharper_friction(fit: Fit, most_steps: int = SEARCH_STEPS) -> Fit:
    """The fit with its friction as sharp as pays, at ``most_steps`` a sample; itself without dry friction."""
    data = fit.problem.data
    sampling = 1 / float(np.median(np.concatenate([np.diff(segment.time) for segment in data.segments])))
    while np.isfinite(fit.problem.stick_speed) and fit.problem.steps_per_second < ALMOST * most_steps * sampling:
        if time_is_over():
            break
        worthwhile = max(DECREASE, DECREASE_SHARE * fit.cost)
        if fit.problem.steps_per_second > ALMOST * FINAL_STEPS * sampling:
            worthwhile = max(worthwhile, EXCESS_SHARE * (fit.cost - data.readings_count))
        sharper = replace(
            fit.problem, steps_per_second=2 * fit.problem.steps_per_second, stick_speed=fit.problem.stick_speed / 2
        )
        if fit.cost - _expected_cost(fit, sharper.residuals(fit.v[None])[0]) < worthwhile:
            break
        try:
            again = solve(sharper, fit.v, fit.jacobian, FitOptions(ITERATIONS, exact=False))
        except (FloatingPointError, np.linalg.LinAlgError):
            break
        if again.cost > fit.cost - worthwhile:
            break
        fit = again
    return fit


def _expected_cost(fit: Fit, residual: np.ndarray) -> float:
    """χ² to first order when the variables of a fit adapt to another residual (r,)."""
    if not np.isfinite(chi_square(residual)):
        return np.inf
    problem, gradient = fit.problem, fit.jacobian.T @ residual
    _, decrease = Quadratic(fit.jacobian).step(gradient, problem.lower - fit.v, problem.upper - fit.v, np.inf)
    return chi_square(residual) - decrease
