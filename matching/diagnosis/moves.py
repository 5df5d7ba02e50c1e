"""One selection: a set of causes with their values, and moves from it. Each refits from the best values so far.

The moves are: add a cause, or two that hide each other; share one cause between channels; put a simpler kind, or a
ripple over another angle, in the place of a cause; drop a cause, the only one too; exchange a cause. One rule decides
downward, to the model without a cause: a cause stands where unseen data are met better with it than without it, beyond
chance and in every sensor.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Any

import numpy as np

from matching.diagnosis.causes import Cause, ExtendedModel, compilable, recorded_range, simulated_motion
from matching.diagnosis.data import FEWEST_SAMPLES, FitData
from matching.diagnosis.descent import SEARCH, Fit, FitOptions, discrepancy, reweighted, solve, with_sharper_friction
from matching.diagnosis.hypotheses import (
    Hypothesis,
    at_noise,
    final_fit,
    is_simpler,
    largest_error,
    scatters_only,
    share_explained,
    simpler_kinds,
    with_balanced_sensors,
    with_sharpest_friction,
)
from matching.diagnosis.result import differs_from_nothing, fitted_values
from matching.diagnosis.screening import NoiseDraws, ScreenedCandidate, Screening, fit_extended
from matching.diagnosis.settings import DiagnosisSettings
from matching.diagnosis.unseen import UnseenData
from matching.diagnosis.windows import fit_from_windows
from modelling.effects import EFFECTS
from modelling.effects.effect import members, shared_place
from modelling.effects.sensors_and_actuators import (
    LATE_SIGN,
    ClockOffset,
    DeadTime,
    SensorDelay,
    SensorGain,
    SensorOffset,
    recorded_late,
)
from modelling.errors import FitError
from modelling.resources import time_is_over
from modelling.system import System

SIDE_BY_SIDE = 4  # models that are compiled at once
Progress = Callable[[str], None]  # is given the name of each step
Suspected = tuple[str, str, dict[str, float]]  # kind, place and first values of a cause


@dataclass
class Selection:
    """What the moves have reached.

    Attributes
    ----------
    base : Hypothesis
        Without causes.
    best : Hypothesis
    screening : Screening
        Of the base fit.
    screened : list of ScreenedCandidate
        What it found, the best guess of each candidate.
    noise_threshold : float
        Decrease of χ² that the best of all candidates seldom reaches in pure noise.
    rivals : list of list of Hypothesis
        For each cause of ``best``: hypotheses with another cause in its place, best first.
    compared : list of Hypothesis
        For each cause of ``best``: the best hypothesis, fitted as far as its rivals are.
    with_one_cause : list of Hypothesis
        All that were fitted, taken or not, best first.
    failed : dict of (str, str) to str
        Kind and place of candidates whose fit does not exist, and why.
    refused : dict of (str, str) to str
        Kind and place of candidates that were refused by themselves, and the reason that decided, in the words of
        ``diagnosis.json``.
    """

    base: Hypothesis
    best: Hypothesis
    screening: Screening
    screened: list[ScreenedCandidate]
    noise_threshold: float
    rivals: list[list[Hypothesis]] = field(default_factory=list)
    compared: list[Hypothesis] = field(default_factory=list)
    with_one_cause: list[Hypothesis] = field(default_factory=list)
    failed: dict[tuple[str, str], str] = field(default_factory=dict)
    refused: dict[tuple[str, str], str] = field(default_factory=dict)


def best_by_candidate(screened: Iterable[ScreenedCandidate]) -> list[ScreenedCandidate]:
    """The best guess of every kind, place and set of parameters, best first."""
    out: dict[tuple, ScreenedCandidate] = {}
    for candidate in sorted(screened, key=lambda candidate: -candidate.reduction):
        out.setdefault((candidate.kind, candidate.at, tuple(candidate.parameters)), candidate)
    return list(out.values())


class Search:
    """The moves from a base fit; screenings are made once for each set of causes.

    Parameters
    ----------
    base_fit : Fit
        Of the system as given.
    unseen : UnseenData
        Decides what is accepted.
    suspected : sequence of (kind, place, parameters)
        Causes that are fitted in the first round whatever the screening says: what the audit of the channels suspects.
    only_at : str, optional
        The one place where causes are looked for; everywhere if not given.

    Attributes
    ----------
    state : Selection
    """

    def __init__(
        self,
        system: System,
        base_fit: Fit,
        unseen: UnseenData,
        progress: Progress,
        suspected: Sequence[Suspected],
        only_at: str = "",
    ):
        self.only_at = only_at
        self.suspected, self.unseen, self.progress = suspected, unseen, progress
        self.settings = settings = unseen.settings
        self.left, self.windowed = settings.refits, settings.windowed
        self.in_place: dict[tuple[Cause, ...], list[Hypothesis]] = {}  # by the causes beside it
        self.dropped: set[frozenset[tuple[str, str]]] = set()  # kinds and places of what did not stand
        self.from_values: dict[tuple[Cause, ...], list[Hypothesis]] = {}  # the same, begun at the values of a cause
        self.done: dict[tuple, tuple[Hypothesis, Any]] = {}  # with the hypothesis: no other takes its identity
        screening = Screening(base_fit)
        recorded = recorded_range(system, base_fit.problem.data, screening.motion)
        model = ExtendedModel(system, (), dict(base_fit.problem.bounds), base_fit.values, recorded=recorded)
        base = Hypothesis(model, base_fit)
        draws = screening.draws = NoiseDraws(screening.mask.ravel(), screening.free)
        # of a model that leaves noise alone no candidate is ever asked for
        candidates = [] if scatters_only(base) else self._allowed(best_by_candidate(screening.candidates()))
        screening.draws = None
        self.known: dict[tuple[Cause, ...], tuple[Screening, list[ScreenedCandidate]]] = {(): (screening, candidates)}
        self.state = Selection(base, base, screening, candidates, draws.threshold())

    def _allowed(self, candidates: list[ScreenedCandidate]) -> list[ScreenedCandidate]:
        return [each for each in candidates if self.only_at in ("", each.at)]

    def run(self) -> None:
        """Add while that helps, then share, drop and exchange; add again where that has changed the causes."""
        state = self.state
        for _ in range(self.settings.rounds):
            self._grow()
            before = state.best.places
            self._settle(lambda hypothesis: hypothesis)
            if state.best.places == before:
                return

    def finish(self) -> Selection:
        """Move on with finer steps, and keep what competes with each cause: of a search whose answer is given."""
        state = self.state
        self.progress("final fit")
        state.best = final_fit(state.best)
        self._settle(final_fit)
        self.progress("rivals")
        state.rivals = [self._rivals(index) for index in range(len(state.best.causes))]
        state.compared = [self._compared(index) for index in range(len(state.best.causes))]
        if not state.best.causes:
            state.base = state.best
        return state

    def _grow(self) -> None:
        """Add causes, one or two at a time, while unseen data are met better with them."""
        state = self.state
        while len(state.best.causes) < self.settings.most_causes and not self._over(state.best):
            fitted = self._everywhere(state.best, self.promising(state.best))
            if not state.best.causes:
                state.with_one_cause = self.in_place[()] = fitted
            accepted = (
                self.first_accepted(fitted)
                or self.first_accepted(self.pairs(state.best))
                or self.first_accepted(self.pairs_in_place())
            )
            if accepted is None:
                return
            accepted = with_balanced_sensors(accepted, self.settings.far_from_noise)
            state.best = self._shared(self._of_right_angle(self.simplified(accepted)))

    def _settle(self, finished: Callable[[Hypothesis], Hypothesis]) -> None:
        """Share, simplify, drop and exchange until nothing changes; where the time is up, a cause is only dropped."""
        state = self.state
        for _ in range(self.settings.moves):
            changed = state.best
            if not self._late():
                changed = self._shared(state.best)
            if changed is state.best and not self._late():
                changed = self.simplified(state.best)
            if changed is state.best:
                changed = self._dropped() or self._exchanged() or self._pair_at_sensor() or state.best
            if changed is state.best:
                return
            state.best = finished(changed)

    def _late(self) -> bool:
        """Whether the time for the search is up."""
        return time_is_over(self.settings.search_share)

    def _take(self) -> bool:
        """Take one refit; whether there was one: a count, so that no answer depends on the machine, unless the caller
        limits the time."""
        if self._late():
            self.left = 0
        self.left -= 1
        return self.left >= 0

    def _over(self, best: Hypothesis) -> bool:
        """Whether nothing is left that a cause could explain, or a single one did not bring a model near its noise that
        is weighted by that: an offset would have, and weights with a memory hide it."""
        by_noise = best.fit.problem.weighting is None and bool(best.causes)
        return scatters_only(best) or (by_noise and largest_error(best.fit) > self.settings.far_from_noise)

    def promising(self, hypothesis: Hypothesis) -> list[ScreenedCandidate]:
        """The candidates of a round: the most promising, some at the components of the causes so far, and of further
        kinds the most promising place. To first order, where sensors are weighted with a memory, what lets an angle
        drift away promises little; what promises too little there to be accepted is not fitted."""
        least = self._least_promise(hypothesis)
        candidates = [each for each in self.screened(hypothesis)[1] if each.reduction > least]
        best, rest = candidates[: self.settings.candidates], candidates[self.settings.candidates :]
        named = {_component(place) for cause in hypothesis.causes for place in members(cause.at)}
        best += [each for each in rest if _component(each.at) in named][: self.settings.beside]
        seen = {candidate.kind for candidate in best}
        further: dict[str, ScreenedCandidate] = {}
        for candidate in rest:
            if candidate.kind not in seen:
                further.setdefault(candidate.kind, candidate)
        known = {candidate.kind_and_place for candidate in best}
        promised = best[0].reduction if best else self.state.noise_threshold
        suspected = [ScreenedCandidate(*one, promised) for one in self.suspected if one[:2] not in known]
        best = [*(one for one in suspected if not _taken(hypothesis, one)), *best]
        return [*best, *list(further.values())[: self.settings.kinds]]

    def _least_promise(self, hypothesis: Hypothesis) -> float:
        """What the screening has to promise of further causes for these to be worth a fit."""
        settings, weighted = self.settings, hypothesis.fit.problem.weighting is not None
        return settings.least_share / settings.beyond_promise * hypothesis.fit.cost if weighted else 0.0

    def screened(self, hypothesis: Hypothesis) -> tuple[Screening, list[ScreenedCandidate]]:
        """The screening of a hypothesis, and its candidates beyond what noise would promise, best first."""
        if hypothesis.causes not in self.known:
            screening = Screening(hypothesis.fit)
            found = self._allowed(best_by_candidate(screening.candidates(hypothesis.model.system())))
            self.known[hypothesis.causes] = screening, found
        screening, candidates = self.known[hypothesis.causes]
        least = self.state.noise_threshold
        return screening, [each for each in candidates if each.reduction > least and not _taken(hypothesis, each)]

    # --- Refits

    def refitted(self, parent: Hypothesis, candidates: list[ScreenedCandidate]) -> list[Hypothesis]:
        """Candidates added to a hypothesis one by one, everything uncertain free; best first.

        It ends when one leaves hardly anything and no other promises nearly as much.
        """
        out: list[Hypothesis] = []
        models: dict[Cause, ExtendedModel] = {}
        for number, candidate in enumerate(candidates):
            if out and self._explained(parent, out) and candidate.reduction < self._promise(out):
                break
            if number % SIDE_BY_SIDE == 0:
                batch = [self._with(parent, each) for each in candidates[number : number + SIDE_BY_SIDE]]
                models = {model.causes[-1]: model for model in compilable(batch)}
            model = models.get(Cause(candidate.kind, candidate.at, tuple(candidate.parameters)))
            hypothesis = None if model is None else self._refit(parent, candidate, model, out)
            if hypothesis is not None:
                out.append(hypothesis)
        out = self._sharpened(out)
        if out and not at_noise(out[0]):
            explained = parent.fit.cost - out[0].fit.cost
            again = [
                self._over_windows(parent, each)
                if each is out[0] or each.screened > self.settings.promising * explained
                else each
                for each in out
            ]
            out = self._sharpened(again)
        return distinct(out)

    def _everywhere(self, parent: Hypothesis, candidates: list[ScreenedCandidate]) -> list[Hypothesis]:
        """Candidates refitted, and the kind that explains most at further places too, where it leaves more than noise:
        to first order its neighbour may promise more."""
        out = self.refitted(parent, candidates)
        if not out or at_noise(out[0]):
            return out
        fitted = {(each.causes[-1].kind, each.causes[-1].at) for each in out}
        others: dict[tuple[str, str], ScreenedCandidate] = {}
        for candidate in self.screened(parent)[1]:
            if candidate.kind == out[0].causes[-1].kind and candidate.kind_and_place not in fitted:
                others.setdefault(candidate.kind_and_place, candidate)
        more = self.refitted(parent, list(others.values())[: self.settings.places])
        return distinct(sorted([*out, *more], key=lambda hypothesis: hypothesis.cost))

    def _over_windows(self, parent: Hypothesis, hypothesis: Hypothesis) -> Hypothesis:
        """A hypothesis whose last cause is a free play, fitted over short windows first, where that is better."""
        cause = hypothesis.causes[-1]
        if not EFFECTS[cause.kind].free_play or self.windowed == 0 or not self._take():
            return hypothesis
        self.windowed -= 1
        self.progress(f"{cause.kind} at {cause.at} over short windows")
        motion = self.known[parent.causes][0].motion_as_measured()
        gap, wider = cause.names()[EFFECTS[cause.kind].free_play], self.settings.wider_gaps
        try:
            fit = fit_from_windows(hypothesis.model, parent.fit, motion, gap, wider, hypothesis.fit.cost)
        except FitError:
            return hypothesis
        return hypothesis if fit is None else replace(hypothesis, fit=fit)

    def _explained(self, parent: Hypothesis, fitted: list[Hypothesis]) -> bool:
        best = min(fitted, key=lambda hypothesis: hypothesis.cost)
        return at_noise(best) or share_explained(parent, best) > self.settings.explains_almost_all

    def _promise(self, fitted: list[Hypothesis]) -> float:
        return self.settings.promising * max(hypothesis.screened for hypothesis in fitted)

    def _refit(
        self, parent: Hypothesis, candidate: ScreenedCandidate, model: ExtendedModel, others: list[Hypothesis]
    ) -> Hypothesis | None:
        if not self._take():
            return None
        self.progress(f"{candidate.kind} at {candidate.at}")
        rival = min((hypothesis.fit.cost for hypothesis in others), default=0.0)
        noise = min((hypothesis.fit.cost for hypothesis in others if at_noise(hypothesis)), default=0.0)
        try:
            fit = fit_extended(model, parent.fit, replace(SEARCH, rival_cost=rival, noise_cost=noise))
        except FitError as reason:
            self.state.failed.setdefault(candidate.kind_and_place, str(reason))
            return None
        return Hypothesis(model, fit, candidate.reduction)

    def _with(self, parent: Hypothesis, *candidates: ScreenedCandidate) -> ExtendedModel:
        """The model of a hypothesis with further causes, to begin where its fit ended."""
        data = parent.fit.problem.data
        model = replace(parent.model, bounds=parent.fit.problem.bounds, values=parent.fit.values, starts=())
        for candidate in candidates:
            model = model.with_cause(candidate.kind, candidate.at, candidate.parameters, data.sampling_interval)
        return model

    def _sharpened(self, hypotheses: list[Hypothesis]) -> list[Hypothesis]:
        """Hypotheses, best first; those near the best fitted to their end, with dry friction as sharp as it takes to
        compare them."""
        out = sorted(hypotheses, key=lambda hypothesis: hypothesis.cost)
        near = self.settings.near_ratio * out[0].cost if out else 0.0
        for i, hypothesis in enumerate(out[: self.settings.near_best]):
            if hypothesis.cost < near and not self._late():
                out[i] = replace(hypothesis, fit=self._finished(with_sharper_friction(self._finished(hypothesis.fit))))
            if i == 0 and at_noise(out[0]):  # nothing is left that sharper friction could take in another's place
                break
        out.sort(key=lambda hypothesis: hypothesis.cost)
        out[:1] = [with_sharpest_friction(hypothesis) for hypothesis in out[:1]]
        return sorted(out, key=lambda hypothesis: hypothesis.cost)

    def _finished(self, fit: Fit) -> Fit:
        """A fit that goes on where its iterations ended before it did."""
        if not fit.unfinished:
            return fit
        return solve(fit.problem, fit.v, fit.jacobian, replace(SEARCH, iterations=self.settings.iterations))

    # --- Add

    def first_accepted(self, fitted: list[Hypothesis]) -> Hypothesis | None:
        """The first of hypotheses, best first, that explains more than chance, is possible, and meets unseen data
        better beyond chance."""
        for hypothesis in fitted[: self.settings.judged]:
            if not self._worthwhile(hypothesis):
                return None
            if len(hypothesis.causes) > 1 and hypothesis.model.not_taken(hypothesis.fit) == "not_physical":
                hypothesis = self.simplified(hypothesis)  # the further cause has left an earlier one too little
            if hypothesis.model.not_taken(hypothesis.fit) or frozenset(hypothesis.places) in self.dropped:
                continue
            small = hypothesis.model.negligible(hypothesis.fit)
            if small and not self._explains_much(hypothesis, self.state.best):
                self._refuse(hypothesis, "negligible")
                continue
            if self._all_explained(hypothesis, self.state.best) or self.unseen.accepts(hypothesis, self.state.best):
                return hypothesis
            worse = self.unseen.misfit(hypothesis) > self.unseen.misfit(self.state.best)
            self._refuse(hypothesis, "worse_unseen" if worse else "by_chance")
        return None

    def _refuse(self, hypothesis: Hypothesis, reason: str) -> None:
        """Put on record why a single cause was refused; the last reason stands."""
        if len(hypothesis.causes) == 1:
            self.state.refused[hypothesis.causes[0].kind, hypothesis.causes[0].at] = reason

    def _all_explained(self, hypothesis: Hypothesis, rest: Hypothesis) -> bool:
        """Whether a cause leaves noise alone where clearly more is left without it. No unseen data are needed then:
        nothing is left that could tell it from the truth, and what happens once, in one block, no other block
        foretells."""
        return at_noise(hypothesis) and largest_error(rest.fit) > self.settings.clearly_beyond

    def _worthwhile(self, child: Hypothesis) -> bool:
        """Whether further causes explain more of the fitted data than noise would, more than their parameters cost, and
        more than a slight part of the misfit."""
        parent = self.state.best
        least = max(self.state.noise_threshold, _price(child) - _price(parent)) * child.chi_square_per_reading
        return parent.chi_square - child.chi_square > least and (
            share_explained(parent, child) >= self.settings.least_share
        )

    def pairs(self, parent: Hypothesis, instead_of: Cause | None = None) -> list[Hypothesis]:
        """A hypothesis with two causes more: pairs of candidates that promise much of what the best alone would leave.
        What one adds to the readings the other may take away, so that neither gains much alone."""
        if len(parent.causes) + 2 > self.settings.most_causes:
            return []
        self.progress("pairs of causes")
        screening, candidates = self.screened(parent)
        if instead_of is not None:
            candidates = [each for each in candidates if each.kind_and_place != (instead_of.kind, instead_of.at)]
        out: list[Hypothesis] = []
        for pair in screened_pairs(screening, candidates, self.settings)[: self.settings.pairs]:
            model = self._with(parent, pair.first, pair.second)
            if pair.reduction < self._least_promise(parent) or not compilable([model]) or not self._take():
                continue
            try:
                fit = fit_extended(model, parent.fit)
            except FitError as reason:
                for one in (pair.first, pair.second):
                    self.state.failed.setdefault(one.kind_and_place, f"as one of a pair: {reason}")
                continue
            out.append(Hypothesis(model, fit, pair.reduction))
        return self._sharpened(out)

    def pairs_in_place(self) -> list[Hypothesis]:
        """The best hypothesis with two causes in the place of one: that takes what both do as far as it can, and leaves
        a fit from which neither is seen."""
        best, out = self.state.best, list[Hypothesis]()
        for index, cause in enumerate(best.causes):
            rest = None if self._late() else self._without(index)
            if rest is not None:
                out += self._once(self.pairs, rest, cause)
        return sorted(out, key=lambda hypothesis: hypothesis.cost)

    # --- Simplify

    def simplified(self, hypothesis: Hypothesis) -> Hypothesis:
        """A hypothesis with simpler kinds in the place of causes that have one which explains as much: both are fitted,
        and the simpler one is a rival from then on where it is not taken."""
        for index, cause in enumerate(hypothesis.causes):
            values = {key: hypothesis.fit.values[name] for key, name in cause.names().items()}
            impossible = not EFFECTS[cause.kind].possible(values)
            for simpler in self._once(self._simpler, hypothesis, index):
                as_good = self._explains_as_much(simpler, hypothesis)
                if impossible or (as_good and self._stands_as_well(simpler, hypothesis, index)):
                    return self.simplified(simpler)
        return hypothesis

    def _stands_as_well(self, simpler: Hypothesis, hypothesis: Hypothesis, index: int) -> bool:
        """Whether a simpler kind in the place of a cause meets unseen data better than neither of both, if that cause
        does: else it would be dropped afterwards, and nothing would be left of what was found."""
        if at_noise(simpler):
            return True
        rest = self._once(without, hypothesis, index) if len(hypothesis.causes) > 1 else self.state.base
        if rest is None or not self.unseen.accepts(hypothesis, rest):
            return True
        return self.unseen.accepts(simpler, rest)

    def _simpler(self, hypothesis: Hypothesis, index: int) -> list[Hypothesis]:
        """A hypothesis with simpler kinds in the place of one of its causes, fitted; as rivals of that as well."""
        return self._fitted_in_place(hypothesis, index, list(simpler_models(hypothesis, index)))

    def _fitted_in_place(self, hypothesis: Hypothesis, index: int, models: list[ExtendedModel]) -> list[Hypothesis]:
        """Models with another cause in the place of one of a hypothesis, fitted from its values; as rivals of that as
        well."""
        beside = tuple(cause for i, cause in enumerate(hypothesis.causes) if i != index)
        out = []
        for model in compilable(models):
            try:
                fit = fit_extended(model, hypothesis.fit)
            except FitError as reason:
                self.state.failed.setdefault((model.causes[-1].kind, model.causes[-1].at), str(reason))
                continue
            out.append(with_sharpest_friction(Hypothesis(model, fit, hypothesis.screened)))
        self.from_values.setdefault(beside, []).extend(out)
        return out

    def _explains_as_much(self, simpler: Hypothesis, hypothesis: Hypothesis) -> bool:
        """Whether a kind yields to a simpler one: that is as likely for fewer variables, or, where more than noise is
        left, unseen data are not met better without it beyond chance."""
        saved = len(hypothesis.fit.v) - len(simpler.fit.v)
        price = float(np.log(hypothesis.fit.problem.data.readings_count)) * hypothesis.chi_square_per_reading
        if simpler.chi_square < hypothesis.chi_square + saved * price:
            return True
        return not at_noise(hypothesis) and not self.unseen.accepts(hypothesis, simpler)

    def _of_right_angle(self, hypothesis: Hypothesis) -> Hypothesis:
        """A hypothesis with a ripple over another angle in the place of one, where that leaves less and meets unseen
        data better: far from the truth, the screening may take the angles of a shaft's ends for each other."""
        for index in range(0 if self._late() else len(hypothesis.causes)):
            models = [
                model for model in list(akin_models(hypothesis, index))[: self.settings.exchanged] if self._take()
            ]
            for other in sorted(self._fitted_in_place(hypothesis, index, models), key=lambda other: other.cost):
                better = at_noise(other) or self.unseen.prefers(other, hypothesis)
                if other.cost < hypothesis.cost and better and not other.model.not_taken(other.fit):
                    return self._of_right_angle(_in_place(other, index))
        return hypothesis

    # --- Drop

    def _dropped(self) -> Hypothesis | None:
        """The best hypothesis without a cause that does not stand, the last first."""
        best = self.state.best
        for index in reversed(range(len(best.causes))):
            rest = self._without(index)
            if rest is not None and not self._stands(index, rest):
                self.dropped.add(frozenset(best.places))
                self._refuse(best, "within_uncertainty" if self.unseen.keeps(best, rest) else "by_chance")
                return rest
        return None

    def _stands(self, index: int, rest: Hypothesis) -> bool:
        """The rule of acceptance: a cause is told from nothing, and unseen data are met better with it than by the rest
        alone."""
        best, beyond = self.state.best, self.settings.beyond
        if self._all_explained(best, rest):
            return True
        if not self._explains_much(best, rest):
            nothing = best.model.negligible(best.fit, index)
            if nothing or not differs_from_nothing(best, best.causes[index], fitted_values(best, [best.fit]), beyond):
                return False
        return self.unseen.keeps(best, rest)

    def _explains_much(self, hypothesis: Hypothesis, rest: Hypothesis) -> bool:
        """Whether a cause explains so much of unseen data, beyond the noise, that its size decides nothing: a torque is
        small beside that which a heavy body is moved by, and two of its values may be uncertain where both together are
        not."""
        if at_noise(hypothesis):
            return False
        return bool(self.unseen.shares_explained(hypothesis, rest).max() >= self.settings.least_share)

    def _without(self, index: int) -> Hypothesis | None:
        """The best hypothesis without a cause, fitted from its values; a model without causes that this frees from a
        local minimum is the base from then on."""
        best = self.state.best
        rest = self._once(without, best, index)
        if rest is None or rest.causes:
            return rest
        if _lower(rest.fit, self.state.base.fit):
            self.state.base = final_fit(rest)
        return self.state.base

    # --- Exchange

    def _exchanged(self) -> Hypothesis | None:
        """The best hypothesis with another cause in the place of one that is likelier: it has less of χ² and variables.

        Where more than noise is left, unseen data decide: it meets them better, with a χ² that is not higher by more
        than makes no difference."""
        best = self.state.best
        for index in range(0 if self._late() else len(best.causes)):
            for other in self._rivals(index):
                if other.model.not_taken(other.fit) or frozenset(other.places) in self.dropped:
                    continue
                as_low = other.cost < (best.cost if at_noise(other) else best.cost * (1 + self.settings.slight_rise))
                better = self.unseen.accepts if is_simpler(best.causes[index], other) else self.unseen.prefers
                if as_low and (at_noise(other) or better(other, best)):
                    return _in_place(with_balanced_sensors(other, self.settings.far_from_noise), index)
        return None

    def _pair_at_sensor(self) -> Hypothesis | None:
        """The best hypothesis with gain and delay, offset and delay, or gain and offset of a sensor in the place of its
        faults, where that is likelier and leaves less of unseen data. No single fault is near such a pair: alone each
        of both explains less than a fault that the sensor does not have."""
        best = self.state.best
        faults = [cause.at for cause in best.causes if cause.kind in SENSOR_FAULTS and cause.at.startswith("sensors.")]
        for at in dict.fromkeys(faults):
            if self._late() or at_noise(best) or len(members(at)) > 1:
                continue
            rest = best
            for index in reversed([i for i, cause in enumerate(best.causes) if cause.at == at]):
                smaller = self._once(without, rest, index) if len(rest.causes) > 1 else self.state.base
                rest = rest if smaller is None else smaller
            if any(cause.at == at for cause in rest.causes) or len(rest.causes) + 2 > self.settings.most_causes:
                continue
            for other in self._once(self._with_pair_at, rest, at):
                taken = other.places == best.places or frozenset(other.places) in self.dropped
                likelier = other.cost < best.cost and self.unseen.pooled(other) < self.unseen.pooled(best)
                if not taken and likelier and not other.model.not_taken(other.fit):
                    return with_balanced_sensors(other, self.settings.far_from_noise)
        return None

    def _with_pair_at(self, rest: Hypothesis, at: str) -> list[Hypothesis]:
        """A hypothesis with each pair of faults at a sensor, fitted from several delays, best first."""
        out: list[Hypothesis] = []
        step = rest.fit.problem.data.sampling_interval
        for pair in sensor_pairs(rest.fit, at):
            model = replace(rest.model, bounds=rest.fit.problem.bounds, values=rest.fit.values, starts=())
            for kind, values in pair:
                model = model.with_cause(kind, at, values, step)
            if not compilable([model]) or not self._take():
                continue
            with contextlib.suppress(FitError):
                out.append(Hypothesis(model, fit_extended(model, rest.fit), rest.screened))
        return distinct(sorted(out, key=lambda hypothesis: hypothesis.cost))

    def _rivals(self, index: int) -> list[Hypothesis]:
        """Hypotheses with another cause in the place of one of the best's, weighted as the best; those near it are
        fitted as finely where it leaves noise."""
        best = self.state.best
        beside = tuple(cause for i, cause in enumerate(best.causes) if i != index)
        if beside not in self.in_place:
            rest = self._without(index)
            candidates = [] if rest is None else self.screened(rest)[1][: self.settings.exchanged]
            self.in_place[beside] = [] if rest is None else self._everywhere(rest, candidates)
        by_noise = best.fit.problem.weighting is None
        known = [self._once(weighted, other, by_noise) for other in self._in_place_of(beside)]
        others = [other for other in known if other.places != best.places]
        others.sort(key=lambda other: other.cost)
        if at_noise(best):
            near = [o for o in others if o.cost < best.cost + self.settings.out_of_question]
            fine = [self._once(final_fit, other) for other in near[: self.settings.fine_rivals]]
            others = sorted([*fine, *(o for o in others if o not in near)], key=lambda other: other.cost)
        return others

    def _compared(self, index: int) -> Hypothesis:
        """The best hypothesis, to be weighed against the rivals of one of its causes. Those near it are finished as it
        is; where the time was up before, it is taken as it was fitted beside them: one that went on longer would leave
        less than they for that alone."""
        best = self.state.best
        if not self._late() or at_noise(best):
            return best
        beside = tuple(cause for i, cause in enumerate(best.causes) if i != index)
        by_noise = best.fit.problem.weighting is None
        same = [other for other in self._in_place_of(beside) if other.places == best.places]
        return self._once(weighted, same[0], by_noise) if same else best

    def _in_place_of(self, beside: tuple[Cause, ...]) -> list[Hypothesis]:
        """What was fitted beside some causes, from the values of what was named there as well."""
        return distinct([*self.from_values.get(beside, []), *self.in_place.get(beside, [])])

    def _once(self, what: Callable[..., Any], hypothesis: Hypothesis, *given: Any) -> Any:
        """What a function makes of a hypothesis, made once."""
        key = (what, id(hypothesis), *given)
        if key not in self.done:
            self.done[key] = hypothesis, what(hypothesis, *given)
        return self.done[key][1]

    # --- Share

    def _shared(self, hypothesis: Hypothesis) -> Hypothesis:
        """A hypothesis whose causes of one kind at several channels are one, unless several sizes are likelier and meet
        unseen data better beyond chance; so too where channels are recorded late by the same time, whatever the kinds
        that say so."""
        late = tuple(cause for cause in hypothesis.causes if cause.kind in LATE_SIGN)
        for causes in dict.fromkeys((*combinations(hypothesis.causes, 2), *combinations(late, len(late)))):
            shared = _shared(hypothesis, causes)
            joined = None if shared is None or not self._take() else _joined(hypothesis, causes, shared)
            if shared is not None and joined is not None and self._as_good(joined, hypothesis):
                return self._shared(self._without_idle_inputs(joined, shared))
        return hypothesis

    def _without_idle_inputs(self, joined: Hypothesis, shared: _SharedCause) -> Hypothesis:
        """A hypothesis whose clock has only those inputs that speak for it.

        Which logger an input belongs to that hardly acts cannot be seen; as one more late channel it would be invented.
        """
        for place in members(shared.at):
            few = [other for other in members(shared.at) if other != place]
            if shared.kind != ClockOffset.kind or not few or not place.startswith("inputs.") or not self._take():
                continue
            fewer = _of_channels(joined.model.base, few, shared.sizes["offset"])
            cause = next(cause for cause in joined.causes if (cause.kind, cause.at) == (shared.kind, shared.at))
            without = _joined(joined, [cause], fewer)
            if without is not None and self._as_good(without, joined):
                return self._without_idle_inputs(without, fewer)
        return joined

    def _as_good(self, simpler: Hypothesis, hypothesis: Hypothesis) -> bool:
        return simpler.cost < hypothesis.cost or not self.unseen.accepts(hypothesis, simpler)


