"""The end of a search: causes that the others make unneeded are dropped, and any is exchanged for a better one."""

from __future__ import annotations

import numpy as np

from matching.diagnosis.candidates.refit import fit_extended
from matching.diagnosis.candidates.screening import Screening
from matching.diagnosis.search.hypothesis import Hypothesis, at_noise
from matching.diagnosis.search.refinement import RefitBudget, search_is_over, with_sharpest_friction
from matching.diagnosis.search.refit_candidates import Progress, RefitPlan, best_by_candidate, refit_candidates
from matching.diagnosis.search.state import SearchState, chi_square_per_reading, distinct
from matching.diagnosis.search.unseen_data import UnseenData

ROUNDS = 2
EXCHANGE_REFITS = 4  # candidates refitted in the place of each cause


def drop_and_exchange(state: SearchState, unseen: UnseenData, budget: RefitBudget, progress: Progress) -> None:
    """Drop causes that are not needed, exchange those for which there is a better one, and collect rivals of the rest;
    changes ``state.best`` and ``state.rivals``."""
    for _ in range(ROUNDS):
        if len(state.best.causes) == 1:
            state.rivals = state.rivals or [[state.best]]
            return
        if search_is_over():
            break
        rivals: list[list[Hypothesis]] = []
        for index in range(len(state.best.causes)):
            better = _better_without(state, index, budget, progress, rivals)
            if better is not None and (at_noise(better) or unseen.may_gain(better, state.best)):
                state.best = better
                break
        else:
            state.rivals = rivals
            return
    state.rivals = [[state.best] for _ in state.best.causes]


def _better_without(
    state: SearchState, index: int, budget: RefitBudget, progress: Progress, rivals: list[list[Hypothesis]]
) -> Hypothesis | None:
    """A hypothesis without a cause of the best, or with another in its place, that is to be preferred; where there is
    none, the rivals of the cause are appended."""
    best = state.best
    model = best.model.without_cause(index, best.fit)
    try:
        rest = with_sharpest_friction(Hypothesis(model, fit_extended(model, best.fit)))
    except (FloatingPointError, np.linalg.LinAlgError):  # it does not even simulate without this cause
        rivals.append([best])
        return None
    if rest.chi_square < best.chi_square + state.noise_threshold * chi_square_per_reading(best):
        return rest
    screening = Screening(rest.fit)
    candidates = best_by_candidate(list(screening.candidates(model.system())))
    candidates = [candidate for candidate in candidates if (candidate.kind, candidate.at) not in rest.places]
    plan = RefitPlan(EXCHANGE_REFITS, windows=at_noise(best))
    hypotheses = refit_candidates(rest, candidates, screening, budget, progress, plan)
    cause = best.causes[index]
    same = [
        hypothesis
        for hypothesis in hypotheses
        if (hypothesis.causes[-1].kind, hypothesis.causes[-1].at) == (cause.kind, cause.at)
    ]
    others = [hypothesis for hypothesis in hypotheses if hypothesis not in same]
    if others and others[0].cost < min([best.cost, *(hypothesis.cost for hypothesis in same)]):
        return others[0]
    rivals.append(distinct(sorted([best, *others], key=lambda hypothesis: hypothesis.cost)))
    return None
