"""Fits of a model that is not perfect: weights and parameters are estimated together.

Weighted by noise alone, the most precise sensor decides everything: an encoder known to a microradian outvotes a speed
channel whose filter is plain to see. The likelihood is therefore concentrated over the unknown covariance of what the
model leaves (Goodwin and Payne, Dynamic System Identification, 1977, section 3.5), by iteratively reweighted least
squares.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from matching.diagnosis.data.weighting import SMALLEST_SCALE, Weighting, weighting_of
from matching.diagnosis.fitting.finite_differences import jacobian
from matching.diagnosis.fitting.fit import Fit, FitOptions, chi_square, solve
from matching.diagnosis.fitting.problem import FitProblem
from modelling.common.time_limit import time_is_over

ROUNDS = 6
SETTLED_RATIO = 1.1  # of the scales between two rounds
NOT_LEADING = 1e3  # times the scale, of the sensors beside the one that leads alone
OPTIONS = FitOptions(exact=False)


def iteratively_reweighted(fit: Fit) -> Fit:
    """The fit with each sensor weighted by what the model leaves of it, see :class:`Weighting`."""
    for _ in range(ROUNDS):
        if time_is_over():
            break
        weighting, before = discrepancy(fit), fit.problem.weighting
        if before is not None and _settled(before, weighting):
            break
        fit = solve(replace(fit.problem, weighting=weighting), fit.v, None, OPTIONS)
    return fit


def balanced_fit(fit: Fit, v: np.ndarray) -> Fit:
    """The fit with each sensor weighted by what the model leaves of it, from several starts.

    Estimated weights have several fixed points: where one sensor has led, what it asked for keeps its error small, and
    with that its weight. They are estimated from where weights by noise led, from the values the model states, and from
    where each sensor leads alone; the likeliest end stands, whatever uncertainties are stated.

    Parameters
    ----------
    v : ndarray (v,)
        Variables at the stated values.
    """
    ends = [iteratively_reweighted(fit)]
    stated = discrepancy_at(fit.problem, v)
    sensors = np.flatnonzero(fit.problem.data.readings_by_sensor)
    alone = [np.where(np.arange(len(stated.scale)) == j, 1.0, NOT_LEADING) for j in sensors] if len(sensors) > 1 else []
    for factor in (np.ones_like(stated.scale), *alone):
        problem = replace(fit.problem, weighting=Weighting(stated.memory, factor * stated.scale))
        try:
            ends.append(iteratively_reweighted(solve(problem, v, None, OPTIONS)))
        except FloatingPointError:
            continue  # nothing simulates from there
    return min(ends, key=innovation_power)


def innovation_power(fit: Fit) -> float:
    """Mean over the readings of ln of the squared innovation of their sensor: −2 ln of the likelihood for each."""
    count = fit.problem.data.readings_by_sensor
    return float(np.log(discrepancy(fit).scale ** 2) @ count / count.sum())


def power_left(errors: Sequence[np.ndarray], measured: Sequence[np.ndarray]) -> np.ndarray:
    """What a model leaves of the sensors (y,), as a power in times the noise: the geometric mean of the power of the
    innovation and that of the error itself.

    The likelihood with a memory hardly asks for the slow part of an error, however large, and that without one asks for
    little else. Their composite (Varin, Reid and Firth, Statistica Sinica 21, 2011) asks for both.

    Parameters
    ----------
    errors, measured : sequence of ndarray (t, y)
        Of each segment, in times the noise, and where there is a reading.
    """
    return weighting_of(errors, measured).scale * np.sqrt(_power(errors, measured))


def power_left_by(fit: Fit) -> np.ndarray:
    """:func:`power_left` of a fit (y,)."""
    return power_left(fit.errors, [segment.measured for segment in fit.problem.data.segments])


def slow_and_fast(fit: Fit) -> Weighting:
    """Weights of a fit by which the slow part of what it leaves counts as much as the fast one."""
    power = _power(fit.errors, [segment.measured for segment in fit.problem.data.segments])
    return discrepancy(fit).with_slow_part(power)


def _power(errors: Sequence[np.ndarray], measured: Sequence[np.ndarray]) -> np.ndarray:
    """Mean squares (y,) of errors."""
    square = np.sum([np.sum(np.where(m, e, 0.0) ** 2, axis=0) for e, m in zip(errors, measured, strict=True)], axis=0)
    return np.maximum(square / np.maximum(np.sum([m.sum(axis=0) for m in measured], axis=0), 1), SMALLEST_SCALE**2)


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