def weighted(hypothesis: Hypothesis, by_noise: bool) -> Hypothesis:
    """A hypothesis that is weighted by noise, or else by what it leaves."""
    fit = hypothesis.fit
    if (fit.problem.weighting is None) == by_noise:
        return hypothesis
    return replace(hypothesis, fit=reweighted(fit, None if by_noise else discrepancy(fit)))


def _lower(fit: Fit, other: Fit) -> bool:
    """Whether a fit leaves less than another one of the same data, in the same weights."""
    same = fit.residual.shape == other.residual.shape and fit.problem.weighting is other.problem.weighting
    return same and fit.cost < other.cost


def _in_place(hypothesis: Hypothesis, index: int) -> Hypothesis:
    """The same with its last cause at a place among the others."""
    *rest, last = hypothesis.causes
    causes = (*rest[:index], last, *rest[index:])
    return replace(hypothesis, model=replace(hypothesis.model, causes=causes))


def simpler_models(hypothesis: Hypothesis, index: int) -> Iterator[ExtendedModel]:
    """Models with simpler kinds, which behave alike at its values, in the place of a cause."""
    cause, fit, system = hypothesis.causes[index], hypothesis.fit, hypothesis.model.base
    rest = hypothesis.model.without_cause(index, fit)
    for simpler in simpler_kinds(hypothesis, index):
        kind, at = simpler.kind, simpler.at
        fewer = len(simpler.parameters) < len(cause.keys)
        if fewer and not (EFFECTS[kind].replaces_quantity and system.parameters[at].uncertain):
            yield rest.with_cause(kind, at, simpler.parameters, fit.problem.data.sampling_interval)


