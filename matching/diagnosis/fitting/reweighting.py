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
