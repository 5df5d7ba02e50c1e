"""From a base fit to causes with their rivals; of long data by way of a time window."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from matching.diagnosis.candidates.refit import fit_extended
from matching.diagnosis.candidates.screening import Screening
from matching.diagnosis.data.segments import FitData
from matching.diagnosis.fitting.fit import Fit, solve
from matching.diagnosis.fitting.holdout import Holdout, OtherRecordings
from matching.diagnosis.fitting.problem import base_problem
from matching.diagnosis.fitting.reweighting import balanced_fit
from matching.diagnosis.search.greedy_search import search_causes
from matching.diagnosis.search.hypothesis import Hypothesis, at_noise, scatters_only, with_balanced_sensors
from matching.diagnosis.search.refinement import (
    FIT_ERRORS,
    search_is_over,
    simpler_hypotheses,
    with_sharpest_friction,
)
from matching.diagnosis.search.refit_candidates import Progress
from matching.diagnosis.search.remembered import RememberedHoldout
from matching.diagnosis.search.search_window import first_readings, search_window
from matching.diagnosis.search.state import SearchState
from matching.diagnosis.search.unseen_data import UnseenData
from matching.diagnosis.verdict.causes import FittedCandidate
from matching.diagnosis.verdict.confidence import (
    RatedCause,
    chi_square_inflation,
    rate_rivals,
)
from matching.diagnosis.verdict.final_fit import final_fit, final_fit_on
from matching.diagnosis.verdict.fitted_candidates import fitted_candidates
from modelling.effects import EFFECTS
from modelling.model.system import System

SEARCHED_RATIO = 1.5  # of χ², up to which a fit of the search may become one as good as the final one
FAR_FROM_NOISE = 100.0  # times the noise, of a base model: a search by noise weights alone is not even begun
LEFT_BY_MODEL = 3.0  # times the noise, of the best hypothesis: more than a noise that is stated too small


@dataclass(frozen=True)
class IdentifiedCauses:
    """The state of the search at its end, for each cause its rivals, itself included, and all fitted candidates."""

    state: SearchState
    rated: list[list[RatedCause]]
    fitted: list[FittedCandidate]


def identify_causes(system: System, base: Fit, holdout: Holdout, progress: Progress) -> IdentifiedCauses:
    """The causes that a base fit lacks, and for each its rivals, itself included.

    Weights by noise are right for a model that can be perfect. Where the best one is far from the noise, causes are
    searched for again with each sensor weighted by what the base model leaves of it, and taken if they meet unseen data
    better. With one sensor there is nothing to weigh: the error of its free simulation is what counts.
    """
    several = (base.problem.data.readings_by_sensor > 0).sum() > 1
    if several and _largest_error(base) > FAR_FROM_NOISE:
        return _identify(system, _balanced(system, base), holdout, progress)
    identified = _identify(system, base, holdout, progress)
    best = identified.state.best
    if not several or scatters_only(best) or _largest_error(best.fit) < LEFT_BY_MODEL or search_is_over():
        return identified
    progress("sensors weighted by what the model leaves")
    balanced = _identify(system, _balanced(system, base), holdout, progress)
    better = UnseenData(holdout).earns_place(balanced.state.best, best)
    return balanced if better else identified


def _identify(system: System, base: Fit, holdout: Holdout, progress: Progress) -> IdentifiedCauses:
    """Causes with their rivals, sensors weighted as in the base fit.

    Of long data, causes are searched for in the time window where the base model is worst, then fitted to all data. If
    the residual of all data is not noise though that of the window is, they are searched for in all data.
    """
    window = search_window(base)
    if window is not None:
        progress(f"a time window of {sum(np.ptp(segment.time) for segment in window.segments):.3g} s")
        judge = RememberedHoldout(OtherRecordings(first_readings(holdout.data)))
        identified = _search_and_rate(system, _solved_as(base, system, window), judge, progress)
        state = identified.state
        progress("all data")
        best = final_fit_on(state.best, base)
        if at_noise(best) or not at_noise(state.best) or search_is_over():
            state.best, state.base, state.screening = best, replace(state.base, fit=base), Screening(base)
            state.screened = []
            return identified
    return _search_and_rate(system, base, holdout, progress)


def _largest_error(fit: Fit) -> float:
    """Root mean square error of the sensor with the largest one, in times its noise."""
    squares = np.sum([np.sum(part**2, axis=0) for part in fit.errors], axis=0)
    return float(np.sqrt(squares / np.maximum(fit.problem.data.readings_by_sensor, 1)).max(initial=0.0))


def _balanced(system: System, base: Fit) -> Fit:
    return balanced_fit(base, base_problem(system, base.problem.data)[1])


def _solved_as(base: Fit, system: System, data: FitData) -> Fit:
    """A base fit of other data, weighted as another is."""
    problem, v = base_problem(system, data)
    return solve(replace(problem, weighting=base.problem.weighting), v)


def _search_and_rate(system: System, base: Fit, holdout: Holdout, progress: Progress) -> IdentifiedCauses:
    unseen = UnseenData(holdout)
    state = search_causes(system, base, unseen, progress)
    progress("final fit")
    if not at_noise(state.best):
        _drop_without_gain_unseen(state, unseen)
    state.best = final_fit(state.best)
    if not state.best.causes:
        state.base = state.best
    _drop_not_needed(state)
    _simplify(state)
    rated = []
    for index in range(len(state.best.causes)):
        progress("rivals")
        rated.append(rate_rivals(state, index, holdout))
    return IdentifiedCauses(state, rated, fitted_candidates(state, holdout))


def _drop_without_gain_unseen(state: SearchState, unseen: UnseenData) -> None:
    """Drop each cause, the last first, without which unseen data are met as well: it fitted what does not repeat."""
    for index in reversed(range(len(state.best.causes))):
        rest = _others(state, index)
        if rest is None:
            continue
        rest = with_balanced_sensors(rest)
        if state.best.model.negligible(state.best.fit, index) or not unseen.earns_place(state.best, rest):
            state.best = rest
            del state.rivals[index : index + 1]
    if state.best.causes and unseen.error(state.best) is not None and not unseen.gains(state.best, state.base):
        state.best, state.rivals = state.base, []  # each helps the others, and all together help nothing
    if len(state.best.causes) == 1 and state.with_one_cause[:1] != [state.best]:
        others = [hypothesis for hypothesis in state.with_one_cause if hypothesis.places != state.best.places]
        state.rivals = [[state.best, *others]]


def _drop_not_needed(state: SearchState) -> None:
    """Drop causes of several without which the final fit is as good, e.g. backlash of no width."""
    index = 0
    while len(state.best.causes) > 1 and index < len(state.best.causes):
        rest = _others(state, index)
        if rest is None:
            index += 1
            continue
        rest, fit = final_fit(rest), state.best.fit
        price = len(state.best.causes[index].keys) * float(np.log(fit.problem.data.readings_count))
        if rest.fit.cost < fit.cost + max(state.noise_threshold, price) * chi_square_inflation(state.best):
            state.best = rest
            del state.rivals[index : index + 1]
        else:
            index += 1


def _simplify(state: SearchState) -> None:
    """Exchange causes for simpler kinds that behave alike at their values, where these fit as well: a further cause has
    taken what the simpler one left when it was searched for."""
    for cause in state.best.causes:
        best = state.best
        index = best.causes.index(cause)
        for simpler in simpler_hypotheses(best, index):
            saved = len(best.fit.v) - len(simpler.fit.v)
            price = saved * float(np.log(best.fit.problem.data.readings_count)) * chi_square_inflation(best)
            if saved <= 0 or simpler.fit.cost > SEARCHED_RATIO * best.fit.cost:
                continue
            simpler = final_fit(simpler)
            if simpler.fit.cost < best.fit.cost + price or not _possible(best, index):
                state.best = simpler
                del state.rivals[index : index + 1]
                break


def _possible(hypothesis: Hypothesis, index: int) -> bool:
    """Whether the fitted parameters of a cause make sense together."""
    cause = hypothesis.causes[index]
    return EFFECTS[cause.kind].possible({key: hypothesis.fit.values[name] for key, name in cause.names().items()})


def best_without(state: SearchState, index: int) -> Hypothesis:
    """The best hypothesis without one of its causes; the base model where the others alone do not simulate."""
    return _others(state, index) or state.base


def _others(state: SearchState, index: int) -> Hypothesis | None:
    """All causes of the best hypothesis but one, fitted; None where they do not simulate without it."""
    if len(state.best.causes) == 1:
        return state.base
    model = state.best.model.without_cause(index, state.best.fit)
    try:
        fit = fit_extended(model, state.best.fit)
    except FIT_ERRORS:
        return None
    return with_sharpest_friction(Hypothesis(model, fit))