def akin_models(hypothesis: Hypothesis, index: int) -> Iterator[ExtendedModel]:
    """Models with an effect in the place of a cause that a search may have taken that for; none at the noise."""
    cause, fit = hypothesis.causes[index], hypothesis.fit
    if at_noise(hypothesis) or not EFFECTS[cause.kind].zero_mean:  # only what repeats over an angle has any
        return
    rest = hypothesis.model.without_cause(index, fit)
    values = {key: fit.values[name] for key, name in cause.names().items()}
    for kind, at, parameters in EFFECTS[cause.kind].akin(cause.at, values, simulated_motion(fit)):
        if (kind, at) not in hypothesis.places:
            yield rest.with_cause(kind, at, parameters, fit.problem.data.sampling_interval)


def _component(place: str) -> str:
    """The inertia, shaft, gear or channel of a place, which may be a quantity of it."""
    return ".".join(place.split(".")[:2])


def _taken(hypothesis: Hypothesis, candidate: ScreenedCandidate) -> bool:
    """Whether a hypothesis, or the model as given, has the candidate, or another dry friction at its place; one that
    grows with the load may stand beside one that does not."""

    def rubs(kind: str) -> bool:
        return EFFECTS[kind].sticks and "torque" in EFFECTS[kind].file_keys

    def late(kind: str) -> bool:  # a clock is not also a delay or a lag
        return EFFECTS[kind].only_delays or EFFECTS[kind].is_clock or kind == "lag"

    def alike(kind: str) -> bool:
        both_rub, both_late = (what(candidate.kind) and what(kind) for what in (rubs, late))
        return candidate.kind == kind or both_rub or both_late

    places = set(members(candidate.at))
    given = {(effect.kind, place) for effect in hypothesis.model.base.effects for place in effect.places}
    if any((candidate.kind, place) in given for place in places):
        return True
    return any(alike(kind) and not places.isdisjoint(members(at)) for kind, at in hypothesis.places)


