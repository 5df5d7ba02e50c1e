"""Several causes, one after another, until the residual is noise; what is not needed later is dropped."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from matching.diagnosis.candidates.cause import Cause, ExtendedModel
from matching.diagnosis.candidates.noise_threshold import NoiseDraws
from matching.diagnosis.candidates.recorded import recorded_range
from matching.diagnosis.candidates.screening import ScreenedCandidate, Screening
from matching.diagnosis.fitting.fit import Fit
from matching.diagnosis.fitting.reweighting import reweighted, slow_and_fast
from matching.diagnosis.search.hypothesis import (
    Hypothesis,
    at_noise,
    scatters_only,
    share_explained,
    with_balanced_sensors,
)
from matching.diagnosis.search.join_shared import with_shared_causes
from matching.diagnosis.search.pairs import fitted_pairs, screened_pairs
from matching.diagnosis.search.prune import drop_and_exchange
from matching.diagnosis.search.refinement import (
    RefitBudget,
    with_possible_causes,
    with_sharper_friction_near_best,
)
from matching.diagnosis.search.refit_candidates import (
    FULL_PLAN,
    Progress,
    RefitPlan,
    best_by_candidate,
    refit_candidates,
)
from matching.diagnosis.search.state import SearchState, chi_square_per_reading, distinct
from matching.diagnosis.search.unseen_data import UnseenData
from modelling.model.system import System

MOST_CAUSES = 3
FURTHER_REFITS, SIDE_REFITS = 9, 5  # candidates refitted from the best hypothesis with causes, and from its rivals
SLOW_PLAN = RefitPlan(2, windows=False)  # of the candidates that explain most of the slow part of what is left
BEAM = 3  # hypotheses with one cause from which a second is searched for
BEAM_RATIO = 2.0  # χ² of these, in times the best's
MOST_JUDGED = 6  # hypotheses that are compared on unseen data before the search gives up
EXPLAINS_MOST = 0.4  # of the misfit beyond noise: a cause that is followed though it meets unseen data worse
SLIGHT = 0.1  # of the misfit beyond noise: what explains less is no cause of it; the vocabulary lacks the cause


@dataclass
class _Node:
    """A hypothesis with the screening of its residual and what that promises."""

    screening: Screening
    candidates: list[ScreenedCandidate]


@dataclass
class _Screenings:
    """Screenings by causes, each made once."""

    known: dict[tuple[Cause, ...], _Node]

    def of(self, hypothesis: Hypothesis) -> _Node:
        """The screening of a hypothesis."""
        if hypothesis.causes not in self.known:
            screening = Screening(hypothesis.fit)
            candidates = best_by_candidate(list(screening.candidates(hypothesis.model.system())))
            self.known[hypothesis.causes] = _Node(screening, candidates)
        return self.known[hypothesis.causes]

    def slow(self, hypothesis: Hypothesis) -> list[ScreenedCandidate]:
        """Candidates by what they explain of the slow part of what a hypothesis leaves, which weights with a memory
        hide; best first.

        A small constant torque lets an angle drift away: a step that each sample hardly shows, and most of the error.
        What a quantity would have to change to take the drift is held back by what the fast part says of it.
        """
        fit = hypothesis.fit
        if fit.problem.weighting is None:
            return []
        screening = Screening(reweighted(fit, slow_and_fast(fit)))
        fast = {_variant(candidate): candidate.reduction for candidate in self.of(hypothesis).candidates}
        slow = [
            replace(candidate, reduction=2 * candidate.reduction - fast.get(_variant(candidate), 0.0))
            for candidate in best_by_candidate(list(screening.candidates(hypothesis.model.system())))
        ]
        return sorted(slow, key=lambda candidate: -candidate.reduction)


def _variant(candidate: ScreenedCandidate) -> tuple:
    return candidate.kind, candidate.at, tuple(candidate.parameters)


def search_causes(system: System, base_fit: Fit, unseen: UnseenData, progress: Progress) -> SearchState:
    """Find the causes that bring a base fit's residual to the noise, as far as the vocabulary can.

    A cause that leaves more than noise has to lower the error of unseen data too.
    """
    screening = Screening(base_fit)
    recorded = recorded_range(system, base_fit.problem.data, screening.motion)
    model = ExtendedModel(system, (), dict(base_fit.problem.bounds), base_fit.values, recorded=recorded)
    base = Hypothesis(model, base_fit)
    draws = screening.draws = NoiseDraws(screening.mask.ravel(), screening.free)
    candidates = best_by_candidate(list(screening.candidates()))
    screening.draws = None
    state = SearchState(base, base, screening, candidates, draws.threshold())
    screenings = _Screenings({(): _Node(screening, candidates)})
    budget = RefitBudget()
    beam = [base]
    while state.best is base or (len(state.best.causes) < MOST_CAUSES and not scatters_only(state.best)):
        grown = _grow(beam, screenings, state.noise_threshold, budget, progress)
        if state.best is base:
            state.with_one_cause = grown
        elif len(state.best.causes) == 1 and not (grown and at_noise(grown[0])):
            grown = _with_pairs(base, screenings.of(base), grown, budget, progress)
        fitted, grown = grown, _from_first_accepted(state, grown, unseen)
        if not grown and state.best is base and not at_noise(base):  # none alone, but perhaps two together
            grown = _from_first_accepted(state, _with_pairs(base, screenings.of(base), [], budget, progress), unseen)
        if not grown:
            grown = _with_what_it_lacks(state, fitted, screenings, unseen, budget, progress)
        if not grown:
            break
        grown[0] = state.best = with_shared_causes(grown[0], budget)
        width = BEAM if len(state.best.causes) == 1 else 1
        beam = [hypothesis for hypothesis in grown[:width] if hypothesis.chi_square < BEAM_RATIO * grown[0].chi_square]
        if len(state.best.causes) == 1:
            state.rivals = [grown]
    drop_and_exchange(state, unseen, budget, progress)
    return state


def _from_first_accepted(state: SearchState, grown: list[Hypothesis], unseen: UnseenData) -> list[Hypothesis]:
    """Hypotheses, best first, from the first on that is worth its cause; that one weighted as it leaves the sensors."""
    for index, fitted in enumerate(grown[:MOST_JUDGED]):
        if not _worthwhile(state.best, fitted, state.noise_threshold):
            break
        hypothesis = with_possible_causes(fitted) if len(fitted.causes) > 1 else fitted
        if not _worthwhile(state.best, hypothesis, state.noise_threshold):
            continue
        if hypothesis.model.not_taken(hypothesis.fit) or hypothesis.model.negligible(hypothesis.fit):
            continue
        if at_noise(hypothesis) or unseen.may_gain(hypothesis, state.best):
            return [with_balanced_sensors(hypothesis), *grown[index + 1 :]]
    return []


def _grow(
    beam: list[Hypothesis], screenings: _Screenings, noise_threshold: float, budget: RefitBudget, progress: Progress
) -> list[Hypothesis]:
    """Hypotheses with one cause more than those of the beam, best first."""
    grown: list[Hypothesis] = []
    for parent in beam:
        node = screenings.of(parent)
        promising = [
            candidate
            for candidate in node.candidates
            if candidate.reduction > noise_threshold and candidate.kind_and_place not in parent.places
        ]
        if not promising:
            continue
        first = parent is beam[0]
        plan = FULL_PLAN if not parent.causes else RefitPlan(FURTHER_REFITS, first and len(parent.causes) < 2)
        if not first:
            plan = RefitPlan(SIDE_REFITS, windows=False)
        grown += refit_candidates(parent, promising, node.screening, budget, progress, plan)
        if first and parent.causes:
            slow = [candidate for candidate in screenings.slow(parent) if candidate.kind_and_place not in parent.places]
            grown += refit_candidates(parent, slow, node.screening, budget, progress, SLOW_PLAN)
        if grown and at_noise(grown[0]):
            break
    return distinct(sorted(grown, key=lambda hypothesis: hypothesis.cost))


def _with_pairs(
    base: Hypothesis, node: _Node, grown: list[Hypothesis], budget: RefitBudget, progress: Progress
) -> list[Hypothesis]:
    """Hypotheses with two causes, best first, and pairs that hide each other from a search for one at a time."""
    progress("pairs of causes")
    pairs = fitted_pairs(base, screened_pairs(node.screening, node.candidates), grown, budget)
    return distinct(sorted([*grown, *with_sharper_friction_near_best(pairs)], key=lambda hypothesis: hypothesis.cost))


def _with_what_it_lacks(
    state: SearchState, fitted: list[Hypothesis], screenings: _Screenings, unseen: UnseenData, budget: RefitBudget,
    progress: Progress,
) -> list[Hypothesis]:  # fmt: skip
    """Hypotheses of several causes more than the best, from the first on that meets unseen data better; by fitted data
    alone on the way there.

    Where several causes act at once, one of them may explain most of what is fitted and meet unseen data worse: without
    the others its size is wrong, or what they did there is missing more.
    """
    ahead = _first_worthwhile(state.best, fitted, state.noise_threshold, EXPLAINS_MOST)
    while ahead is not None and len(ahead.causes) < MOST_CAUSES and not at_noise(ahead):
        ahead = with_balanced_sensors(ahead)
        further = _grow([ahead], screenings, state.noise_threshold, budget, progress)
        accepted = _from_first_accepted(state, further, unseen)
        if accepted and unseen.gains(accepted[0], state.best):
            return accepted
        ahead = _first_worthwhile(ahead, further, state.noise_threshold, SLIGHT)
    return []


def _first_worthwhile(
    parent: Hypothesis, fitted: list[Hypothesis], noise_threshold: float, least: float
) -> Hypothesis | None:
    """The first of hypotheses, best first, that explains at least that share of what another leaves and is possible."""
    for hypothesis in fitted[:MOST_JUDGED]:
        if not _worthwhile(parent, hypothesis, noise_threshold) or share_explained(parent, hypothesis) < least:
            return None
        if not (hypothesis.model.not_taken(hypothesis.fit) or hypothesis.model.negligible(hypothesis.fit)):
            return hypothesis
    return None


def _worthwhile(parent: Hypothesis, child: Hypothesis, noise_threshold: float) -> bool:
    """Whether further causes explain more than noise would, more than their parameters cost, and more than a slight
    part of the misfit."""
    least = max(noise_threshold, _price(child) - _price(parent))
    if child.chi_square > parent.chi_square - least * chi_square_per_reading(child):
        return False
    return share_explained(parent, child) >= SLIGHT


def _price(hypothesis: Hypothesis) -> float:
    """What parameters and states of a fit cost in χ² (Schwarz 1978): a refit finds more in noise than a screening."""
    problem = hypothesis.fit.problem
    return (len(problem.free) + len(problem.model.states)) * float(np.log(problem.data.readings_count))
