"""Points far from a fit's end that fit as well: χ² may be a long, bent valley with many small hollows.

A further spring in series with a shaft is the example: as long as its own resonance is not excited, only the sum of
both compliances shows, and the resonance settles wherever noise happens to look like it. The slopes at the end of a
fit then tell the width of a hollow, not that of the valley. So the search begins again a factor away.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from matching.diagnosis.candidates import WRONG, Cause
from matching.diagnosis.fit import Fit, solve
from matching.diagnosis.sharpen import sharpened
from matching.diagnosis.uncertainty import Estimate, covariance

AWAY = (0.05, 0.2, 5.0, 20.0)  # factors from which the search begins again
MADE_UP = 4.0  # times: how much less certain a parameter is when the others are free, where that is worth looking at
AS_GOOD = 9.0  # of χ² above the best: within three standard uncertainties


def as_good(fit: Fit, causes: tuple[Cause, ...]) -> list[Fit]:
    """Fits from a factor away in each scale of a cause that others can make up for, best first, as far as they are as
    good; ``fit`` itself is among them.
    """
    sigma, length = np.sqrt(np.diag(covariance(fit))), np.linalg.norm(fit.jacobian, axis=0)
    names = [name for cause in causes if cause.kind != WRONG for name in cause.names().values()]
    found = [fit]
    for name in names:
        i = fit.problem.free.index(name)
        if fit.problem.lower[i] <= 0 or sigma[i] * length[i] < MADE_UP:
            continue
        for factor in AWAY:
            v = fit.v.copy()
            v[i] *= factor
            try:
                other = solve(fit.problem, v, None, 20, rival=fit.cost)
            except (FloatingPointError, np.linalg.LinAlgError):
                continue
            if other.cost < 1.1 * fit.cost:
                found.append(sharpened(other))
    found.sort(key=lambda own: own.cost)
    return [own for own in found if own.cost < found[0].cost + AS_GOOD]


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