def without(hypothesis: Hypothesis, index: int, iterations: int = 80) -> Hypothesis | None:
    """All causes of a hypothesis but one, fitted; None where they do not simulate without it."""
    model = hypothesis.model.without_cause(index, hypothesis.fit)
    try:
        fit = fit_extended(model, hypothesis.fit, FitOptions(iterations, exact=False))
        return with_sharpest_friction(Hypothesis(model, fit))
    except FitError:
        return None


def distinct(hypotheses: list[Hypothesis]) -> list[Hypothesis]:
    """Without those that name the same causes in another order or with fewer or more parameters; the first is kept."""
    out: dict[frozenset, Hypothesis] = {}
    for hypothesis in hypotheses:
        out.setdefault(frozenset(hypothesis.places), hypothesis)
    return list(out.values())


def _price(hypothesis: Hypothesis) -> float:
    """What parameters and states of a fit cost in χ² (Schwarz 1978): a refit finds more in noise than a screening."""
    problem = hypothesis.fit.problem
    return (len(problem.free) + len(problem.model.states)) * float(np.log(problem.data.readings_count))


# --- One cause for several channels: a filter, a clock or a supply that these share.
#
# Groups by the measured quantity compete from the start. A logger may have some channels of a quantity and lack others,
# and inputs beside sensors; its delay is then found channel by channel, by the kind that each channel has for it.

