"""Points far from a fit's end that fit as well: χ² may be a long, bent valley with many small hollows.

A further spring in series with a shaft is the example: as long as its own resonance is not excited, only the sum of
both compliances shows, and the resonance settles wherever noise happens to look like it. The slopes at the end of a
fit then tell the width of a hollow, not that of the valley. So the valley is walked along.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from matching.diagnosis.candidates.candidates import Cause
from matching.diagnosis.fitting.fit import Fit, solve
from matching.diagnosis.fitting.friction_regularisation import sharpened
from matching.diagnosis.fitting.uncertainty import Estimate, covariance

STEP, STEPS = 1.5, 8  # factor of a step along a valley, and how many at most to each side
MADE_UP = 4.0  # times: how much less certain a parameter is when the others are free, where that is worth looking at
AS_GOOD = 9.0  # of χ² above the best: within three standard uncertainties


def as_good(fit: Fit, causes: tuple[Cause, ...]) -> list[Fit]:
    """Fits along the valleys of χ², best first, as far as they are as good; ``fit`` itself is among them.

    Each scale of a cause that others can make up for is moved step by step and held while the others follow (a profile
    of the likelihood, Venzon and Moolgavkar 1988). Where that leads below the fit, the search goes on from there.
    """
    sigma, length = np.sqrt(np.diag(covariance(fit))), np.linalg.norm(fit.jacobian, axis=0)
    names = [name for cause in causes if not cause.replaces_quantity for name in cause.names().values()]
    found = [fit]
    for name in names:
        i = fit.problem.free.index(name)
        if fit.problem.lower[i] <= 0 or sigma[i] * length[i] < MADE_UP:
            continue
        for factor in (1 / STEP, STEP):
            found += _walk(fit, i, factor)
    best = min(found, key=lambda own: own.cost)
    if best is not fit:
        found.append(sharpened(solve(best.problem, best.v)))
    found.sort(key=lambda own: own.cost)
    return [own for own in found if own.cost < found[0].cost + AS_GOOD]


def _walk(fit: Fit, i: int, factor: float) -> list[Fit]:
    """Fits with variable ``i`` held ever further away, until χ² has clearly risen."""
    found, at, least = [], fit, fit.cost
    for _ in range(STEPS):
        v = at.v.copy()
        v[i] *= factor
        if not fit.problem.lower[i] <= v[i] <= fit.problem.upper[i]:
            break
        try:
            at = solve(fit.problem, v, at.jacobian, held=[i])
        except (FloatingPointError, np.linalg.LinAlgError):
            break
        least = min(least, at.cost)
        if at.cost > least + 2 * AS_GOOD:
            break
        found.append(at)
    return found


def widened(numbers: Mapping[str, Estimate], fits: list[Fit]) -> dict[str, Estimate]:
    """Estimates of the best of several fits as good, uncertain at least as far as the others lie from it.

    On a parabola, a point that lies d away and χ² higher by c makes the standard uncertainty d/√c; where χ² hardly
    rises, d is taken.
    """
    best, *others = fits
    out = dict(numbers)
    for other in others:
        rise = max(1.0, float(np.sqrt(other.cost - best.cost)))
        for name, own in out.items():
            away = abs(other.values[name] - best.values[name]) / rise
            out[name] = replace(own, standard_uncertainty=max(own.standard_uncertainty, away))
    return out
