"""The fit of the model as given, begun anywhere within its stated ranges: no cause stands in for a bad start."""

from __future__ import annotations

import contextlib

import numpy as np
import scipy

from matching.diagnosis.causes import ExtendedModel
from matching.diagnosis.data import FitData
from matching.diagnosis.descent import Fit, FitOptions, chi_square, solve, solve_near
from matching.diagnosis.hypotheses import Hypothesis, at_noise, with_sharpest_friction
from matching.diagnosis.problem import BATCH, FitProblem, base_problem, with_enough_steps
from matching.diagnosis.settings import DiagnosisSettings
from modelling.errors import FitError
from modelling.resources import time_is_over
from modelling.system import System


def fit_base(system: System, data: FitData, settings: DiagnosisSettings, begin: Fit | None = None) -> Fit:
    """The best fit of a system as given.

    Begun from the stated values, or where another fit of as many readings ended. Where the stated values leave more
    than noise, the fit is begun from points spread over the ranges of the uncertain quantities as well (Sobol; those
    with the lowest χ² are fitted): χ² of a vibration has a minimum at every beat. Another minimum is taken where it is
    clearly lower.

    Raises
    ------
    FitError
        If nothing simulates.
    """
    problem, v = base_problem(system, data)
    if begin is not None:
        v = problem.pack(begin.values, begin.starts)
    fits, iterations = list[Fit](), settings.base_iterations
    reason: FitError | None = None
    try:
        fits.append(solve(problem, v, None if begin is None else begin.jacobian, FitOptions(iterations)))
    except FitError as error:
        reason = error
    if not fits or (begin is None and not at_noise(as_hypothesis(system, fits[0]))):
        for other in _spread(problem, v, settings):
            if time_is_over(settings.search_share):
                break
            with contextlib.suppress(FitError):
                rival = FitOptions(iterations, exact=False, rival_cost=min((fit.cost for fit in fits), default=0.0))
                fits.append(solve_near(problem, other, fits[0], rival) if fits else solve(problem, other, None, rival))
    if not fits:
        raise reason or FitError("nothing simulates")
    best = min(fits, key=lambda fit: fit.cost)
    if best.cost > settings.clearly_lower * fits[0].cost:
        best = fits[0]
    finer = with_enough_steps(problem, best.v)
    if best is not fits[0] or finer.steps_per_second > problem.steps_per_second:
        best = solve(finer, best.v, None, FitOptions(iterations))
    return with_sharpest_friction(as_hypothesis(system, best)).fit


def as_hypothesis(system: System, fit: Fit) -> Hypothesis:
    """A fit of a system as given as a hypothesis without causes."""
    return Hypothesis(ExtendedModel(system, (), dict(fit.problem.bounds), fit.values), fit)


def _spread(problem: FitProblem, v: np.ndarray, settings: DiagnosisSettings) -> list[np.ndarray]:
    """Variables (v,) with parameters anywhere in their ranges, those of the lowest χ² first."""
    k = len(problem.free)
    if not k:
        return []
    low, high = problem.lower[:k], problem.upper[:k]
    shares = scipy.stats.qmc.Sobol(k, seed=0).random(settings.base_starts)
    positive = low > 0  # by factors: a stiffness of a tenth is as far as one of ten times
    points = np.where(positive, np.where(positive, low, 1.0) * (high / np.where(positive, low, 1.0)) ** shares,
                      low + (high - low) * shares)  # fmt: skip
    every = np.repeat(v[None], len(points), axis=0)
    every[:, :k] = points
    costs = [
        chi_square(r) for part in np.split(every, range(BATCH, len(every), BATCH)) for r in problem.residuals(part)
    ]
    order = [i for i in np.argsort(costs) if np.isfinite(costs[i])]
    return [every[i] for i in order[: settings.base_fits]]