ALIKE = 1.5  # ratio of two sizes from which they are not tried as one
SPREAD = 0.5  # of the offset between two loggers: channels of one that differ by more are not of one


@dataclass(frozen=True)
class _SharedCause:
    """A cause that stands for several: its place, and first values of its parameters."""

    kind: str
    at: str
    sizes: dict[str, float]


def _shared(hypothesis: Hypothesis, causes: Sequence[Cause]) -> _SharedCause | None:
    """What causes may be together; None where they are not alike."""
    if len(causes) < 2:
        return None
    first = causes[0]
    tables = {place.split(".")[0] for cause in causes for place in members(cause.at)}
    if len(tables) > 1 or any(cause.kind != first.kind for cause in causes):
        return _one_clock(hypothesis, causes) if all(cause.kind in LATE_SIGN for cause in causes) else None
    if not EFFECTS[first.kind].shareable or any(cause.keys != first.keys for cause in causes):
        return None
    values = hypothesis.fit.values
    sizes = np.array([[values[cause.names()[key]] for key in cause.keys] for cause in causes])
    if not all(_alike(column) for column in sizes.T):
        return None
    places = [place for cause in causes for place in members(cause.at)]
    if first.kind == SensorDelay.kind:
        return _of_channels(hypothesis.model.base, places, float(sizes.mean()))
    return _SharedCause(
        first.kind, shared_place(places), dict(zip(first.keys, sizes.mean(axis=0).tolist(), strict=True))
    )


