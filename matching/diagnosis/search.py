"""The search for causes: one after another, each accepted by unseen data; then what is not needed is dropped.

A round screens the residual for every kind at every place, refits the most promising candidates with everything
uncertain free, and accepts the best that meets unseen data better beyond chance. Where none does, two are tried
together. At the end each cause is left out and exchanged in turn.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from matching.diagnosis.causes import Cause, ExtendedModel, compilable, recorded_range
from matching.diagnosis.data import FEWEST_SAMPLES, FitData, Segment
from matching.diagnosis.descent import Fit, FitOptions, solve, with_sharper_friction
from matching.diagnosis.screening import (
    NoiseDraws,
    ScreenedCandidate,
    Screening,
    fit_extended,
)
from matching.diagnosis.selection import (
    Hypothesis,
    UnseenData,
    at_noise,
    largest_error,
    scatters_only,
    share_explained,
    with_balanced_sensors,
    with_sharpest_friction,
)
from matching.diagnosis.settings import DiagnosisSettings
from matching.diagnosis.shared_causes import RefitBudget, with_shared_causes
from matching.diagnosis.windows import fit_from_windows
from modelling.effects import EFFECTS
from modelling.effects.effect import members
from modelling.errors import FitError
from modelling.resources import time_is_over
from modelling.system import System

SIDE_BY_SIDE = 4  # models that are compiled at once
Progress = Callable[[str], None]  # is given the name of each step
Suspected = tuple[str, str, dict[str, float]]  # kind, place and first values of a cause


@dataclass
class SearchState:
    """What a search has found.

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
        For each cause of ``best``: hypotheses with another cause in its place, itself included, best first.
    with_one_cause : list of Hypothesis
        All that were fitted, taken or not, best first.
    failed : dict of (str, str) to str
        Kind and place of candidates whose fit does not exist, and why.
    """

    base: Hypothesis
    best: Hypothesis
    screening: Screening
    screened: list[ScreenedCandidate]
    noise_threshold: float
    rivals: list[list[Hypothesis]] = field(default_factory=list)
    with_one_cause: list[Hypothesis] = field(default_factory=list)
    failed: dict[tuple[str, str], str] = field(default_factory=dict)


def best_by_candidate(screened: Iterable[ScreenedCandidate]) -> list[ScreenedCandidate]:
    """The best guess of every kind, place and set of parameters, best first."""
    out: dict[tuple, ScreenedCandidate] = {}
    for candidate in sorted(screened, key=lambda candidate: -candidate.reduction):
        out.setdefault((candidate.kind, candidate.at, tuple(candidate.parameters)), candidate)
    return list(out.values())


def search_causes(
    system: System,
    base_fit: Fit,
    unseen: UnseenData,
    settings: DiagnosisSettings,
    progress: Progress,
    suspected: Sequence[Suspected] = (),
) -> SearchState:
    """Find the causes that a base fit lacks, as far as the vocabulary has them.

    Parameters
    ----------
    base_fit : Fit
        Of the system as given.
    unseen : UnseenData
        Decides what is accepted.
    suspected : sequence of (kind, place, parameters)
        Causes that are fitted in the first round whatever the screening says: what the audit of the channels suspects.
    """
    return _Search(system, base_fit, unseen, settings, progress, suspected).run()


class _Search:
    """One search; screenings are made once for each set of causes."""

    def __init__(
        self,
        system: System,
        base_fit: Fit,
        unseen: UnseenData,
        settings: DiagnosisSettings,
        progress: Progress,
        suspected: Sequence[Suspected],
    ):
        self.suspected = suspected
        self.unseen, self.settings, self.progress = unseen, settings, progress
        self.budget = RefitBudget(settings.refits, settings.search_share)
        self.windowed = settings.windowed
        screening = Screening(base_fit)
        recorded = recorded_range(system, base_fit.problem.data, screening.motion)
        model = ExtendedModel(system, (), dict(base_fit.problem.bounds), base_fit.values, recorded=recorded)
        base = Hypothesis(model, base_fit)
        draws = screening.draws = NoiseDraws(screening.mask.ravel(), screening.free)
        candidates = best_by_candidate(screening.candidates())
        screening.draws = None
        self.known: dict[tuple[Cause, ...], tuple[Screening, list[ScreenedCandidate]]] = {(): (screening, candidates)}
        self.state = SearchState(base, base, screening, candidates, draws.threshold())

    def run(self) -> SearchState:
        """The whole search."""
        state = self.state
        while len(state.best.causes) < self.settings.most_causes and not self._over(state.best):
            fitted = self.refitted(state.best, self.promising(state.best))
            if not state.best.causes:
                state.with_one_cause = fitted
            accepted = self.first_accepted(fitted) or self.first_accepted(self.pairs())
            if accepted is None:
                break
            if len(accepted.causes) == 1:
                state.rivals = [[accepted, *(other for other in fitted if other.places != accepted.places)]]
            weighted = with_balanced_sensors(accepted, self.settings.far_from_noise)
            state.best = with_shared_causes(weighted, self.unseen, self.budget)
        self.settle()
        shared = with_shared_causes(state.best, self.unseen, self.budget)
        if shared is not state.best:  # an exchange has made causes alike
            state.best, state.rivals = shared, [[shared] for _ in shared.causes]
        return state

    def _over(self, best: Hypothesis) -> bool:
        """Whether nothing is left that a cause could explain, or a single one did not bring a model near its noise that
        is weighted by that: an offset would have, and weights with a memory hide it."""
        by_noise = best.fit.problem.weighting is None and bool(best.causes)
        return scatters_only(best) or (by_noise and largest_error(best.fit) > self.settings.far_from_noise)

    def promising(self, hypothesis: Hypothesis) -> list[ScreenedCandidate]:
        """The candidates of a round: the most promising, and of further kinds the most promising place. To first order,
        where sensors are weighted with a memory, what lets an angle drift away promises little."""
        _, candidates = self.screened(hypothesis)
        best = candidates[: self.settings.candidates]
        seen = {candidate.kind for candidate in best}
        further: dict[str, ScreenedCandidate] = {}
        for candidate in candidates[self.settings.candidates :]:
            if candidate.kind not in seen:
                further.setdefault(candidate.kind, candidate)
        known = {candidate.kind_and_place for candidate in best}
        promised = best[0].reduction if best else self.state.noise_threshold
        suspected = [ScreenedCandidate(*one, promised) for one in self.suspected if one[:2] not in known]
        best = [*(one for one in suspected if not _taken(hypothesis, one)), *best]
        return [*best, *list(further.values())[: self.settings.kinds]]

    def screened(self, hypothesis: Hypothesis) -> tuple[Screening, list[ScreenedCandidate]]:
        """The screening of a hypothesis, and its candidates beyond what noise would promise, best first."""
        if hypothesis.causes not in self.known:
            screening = Screening(hypothesis.fit)
            found = best_by_candidate(screening.candidates(hypothesis.model.system()))
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

    def _over_windows(self, parent: Hypothesis, hypothesis: Hypothesis) -> Hypothesis:
        """A hypothesis whose last cause is a free play, fitted over short windows first, where that is better."""
        cause = hypothesis.causes[-1]
        if not EFFECTS[cause.kind].free_play or self.windowed == 0 or not self.budget.take():
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
        if not self.budget.take():
            return None
        self.progress(f"{candidate.kind} at {candidate.at}")
        rival = min((hypothesis.fit.cost for hypothesis in others), default=0.0)
        noise = min((hypothesis.fit.cost for hypothesis in others if at_noise(hypothesis)), default=0.0)
        try:
            fit = fit_extended(model, parent.fit, FitOptions(exact=False, rival_cost=rival, noise_cost=noise))
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
            if hypothesis.cost < near and not time_is_over(self.settings.search_share):
                out[i] = replace(hypothesis, fit=self._finished(with_sharper_friction(self._finished(hypothesis.fit))))
        out.sort(key=lambda hypothesis: hypothesis.cost)
        out[:1] = [with_sharpest_friction(hypothesis) for hypothesis in out[:1]]
        return sorted(out, key=lambda hypothesis: hypothesis.cost)

    def _finished(self, fit: Fit) -> Fit:
        """A fit that goes on where its iterations ended before it did."""
        if not fit.unfinished:
            return fit
        return solve(fit.problem, fit.v, fit.jacobian, FitOptions(self.settings.iterations, exact=False))

    # --- Acceptance

    def first_accepted(self, fitted: list[Hypothesis]) -> Hypothesis | None:
        """The first of hypotheses, best first, that explains more than chance, is possible, and meets unseen data
        better beyond chance."""
        for hypothesis in fitted[: self.settings.judged]:
            if not self._worthwhile(hypothesis):
                return None
            if len(hypothesis.causes) > 1 and hypothesis.model.not_taken(hypothesis.fit) == "not_physical":
                hypothesis = simplified(hypothesis)  # the further cause has left an earlier one too little to be itself
            if hypothesis.model.not_taken(hypothesis.fit) or hypothesis.model.negligible(hypothesis.fit):
                continue
            if self.unseen.accepts(hypothesis, self.state.best):
                return hypothesis
        return None

    def _worthwhile(self, child: Hypothesis) -> bool:
        """Whether further causes explain more of the fitted data than noise would, more than their parameters cost, and
        more than a slight part of the misfit."""
        parent = self.state.best
        least = max(self.state.noise_threshold, _price(child) - _price(parent)) * child.chi_square_per_reading
        return parent.chi_square - child.chi_square > least and (
            share_explained(parent, child) >= self.settings.least_share
        )

    # --- Pairs

    def pairs(self) -> list[Hypothesis]:
        """The best hypothesis with two causes more: pairs of candidates that promise more together than the best
        alone. What one adds to the readings the other may take away, so that neither gains much alone."""
        best = self.state.best
        if len(best.causes) + 2 > self.settings.most_causes:
            return []
        self.progress("pairs of causes")
        screening, candidates = self.screened(best)
        out: list[Hypothesis] = []
        for pair in screened_pairs(screening, candidates, self.settings)[: self.settings.pairs]:
            model = self._with(best, pair.first, pair.second)
            if not compilable([model]) or not self.budget.take():
                continue
            try:
                fit = fit_extended(model, best.fit, FitOptions(exact=False))
            except FitError as reason:
                for one in (pair.first, pair.second):
                    self.state.failed.setdefault(one.kind_and_place, f"as one of a pair: {reason}")
                continue
            out.append(Hypothesis(model, fit, pair.reduction))
        return self._sharpened(out)

    # --- The end of a search

    def settle(self) -> None:
        """Leave out each of several causes without which unseen data are met as well, and exchange each for a better
        one; what was fitted in its place are its rivals."""
        state = self.state
        for _ in range(self.settings.rounds):
            if len(state.best.causes) < 2:
                return
            rivals: list[list[Hypothesis]] = []
            for index in range(len(state.best.causes)):
                better = self._better_without(index, rivals)
                if better is not None:
                    state.best = better
                    break
            else:
                state.rivals = rivals
                return
        if len(state.best.causes) > 1:
            state.rivals = [[state.best] for _ in state.best.causes]

    def _better_without(self, index: int, rivals: list[list[Hypothesis]]) -> Hypothesis | None:
        """A hypothesis without a cause of the best, or with another in its place, that is to be preferred; where there
        is none, the rivals of the cause are appended."""
        best = self.state.best
        rest = without(best, index)
        if rest is None:
            rivals.append([best])
            return None
        if not self.unseen.keeps(best, rest):
            return rest
        fitted = self.refitted(rest, self.screened(rest)[1][: self.settings.exchanged])
        others = [hypothesis for hypothesis in fitted if hypothesis.places != best.places]
        likelier = bool(others) and others[0].cost < best.cost and not others[0].model.not_taken(others[0].fit)
        if likelier and self.unseen.pooled(others[0]) < self.unseen.pooled(best):
            return with_balanced_sensors(others[0], self.settings.far_from_noise)
        rivals.append(distinct(sorted([best, *others], key=lambda hypothesis: hypothesis.cost)))
        return None


def simplified(hypothesis: Hypothesis) -> Hypothesis:
    """A hypothesis with simpler kinds that behave alike at its values in the place of causes, where these are as likely
    for fewer parameters, or the values are impossible: a further cause has taken what the simpler one left when it was
    searched for."""
    for cause in hypothesis.causes:
        index = hypothesis.causes.index(cause)
        price = float(np.log(hypothesis.fit.problem.data.readings_count)) * hypothesis.chi_square_per_reading
        for model in _simpler_models(hypothesis, index):
            try:
                simpler = Hypothesis(model, fit_extended(model, hypothesis.fit), hypothesis.screened)
            except FitError:
                continue
            saved = len(hypothesis.fit.v) - len(simpler.fit.v)
            meant = EFFECTS[cause.kind].possible({k: hypothesis.fit.values[name] for k, name in cause.names().items()})
            if saved > 0 and (not meant or simpler.chi_square < hypothesis.chi_square + saved * price):
                return simplified(with_sharpest_friction(simpler))
    return hypothesis


def _simpler_models(hypothesis: Hypothesis, index: int) -> Iterator[ExtendedModel]:
    """Models with simpler kinds in the place of a cause."""
    cause, fit, system = hypothesis.causes[index], hypothesis.fit, hypothesis.model.base
    p, _ = fit.problem.unpack(fit.v)
    value = dict(zip(fit.problem.model.parameters, (float(x) for x in p), strict=True))
    parameters = {key: fit.values[name] for key, name in cause.names().items()}
    rest = hypothesis.model.without_cause(index, fit)
    present = {(other.kind, other.at) for other in rest.causes}
    for simpler in EFFECTS[cause.kind].simpler(cause.at, parameters, value, system):
        kind, at = simpler.kind, simpler.at
        if (kind, at) not in present and not (EFFECTS[kind].replaces_quantity and system.parameters[at].uncertain):
            yield rest.with_cause(kind, at, simpler.parameters, fit.problem.data.sampling_interval)


def _taken(hypothesis: Hypothesis, candidate: ScreenedCandidate) -> bool:
    """Whether a hypothesis has the candidate, or another dry friction at its place; one that grows with the load may
    stand beside one that does not."""

    def rubs(kind: str) -> bool:
        return EFFECTS[kind].sticks and "torque" in EFFECTS[kind].file_keys

    def late(kind: str) -> bool:  # a clock is not also a delay or a lag
        return EFFECTS[kind].only_delays or EFFECTS[kind].is_clock or kind == "lag"

    return any(
        (candidate.at == at and (candidate.kind == kind or (rubs(candidate.kind) and rubs(kind))))
        or (late(candidate.kind) and late(kind) and not set(members(candidate.at)).isdisjoint(members(at)))
        for kind, at in hypothesis.places
    )


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
    """Pairs of the best candidates that promise clearly more than the best alone, the most promising first.

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
    least = settings.pair_gain * min(alone, rest)
    for i, j in combinations(range(len(best)), 2):
        if best[i].at == best[j].at and best[i].kind == best[j].kind:
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


def first_readings(data: FitData, most: int) -> FitData:
    """The first ``most`` readings of data, segment by segment."""
    left, sensors, parts = most, max(len(data.noise), 1), list[Segment]()
    for segment in data.segments:
        count = min(len(segment.time), left // sensors)
        if count >= min(FEWEST_SAMPLES, len(segment.time)) and count:
            parts.append(segment.part(0, count))
            left -= count * sensors
    return replace(data, segments=tuple(parts))
