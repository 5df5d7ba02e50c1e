"""Fits far from the best that are as good: the profile likelihood of parameters that others can compensate.

A further spring in series with a shaft is the example: as long as its own resonance is not excited, only the sum of
both compliances shows, and the resonance settles wherever noise happens to look like it. The Jacobian at the end of a
fit then gives the width of a local minimum, not that of all equivalent fits.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from matching.diagnosis.candidates.cause import Cause
from matching.diagnosis.fitting.fit import Fit, FitOptions, solve
from matching.diagnosis.fitting.polish import polished
from matching.diagnosis.fitting.uncertainty import Estimate, covariance
from modelling.common.time_limit import time_is_over

STEP_FACTOR, MOST_STEPS = 1.5, 8  # between two values of a profile, and how many to each side
CONFOUNDED = 4.0  # times: how much less certain a parameter is when the others are free, from which it is profiled
EQUIVALENT = 9.0  # of χ² above the best: within three standard uncertainties


def equivalent_fits(fit: Fit, causes: tuple[Cause, ...]) -> list[Fit]:
    """Fits along the profiles of χ² that are equivalent to the best of them, which comes first.

    Each positive parameter of a cause that others can compensate is moved step by step and held while the others are
    fitted (Venzon and Moolgavkar, Applied Statistics 37, 1988). Where that finds a lower χ² than the fit's, the search
    for the minimum goes on from there.
    """
    sigma, length = np.sqrt(np.diag(covariance(fit))), np.linalg.norm(fit.jacobian, axis=0)
    names = [name for cause in causes if not cause.replaces_quantity for name in cause.names().values()]
    fits = [fit]
    for name in names:
        i = fit.problem.free.index(name)
        if fit.problem.lower[i] > 0 and sigma[i] * length[i] >= CONFOUNDED:
            fits += [other for factor in (1 / STEP_FACTOR, STEP_FACTOR) for other in _profile(fit, i, factor)]
    best = min(fits, key=lambda fit: fit.cost)
    if best is not fit:
        fits.append(polished(solve(best.problem, best.v)))
    fits.sort(key=lambda fit: fit.cost)
    return [fit for fit in fits if fit.cost < fits[0].cost + EQUIVALENT]


def _profile(fit: Fit, i: int, factor: float) -> list[Fit]:
    """Fits with variable ``i`` held ever further away, until χ² has clearly risen."""
    fits, last, lowest = [], fit, fit.cost
    for _ in range(MOST_STEPS):
        v = last.v.copy()
        v[i] *= factor
        if time_is_over() or not fit.problem.lower[i] <= v[i] <= fit.problem.upper[i]:
            break
        try:
            last = solve(fit.problem, v, last.jacobian, FitOptions(held=(i,)))
        except (FloatingPointError, np.linalg.LinAlgError):
            break
        lowest = min(lowest, last.cost)
        if last.cost > lowest + 2 * EQUIVALENT:
            break
        fits.append(last)
    return fits


def widened(estimates: Mapping[str, Estimate], fits: list[Fit]) -> dict[str, Estimate]:
    """Estimates of the best of several equivalent fits, uncertain at least as far as the others are away from it.

    On a parabola, a point that is d away and χ² higher by c makes the standard uncertainty d/√c; where χ² hardly rises,
    d is taken.
    """
    best, *others = fits
    out = dict(estimates)
    for other in others:
        sigmas = max(1.0, float(np.sqrt(other.cost - best.cost)))
        for name, estimate in out.items():
            away = abs(other.values[name] - best.values[name]) / sigmas
            out[name] = replace(estimate, standard_uncertainty=max(estimate.standard_uncertainty, away))
    return out