def _one_clock(hypothesis: Hypothesis, causes: Sequence[Cause]) -> _SharedCause | None:
    """The clock of the logger with fewer channels, where the times of all channels are those of two loggers.

    Only differences of times show in a recording: a logger that is late is another one that is early.
    """
    system = hypothesis.model.base
    parts = [*(("inputs", part.name) for part in system.inputs), *(("sensors", part.name) for part in system.sensors)]
    offsets = {".".join(part): 0.0 for part in parts}
    for cause in causes:
        (name,) = cause.names().values()
        for place in members(cause.at):
            offsets[place] += recorded_late(cause.kind, hypothesis.fit.values[name])
    middle = (max(offsets.values()) + min(offsets.values())) / 2
    late = [place for place in offsets if offsets[place] > middle]
    early = [place for place in offsets if offsets[place] <= middle]
    few, rest = (late, early) if len(late) <= len(early) else (early, late)
    reference = float(np.mean([offsets[place] for place in rest]))
    differences = np.array([offsets[place] - reference for place in few])
    spread = np.ptp([offsets[place] for place in rest])
    if not few or not _alike(differences) or spread > SPREAD * np.abs(differences).min():
        return None
    return _of_channels(system, few, float(differences.mean()))


def _of_channels(system: System, few: Sequence[str], offset: float) -> _SharedCause:
    """How channels that are ``offset`` s late are named: sensors that read late, inputs that act late, else a clock, as
    where all sensors are late."""
    tables = {place.split(".")[0] for place in few}
    if offset > 0 and tables == {"sensors"} and len(few) < len(system.sensors):
        return _SharedCause(SensorDelay.kind, shared_place(few), {"delay": offset})
    if offset < 0 and tables == {"inputs"}:
        return _SharedCause(DeadTime.kind, shared_place(few), {"delay": -offset})
    return _SharedCause(ClockOffset.kind, shared_place(few), {"offset": offset})


