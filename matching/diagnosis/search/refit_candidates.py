"""Refits of the candidates that a screening promises most of, everything uncertain free."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from matching.diagnosis.candidates.cause import Cause, compilable
from matching.diagnosis.candidates.refit import fit_extended
from matching.diagnosis.candidates.screening import ScreenedCandidate, Screening
from matching.diagnosis.fitting.fit import FitOptions
from matching.diagnosis.search.hypothesis import Hypothesis, at_noise, share_explained
from matching.diagnosis.search.refinement import (
    FIT_ERRORS,
    RefitBudget,
    refitted_over_windows,
    with_sharper_friction_near_best,
    with_simpler_kinds,
)

FIRST_BATCH, NEXT_BATCH, MOST_REFITS = 5, 4, 14  # candidates refitted at once, first and later, and in all
AS_PROMISING = 0.9  # of the best reduction: these join the first batch, up to twice its size
EXPLAINS_ALMOST_ALL = 0.9  # of the misfit beyond noise
PROMISING = 0.4  # of the best reduction that a candidate must promise to be refitted after one that explains all

Progress = Callable[[str], None]  # is given the name of each step


@dataclass(frozen=True)
class RefitPlan:
    """How many candidates are refitted, and whether the best few over short windows too."""

    most: int = MOST_REFITS
    windows: bool = True


FULL_PLAN = RefitPlan()


def best_by_candidate(screened: Sequence[ScreenedCandidate]) -> list[ScreenedCandidate]:
    """The best guess of every kind, place and set of parameters, best first."""
    out: dict[tuple, ScreenedCandidate] = {}
    for candidate in sorted(screened, key=lambda candidate: -candidate.reduction):
        out.setdefault((candidate.kind, candidate.at, tuple(candidate.parameters)), candidate)
    return list(out.values())


def refit_candidates(
    parent: Hypothesis,
    screened: Sequence[ScreenedCandidate],
    screening: Screening,
    budget: RefitBudget,
    progress: Progress,
    plan: RefitPlan,
) -> list[Hypothesis]:
    """Refit candidates until one brings the residual to the noise and no other promises as much; best first.

    Parameters
    ----------
    parent : Hypothesis
        To whose causes each candidate is added.
    screened : sequence of ScreenedCandidate
        Best first, of ``screening``.
    """
    hypotheses: list[Hypothesis] = []
    rest = list(screened)
    tried_windows: set[tuple[Cause, ...]] = set()
    tried_simpler: set[tuple[Cause, ...]] = set()
    while rest and len(hypotheses) < plan.most and budget.left > 0:
        batch = _next_batch(rest, first=not hypotheses)
        rest = rest[len(batch) :]
        _refit_batch(parent, batch, hypotheses, budget, progress)
        hypotheses = with_simpler_kinds(with_sharper_friction_near_best(hypotheses), tried_simpler)
        if plan.windows and hypotheses and not at_noise(hypotheses[0]):
            again = refitted_over_windows(parent, hypotheses, screening, tried_windows, budget)
            hypotheses = with_sharper_friction_near_best(again)
        if hypotheses and (at_noise(hypotheses[0]) or share_explained(parent, hypotheses[0]) > EXPLAINS_ALMOST_ALL):
            promise = PROMISING * max(hypothesis.screened for hypothesis in hypotheses)
            if not rest or rest[0].reduction < promise:
                break
    return hypotheses


def _next_batch(rest: Sequence[ScreenedCandidate], first: bool) -> list[ScreenedCandidate]:
    if not first:
        return list(rest[:NEXT_BATCH])
    as_good = AS_PROMISING * rest[0].reduction
    return [
        candidate
        for i, candidate in enumerate(rest[: 2 * FIRST_BATCH])
        if i < FIRST_BATCH or candidate.reduction > as_good
    ]


def _refit_batch(
    parent: Hypothesis,
    batch: Sequence[ScreenedCandidate],
    hypotheses: list[Hypothesis],
    budget: RefitBudget,
    progress: Progress,
) -> None:
    """Refit some candidates and append what can be fitted to the hypotheses."""
    step = parent.fit.problem.data.sampling_interval
    start = replace(parent.model, bounds=parent.fit.problem.bounds, values=parent.fit.values, starts=())
    models = {}
    for candidate in batch:
        model = start.with_cause(candidate.kind, candidate.at, candidate.parameters, step)
        models[model.causes] = (model, candidate.reduction)
    for model in compilable([model for model, _ in models.values()]):
        if not budget.take():
            break
        cause = model.causes[-1]
        progress(f"{cause.kind} at {cause.at}")
        rival = min((hypothesis.fit.cost for hypothesis in hypotheses), default=0.0)
        noise = min((hypothesis.fit.cost for hypothesis in hypotheses if at_noise(hypothesis)), default=0.0)
        options = FitOptions(exact=False, rival_cost=rival, noise_cost=noise)
        try:
            fit = fit_extended(model, parent.fit, options)
        except FIT_ERRORS:
            continue
        hypotheses.append(Hypothesis(model, fit, models[model.causes][1]))
