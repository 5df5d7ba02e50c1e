"""Fits of a model that is not perfect: weights and parameters are estimated together.

Weighted by noise alone, the most precise sensor decides everything: an encoder known to a microradian outvotes a speed
channel whose filter is plain to see. The likelihood is therefore concentrated over the unknown covariance of what the
model leaves (Goodwin and Payne, Dynamic System Identification, 1977, section 3.5), by iteratively reweighted least
squares.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from matching.diagnosis.data.weighting import Weighting, weighting_of
from matching.diagnosis.fitting.finite_differences import jacobian
from matching.diagnosis.fitting.fit import Fit, FitOptions, chi_square, solve
from matching.diagnosis.fitting.problem import FitProblem

ROUNDS = 6
SETTLED_RATIO = 1.1  # of the scales between two rounds
OPTIONS = FitOptions(exact=False)


def iteratively_reweighted(fit: Fit) -> Fit:
    """The fit with each sensor weighted by what the model leaves of it, see :class:`Weighting`."""
    for _ in range(ROUNDS):
        weighting, before = discrepancy(fit), fit.problem.weighting
        if before is not None and _settled(before, weighting):
            break
        fit = solve(replace(fit.problem, weighting=weighting), fit.v, None, OPTIONS)
    return fit


def balanced_fit(fit: Fit, v: np.ndarray) -> Fit:
    """The fit with each sensor weighted by what the model leaves of it, from where weights by noise led and from the
    values the model states.

    Estimated weights have several fixed points: where the most precise sensor has led, what it asked for keeps its
    error small, and with that its weight. The likelier end stands, whatever uncertainties are stated.

    Parameters
    ----------
    v : ndarray (v,)
        Variables at the stated values.
    """
    ends = [iteratively_reweighted(fit)]
    try:
        stated = solve(replace(fit.problem, weighting=discrepancy_at(fit.problem, v)), v, None, OPTIONS)
        ends.append(iteratively_reweighted(stated))
    except FloatingPointError:
        pass  # the stated values do not simulate
    return min(ends, key=innovation_power)


def innovation_power(fit: Fit) -> float:
    """Mean over the readings of ln of the squared innovation of their sensor: −2 ln of the likelihood for each."""
    count = fit.problem.data.readings_by_sensor
    return float(np.log(discrepancy(fit).scale ** 2) @ count / count.sum())


def discrepancy_at(problem: FitProblem, v: np.ndarray) -> Weighting:
    """What a model leaves of the sensors at variables (v,), as weights of a fit."""
    return weighting_of(problem.errors(v), [segment.measured for segment in problem.data.segments])


def discrepancy(fit: Fit) -> Weighting:
    """What a fit leaves of the sensors, as weights of a further fit."""
    return weighting_of(fit.errors, [segment.measured for segment in fit.problem.data.segments])


def reweighted(fit: Fit, weighting: Weighting | None) -> Fit:
    """The same fit in other weights."""
    problem = replace(fit.problem, weighting=weighting)
    residual = problem.residuals(fit.v[None])[0]
    return replace(
        fit, problem=problem, residual=residual, jacobian=jacobian(problem, fit.v, residual), cost=chi_square(residual)
    )


def _settled(before: Weighting, after: Weighting) -> bool:
    """Whether two weightings differ little: standard deviation of the innovation, and of the process."""
    innovation = after.scale / before.scale
    process = innovation * np.sqrt((1 - before.memory**2) / (1 - after.memory**2))
    ratio = np.concatenate([innovation, np.sqrt(process)])
    return bool(max(ratio.max(), 1 / ratio.min()) < SETTLED_RATIO)