def _alike(sizes: np.ndarray) -> bool:
    """Whether sizes (c,) have one sign and are near each other."""
    magnitudes = np.abs(sizes)
    return bool((np.sign(sizes) == np.sign(sizes[0])).all() and magnitudes.max() <= ALIKE * magnitudes.min())


def _joined(hypothesis: Hypothesis, causes: Sequence[Cause], shared: _SharedCause) -> Hypothesis | None:
    """The hypothesis with one cause in the place of several, fitted; None where there is none."""
    fit, model = hypothesis.fit, hypothesis.at_fit()
    removed = {name for cause in causes for name in cause.names().values()}
    kept = set(model.bounds) - removed
    model = replace(
        model, causes=tuple(cause for cause in model.causes if cause not in causes),
        bounds={name: model.bounds[name] for name in kept}, values={name: model.values[name] for name in kept},
    )  # fmt: skip
    model = model.with_cause(shared.kind, shared.at, shared.sizes, fit.problem.data.sampling_interval)
    if not compilable([model]):
        return None
    try:
        return Hypothesis(model, fit_extended(model, fit), hypothesis.screened)
    except FitError:
        return None


# --- Two causes at once: pairs of candidates that take more of the residual together than the best takes alone.
#
# A search that adds one cause after another goes wrong where two hide each other: what one adds to the readings the
# other takes away, so that neither gains much alone. To first order the gain of a pair follows from the signatures that
# the screening has anyway; only the few most promising pairs are fitted.

DEPENDENT = 1e-6  # of a signature's length: what is left by others that take its place


@dataclass(frozen=True)
class ScreenedPair:
    """Two candidates with their guesses at the amplitudes they have together, and how much of χ² they would take."""

    first: ScreenedCandidate
    second: ScreenedCandidate
    reduction: float


def screened_pairs(
    screening: Screening, candidates: Sequence[ScreenedCandidate], settings: DiagnosisSettings
) -> list[ScreenedPair]:
    """Pairs of the best candidates that promise much of what the best alone would leave, the most promising first.

    Parameters
    ----------
    candidates : sequence of ScreenedCandidate
        Of ``screening``, best first.
    """
    best = [candidate for candidate in candidates if candidate.guess is not None][: settings.paired]
    rows = [_signatures(screening, candidate) for candidate in best]
    pairs = []
    alone = best[0].reduction if best else 0.0
    rest = float(screening.residual @ screening.residual) - float(np.count_nonzero(screening.mask)) - alone
    if rest <= 0:  # the best leaves no more than noise
        return []
    least = settings.pair_gain * rest
    for i, j in combinations(range(len(best)), 2):
        if best[i].kind == best[j].kind and not set(members(best[i].at)).isdisjoint(members(best[j].at)):
            continue
        pair = _pair(screening, best[i], best[j], (rows[i], rows[j]))
        if pair is not None and pair.reduction - best[0].reduction > least:
            pairs.append(pair)
    return sorted(pairs, key=lambda pair: -pair.reduction)


def _signatures(screening: Screening, candidate: ScreenedCandidate) -> np.ndarray:
    """(a, r) of a candidate's guess, without what base parameters and start states can take."""
    assert candidate.guess is not None
    rows = np.array([screening.signature(dict(addition)) for addition in candidate.guess.additions])
    return rows - (rows @ screening.basis) @ screening.basis.T


def _pair(
    screening: Screening, first: ScreenedCandidate, second: ScreenedCandidate, rows: tuple[np.ndarray, np.ndarray]
) -> ScreenedPair | None:
    """Two candidates together; None where they depend on each other or no such effects exist."""
    assert first.guess is not None
    assert second.guess is not None
    both = np.concatenate(rows)
    lengths = np.linalg.norm(both, axis=1)
    if not (np.isfinite(lengths).all() and (lengths > 0).all()):
        return None
    span, triangle = np.linalg.qr((both / lengths[:, None]).T)
    if np.abs(np.diag(triangle)).min() < DEPENDENT:
        return None
    along = span.T @ screening.residual
    amplitudes = np.linalg.solve(triangle, along) / lengths
    parameters = first.guess.parameters(amplitudes[: len(rows[0])])
    others = second.guess.parameters(amplitudes[len(rows[0]) :])
    if parameters is None or others is None:
        return None
    return ScreenedPair(replace(first, parameters=parameters), replace(second, parameters=others), float(along @ along))


# --- Two faults of one sensor.

SENSOR_FAULTS = (SensorGain.kind, SensorOffset.kind, SensorDelay.kind, "sensor_drift", "gain_drift", "lag")
LONGEST_DELAY_SHARE = 0.1  # of the longest segment: the largest delay from which a pair of faults is fitted
DELAYS = 24  # that are looked at, geometrically from half a sample
OTHER_STARTS = (1.0, 0.5, 2.0)  # times the likeliest delay, from which a fit begins


def sensor_pairs(fit: Fit, at: str) -> Iterator[list[tuple[str, dict[str, float]]]]:
    """Pairs of faults of a sensor, kind and first values: readings as gain and offset of what a fit simulates, by least
    squares at each of several delays."""
    system, segments = fit.problem.system, fit.problem.data.segments
    j = [f"sensors.{sensor.name}" for sensor in system.sensors].index(at)
    simulated = [y[:, j] for y in fit.problem.simulated(fit.v)]
    longest = LONGEST_DELAY_SHARE * max(float(np.ptp(segment.time)) for segment in segments)
    delays = np.geomspace(0.5 * fit.problem.data.sampling_interval, longest, DELAYS)

    def regressed(delay: float, gain: bool) -> tuple[float, float, float]:
        """Squares that are left, gain, offset."""
        late = [np.interp(s.time - delay, s.time, y) for s, y in zip(segments, simulated, strict=True)]
        read = np.concatenate([segment.readings[:, j] for segment in segments])
        known, model = np.isfinite(read), np.concatenate(late)
        own, of_model = read[known], model[known]
        factor, offset = (
            np.polyfit(of_model, own, 1) if gain and np.ptp(of_model) > 0 else (1.0, np.mean(own - of_model))
        )
        return float(np.sum((own - factor * of_model - offset) ** 2)), float(factor), float(offset)

    likeliest = float(min(delays, key=lambda delay: regressed(delay, True)[0]))
    for share in OTHER_STARTS:
        _, factor, offset = regressed(share * likeliest, True)
        yield [(SensorGain.kind, {"factor": factor}), (SensorDelay.kind, {"delay": share * likeliest})]
        _, _, shift = regressed(share * likeliest, False)
        yield [(SensorOffset.kind, {"offset": shift}), (SensorDelay.kind, {"delay": share * likeliest})]
    _, factor, offset = regressed(0.0, True)
    yield [(SensorGain.kind, {"factor": factor}), (SensorOffset.kind, {"offset": offset})]


# --- A time window of long data in which causes are searched for: their kind shows in seconds, their size in all data.

WINDOWS_PER_LENGTH = 8  # windows that are compared begin this many times in the length of one


@dataclass(frozen=True)
class _SearchWindow:
    """Samples of a segment and the mean of their squared residuals (all sensors)."""

    square: float
    segment: int
    first: int
    last: int


def search_window(base: Fit, most: int) -> FitData | None:
    """The window of long data where a base fit is worst, of at most ``most`` readings; None of short data.

    Where segments are shorter than that, the next worst windows are taken too.
    """
    data = base.problem.data
    if data.readings_count <= most:
        return None
    readings_per_sample = data.readings_count / sum(len(segment.time) for segment in data.segments)
    left = int(most / readings_per_sample)
    windows: list[_SearchWindow] = []
    residuals = dict(enumerate(base.by_sensor()))
    while residuals and left >= FEWEST_SAMPLES:
        worst = max((_worst_window(i, r, left) for i, r in residuals.items()), key=lambda window: window.square)
        del residuals[worst.segment]
        if worst.last - worst.first >= FEWEST_SAMPLES:
            windows.append(worst)
            left -= worst.last - worst.first
    windows.sort(key=lambda window: window.segment)
    return replace(data, segments=tuple(data.segments[w.segment].part(w.first, w.last) for w in windows))


def _worst_window(segment: int, residual: np.ndarray, most: int) -> _SearchWindow:
    """The window of at most so many samples with the largest mean square of a residual (t, y)."""
    length = min(len(residual), most)
    total = np.concatenate([[0.0], np.cumsum(np.sum(residual**2, axis=1))])
    last_start = len(residual) - length
    starts = np.unique(np.append(np.arange(0, last_start, max(length // WINDOWS_PER_LENGTH, 1)), last_start))
    squares = (total[starts + length] - total[starts]) / length
    worst = int(np.argmax(squares))
    return _SearchWindow(float(squares[worst]), segment, int(starts[worst]), int(starts[worst]) + length)
