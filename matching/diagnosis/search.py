"""The search for causes: candidates are fitted one after another until the residual is noise."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np
from scipy import fft, signal, stats

from matching.diagnosis.causes import Cause, ExtendedModel, compilable, recorded_range
from matching.diagnosis.data import FEWEST_SAMPLES, FitData, Segment
from matching.diagnosis.fit import (
    MOST_STEPS_A_SAMPLE,
    Fit,
    FitOptions,
    jacobian,
    reweighted,
    slow_and_fast,
    with_sharper_friction,
)
from matching.diagnosis.holdout import Holdout, HoldoutRun
from matching.diagnosis.screening import (
    SEARCH,
    NoiseDraws,
    ScreenedCandidate,
    Screening,
    fit_extended,
    fit_longer_windows,
    fit_short_windows,
)
from matching.diagnosis.selection import (
    Hypothesis,
    UnseenData,
    at_noise,
    scatters_only,
    share_explained,
    with_balanced_sensors,
)
from modelling.effects import EFFECTS
from modelling.effects.effect import members, shared_place
from modelling.effects.sensors_and_actuators import LATE_SIGN, ClockOffset, DeadTime, SensorDelay, recorded_late
from modelling.resources import time_is_over
from modelling.system import System

# --- Second looks at refitted candidates: sharper friction, simpler kinds, short windows.

NEAR_BEST, NEAR_RATIO = 4, 2.0  # hypotheses that get a second look, and up to how many times the best's χ²
WINDOWED_BEST, WINDOWED_RATIO = 2, 3.0  # the same for fits over short windows, which take many times as long
FAR_FROM_NOISE = 3.0  # root mean square of the residual in times the noise
NEAR_NOISE = 1.2  # mean square of the residual in times the noise
WIDER_GAP = 1.6  # times the fitted one
KEPT_PROMISE = 0.5  # of the decrease of χ² that the screening promised
BETTER_WINDOWS = 0.9  # of χ²: fits over short windows that are no better than this prove no local minimum
MUCH_BETTER_WINDOWS = 0.8  # the same for the windows to stand for the fit
ITERATIONS_AFTER_WINDOWS = 15
REFITS, WINDOWED_REFITS = 60, 5  # of a whole search
SEARCH_SHARE = 0.7  # of the time that a diagnosis may take; the rest is for the final fit of the best and its rivals

FIT_ERRORS = (FloatingPointError, np.linalg.LinAlgError, ValueError)  # of a fit that does not simulate or converge


@dataclass
class RefitBudget:
    """How many refits a search may still make, in all and over short windows.

    A count, so that no answer depends on the machine, unless the caller limits the time.
    """

    left: int = REFITS
    windows: int = WINDOWED_REFITS

    def take(self) -> bool:
        """Take one refit; whether there was one."""
        if search_is_over():
            self.left = self.windows = 0
        self.left -= 1
        return self.left >= 0

    def take_windows(self) -> bool:
        """Take one refit over short windows; whether there was one."""
        if search_is_over():
            self.left = self.windows = 0
        self.windows -= 1
        return self.windows >= 0


def search_is_over() -> bool:
    """Whether the time that the search may take has passed, where it is limited."""
    return time_is_over(SEARCH_SHARE)


def with_sharper_friction_near_best(hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Hypotheses, best first, those near the best with dry friction as sharp as it takes to compare them."""
    out = sorted(hypotheses, key=lambda hypothesis: hypothesis.cost)
    near = [i for i, hypothesis in enumerate(out[:NEAR_BEST]) if hypothesis.cost < NEAR_RATIO * out[0].cost]
    for i in near:
        out[i] = replace(out[i], fit=with_sharper_friction(out[i].fit))
    out.sort(key=lambda hypothesis: hypothesis.cost)
    out[:1] = [with_sharpest_friction(hypothesis) for hypothesis in out[:1]]
    return sorted(out, key=lambda hypothesis: hypothesis.cost)


def with_sharpest_friction(hypothesis: Hypothesis) -> Hypothesis:
    """A hypothesis that is not at the noise with its friction as sharp as ever pays: no further cause is to be searched
    for what smooth friction leaves."""
    if at_noise(hypothesis):
        return hypothesis
    return replace(hypothesis, fit=with_sharper_friction(hypothesis.fit, MOST_STEPS_A_SAMPLE))


def with_simpler_kinds(hypotheses: Sequence[Hypothesis], tried: set[tuple[Cause, ...]]) -> list[Hypothesis]:
    """Hypotheses, best first, and those of simpler kinds that the best and those near it may stand for."""
    out = {hypothesis.causes: hypothesis for hypothesis in hypotheses}
    for hypothesis in hypotheses[:NEAR_BEST]:
        if hypothesis.cost >= NEAR_RATIO * hypotheses[0].cost or hypothesis.causes in tried:
            continue
        tried.add(hypothesis.causes)
        for model in _simpler_models(hypothesis):
            try:
                fit = fit_extended(model, hypothesis.fit)
            except FIT_ERRORS:
                continue
            if model.causes not in out or fit.cost < out[model.causes].fit.cost:
                out[model.causes] = Hypothesis(model, fit, hypothesis.screened)
    return sorted(out.values(), key=lambda hypothesis: hypothesis.cost)


def simpler_hypotheses(hypothesis: Hypothesis, index: int) -> Iterator[Hypothesis]:
    """Hypotheses with simpler kinds in the place of one of the causes, which comes last in them."""
    for model in _simpler_models(hypothesis, index):
        try:
            fit = fit_extended(model, hypothesis.fit)
        except FIT_ERRORS:
            continue
        yield with_sharpest_friction(Hypothesis(model, fit, hypothesis.screened))


def with_possible_causes(hypothesis: Hypothesis) -> Hypothesis:
    """A hypothesis with simpler kinds in the place of causes whose values have become impossible beside a further one;
    itself where there are none.

    Friction that falls from rest may have stood for a delay: beside the delay it is plain friction, and its breakaway
    torque less than that of sliding.
    """
    for index, cause in enumerate(hypothesis.causes):
        values = {key: hypothesis.fit.values[name] for key, name in cause.names().items()}
        if not EFFECTS[cause.kind].possible(values):
            simpler = simpler_hypotheses(hypothesis, index)
            return min(simpler, key=lambda other: other.cost, default=hypothesis)
    return hypothesis


def _simpler_models(hypothesis: Hypothesis, index: int = -1) -> Iterator[ExtendedModel]:
    """Models with simpler kinds in the place of a cause (the last)."""
    cause, fit, system = hypothesis.causes[index], hypothesis.fit, hypothesis.model.base
    p, _ = fit.problem.unpack(fit.v)
    value = dict(zip(fit.problem.model.parameters, (float(x) for x in p), strict=True))
    parameters = {key: fit.values[name] for key, name in cause.names().items()}
    rest = hypothesis.model.without_cause(index % len(hypothesis.causes), fit)
    present = {(other.kind, other.at) for other in rest.causes}
    for simpler in EFFECTS[cause.kind].simpler(cause.at, parameters, value, system):
        kind, at = simpler.kind, simpler.at
        if (kind, at) not in present and not (EFFECTS[kind].replaces_quantity and system.parameters[at].uncertain):
            yield rest.with_cause(kind, at, simpler.parameters, fit.problem.data.sampling_interval)


def refitted_over_windows(
    parent: Hypothesis,
    hypotheses: Sequence[Hypothesis],
    screening: Screening,
    tried: set[tuple[Cause, ...]],
    budget: RefitBudget,
) -> list[Hypothesis]:
    """Fit some again from short windows: their long simulation may have ended in a local minimum."""
    motion = np.concatenate(parent.fit.problem.states(parent.fit.v))
    motion = screening.balance.added_to(parent.fit.problem.model.states, motion)
    out = list(hypotheses)
    for hypothesis in in_local_minimum(parent, hypotheses):
        if hypothesis.causes in tried:
            continue
        if not budget.take_windows():
            break
        tried.add(hypothesis.causes)
        try:
            again = _from_windows(parent, hypothesis, motion)
        except FIT_ERRORS:
            continue
        if again is not None and again.fit.cost < hypothesis.fit.cost:
            out[out.index(hypothesis)] = again
            if at_noise(again):  # nothing is left for the others to explain better
                break
    return sorted(out, key=lambda hypothesis: hypothesis.cost)


def in_local_minimum(parent: Hypothesis, hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Hypotheses, of some that are not at the noise, whose fit may have ended in a local minimum.

    These are the best few, which another start may improve, and before them the one that the screening promised most
    of, if its fit does not keep half of that: rattling in backlash forgets where it began, so that a long simulation
    fits worse with the right cause than without it. Of further causes that leave far more than noise only that one:
    other starts of the best few take most of the time of a search that never comes to the noise.
    """
    near = [
        hypothesis
        for hypothesis in hypotheses[:WINDOWED_BEST]
        if hypothesis.fit.cost <= WINDOWED_RATIO * hypotheses[0].fit.cost
    ]
    if parent.causes and hypotheses[0].misfit > FAR_FROM_NOISE:
        near = []
    promised = max(hypotheses, key=lambda hypothesis: hypothesis.screened)
    kept = parent.fit.cost - promised.fit.cost
    return near if kept > KEPT_PROMISE * promised.screened or promised in near else [promised, *near]


def _with_wider_gap(hypothesis: Hypothesis, short: Fit) -> ExtendedModel | None:
    """A model to begin with a wider gap, where a fit over windows is not near the noise; None without backlash.

    A gap that is too narrow stays so: within the true gap no torque is measured that a narrower one lacks. From a gap
    that is too wide the missing torque is there from the first sample.
    """
    cause = hypothesis.causes[-1]
    if not EFFECTS[cause.kind].free_play or short.cost < NEAR_NOISE * short.problem.data.readings_count:
        return None
    name = cause.names()[EFFECTS[cause.kind].free_play]
    values = hypothesis.model.values | short.values
    return replace(hypothesis.model, values=values | {name: WIDER_GAP * values[name]})


def _from_windows(parent: Hypothesis, hypothesis: Hypothesis, motion: np.ndarray) -> Hypothesis | None:
    """A hypothesis fitted from short windows; None where the long simulation does as well."""
    short = fit_short_windows(hypothesis.model, parent.fit, motion)
    wider = _with_wider_gap(hypothesis, short)
    if wider is not None:
        again = fit_short_windows(wider, parent.fit, motion)
        short = again if again.cost < short.cost else short
    if short.cost > BETTER_WINDOWS * hypothesis.fit.cost:
        return None
    windows = fit_longer_windows(short)
    values = hypothesis.model.values | windows.values
    model = replace(hypothesis.model, values=values, starts=_segment_starts(windows, parent.fit))
    fit = fit_extended(model, parent.fit, replace(SEARCH, iterations=ITERATIONS_AFTER_WINDOWS))
    abrupt = any(EFFECTS[cause.kind].abrupt for cause in hypothesis.causes)
    whole = len(windows.problem.data.segments) == len(parent.fit.problem.data.segments)
    if windows.cost < fit.cost if whole else abrupt and windows.cost < MUCH_BETTER_WINDOWS * fit.cost:
        fit = windows  # with backlash no long simulation can be reproduced; the windows are what can be judged
    return replace(hypothesis, model=model, fit=fit)


def _segment_starts(windows: Fit, parent: Fit) -> tuple[np.ndarray, ...]:
    """Start states (x,) of a parent's segments, from the windows that begin with them."""
    at = {(s.name, float(s.time[0])): x for s, x in zip(windows.problem.data.segments, windows.starts, strict=True)}
    return tuple(at[segment.name, float(segment.time[0])] for segment in parent.problem.data.segments)


# --- The state of a search: the best hypothesis so far and what else was fitted.


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
        What it found, the best guess of each candidate; empty where it was made anew after the search.
    noise_threshold : float
        Decrease of χ² that the best of all candidates seldom reaches in pure noise.
    rivals : list of list of Hypothesis
        For each cause of ``best``: hypotheses with another cause in its place, itself included, best first.
    with_one_cause : list of Hypothesis
        All that were fitted, taken or not, best first.
    """

    base: Hypothesis
    best: Hypothesis
    screening: Screening
    screened: list[ScreenedCandidate]
    noise_threshold: float
    rivals: list[list[Hypothesis]] = field(default_factory=list)
    with_one_cause: list[Hypothesis] = field(default_factory=list)


def chi_square_per_reading(hypothesis: Hypothesis) -> float:
    """Mean square of the residual, at least 1: no gain counts that is small beside what remains."""
    return max(1.0, hypothesis.chi_square / max(hypothesis.fit.problem.data.readings_count, 1))


def distinct(hypotheses: list[Hypothesis]) -> list[Hypothesis]:
    """Without those that name the same causes in another order or with fewer or more parameters; the first is kept."""
    out: dict[frozenset, Hypothesis] = {}
    for hypothesis in hypotheses:
        out.setdefault(frozenset(hypothesis.places), hypothesis)
    return list(out.values())


# --- Causes of one kind and size at several channels, as one: a filter, a clock or a supply that these share.
#
# Groups by the measured quantity compete from the start. A logger may have some channels of a quantity and lack others,
# and inputs beside sensors; its delay is then found channel by channel, by the kind that each channel has for it.

ALIKE = 1.5  # ratio of two sizes from which they are not tried as one
SPILLED = 0.2  # of what the ends of data add to χ²: what a fit may add elsewhere to lessen that
SPREAD = 0.5  # of the offset between two loggers: channels of one that differ by more are not of one


@dataclass(frozen=True)
class _SharedCause:
    """A cause that stands for several: its place, and first values of its parameters."""

    kind: str
    at: str
    sizes: dict[str, float]


def with_shared_causes(hypothesis: Hypothesis, budget: RefitBudget) -> Hypothesis:
    """A hypothesis whose causes of one kind at several channels are one, where that is as likely with fewer sizes; so
    too where channels are recorded late by the same time, whatever the kinds that say so."""
    late = tuple(cause for cause in hypothesis.causes if cause.kind in LATE_SIGN)
    for causes in dict.fromkeys((*combinations(hypothesis.causes, 2), *combinations(late, len(late)))):
        shared = _shared(hypothesis, causes)
        if shared is None or not budget.take():
            continue
        joined = _joined(hypothesis, causes, shared)
        if joined is not None and _as_likely(joined, hypothesis, shared):
            return with_shared_causes(_without_idle_inputs(joined, shared, budget), budget)
    return hypothesis


def _without_idle_inputs(joined: Hypothesis, shared: _SharedCause, budget: RefitBudget) -> Hypothesis:
    """A hypothesis whose clock has only those inputs that speak for it.

    Which logger an input belongs to that hardly acts cannot be seen; as one more late channel it would be invented.
    """
    for place in members(shared.at):
        few = [other for other in members(shared.at) if other != place]
        if shared.kind != ClockOffset.kind or not few or not place.startswith("inputs.") or not budget.take():
            continue
        fewer = _of_channels(few, shared.sizes["offset"])
        cause = next(cause for cause in joined.causes if (cause.kind, cause.at) == (shared.kind, shared.at))
        without = _joined(joined, [cause], fewer)
        if without is not None and without.chi_square <= joined.chi_square + _of_sizes(joined, 1):
            return _without_idle_inputs(without, fewer, budget)
    return joined


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
    place = shared_place(place for cause in causes for place in members(cause.at))
    return _SharedCause(first.kind, place, dict(zip(first.keys, sizes.mean(axis=0).tolist(), strict=True)))


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
    return _of_channels(few, float(differences.mean()))


def _of_channels(few: Sequence[str], offset: float) -> _SharedCause:
    """How channels that are ``offset`` s late are named: sensors that read late, inputs that act late, else a clock."""
    tables = {place.split(".")[0] for place in few}
    if offset > 0 and tables == {"sensors"}:
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
    except FIT_ERRORS:
        return None


def _as_likely(joined: Hypothesis, hypothesis: Hypothesis, shared: _SharedCause) -> bool:
    """Whether the causes are as likely as one; of times, away from both ends of the data.

    What was before the first sample and comes after the last is unknown: as much of the data is off by it, at the one
    end if a channel is late and at the other if the others are early. A fit spreads some of that over the rest.
    """
    saved = _saved(hypothesis, joined)
    if shared.kind not in LATE_SIGN:
        return joined.chi_square < hypothesis.chi_square + saved
    longest = max(abs(size) for size in shared.sizes.values())
    inner = _inner_square(joined, longest) - _inner_square(hypothesis, longest)
    ends = _inner_square(joined, 0.0) - _inner_square(hypothesis, 0.0) - inner
    return inner < saved + SPILLED * max(ends, 0.0)


def _inner_square(hypothesis: Hypothesis, margin: float) -> float:
    """Sum of squares of the errors, in times the noise, further than ``margin`` s from the ends of the data."""
    square = 0.0
    for segment, errors in zip(hypothesis.fit.problem.data.segments, hypothesis.fit.errors, strict=True):
        time = segment.time
        square += float(np.nansum(errors[(time > time[0] + margin) & (time < time[-1] - margin)] ** 2))
    return square


def _saved(hypothesis: Hypothesis, joined: Hypothesis) -> float:
    """What the sizes that are saved would cost in χ² (Schwarz 1978), no model being better than what it leaves."""
    return _of_sizes(hypothesis, len(hypothesis.fit.v) - len(joined.fit.v))


def _of_sizes(hypothesis: Hypothesis, count: int) -> float:
    return count * float(np.log(hypothesis.fit.problem.data.readings_count)) * chi_square_per_reading(hypothesis)


# --- Two causes at once: pairs of candidates that take more of the residual together than the best takes alone.
#
# A search that adds one cause after another goes wrong where two hide each other: what one adds to the readings the
# other
# takes away, so that neither gains much alone. To first order the gain of a pair follows from the signatures that the
# screening has anyway; only the few most promising pairs are fitted.

PAIRED = 10  # best candidates of which pairs are looked at
MOST_PAIRS = 2  # that are fitted
PAIR_GAIN = 1.2  # reduction of χ² by a pair over that of the best candidate alone, from which it is looked at
DEPENDENT = 1e-6  # of a signature's length: what is left by others that take its place


@dataclass(frozen=True)
class ScreenedPair:
    """Two candidates with their guesses at the amplitudes they have together, and how much of χ² they would take."""

    first: ScreenedCandidate
    second: ScreenedCandidate
    reduction: float


def screened_pairs(screening: Screening, candidates: Sequence[ScreenedCandidate]) -> list[ScreenedPair]:
    """Pairs of the best candidates that promise clearly more than the best alone, the most promising first.

    Parameters
    ----------
    candidates : sequence of ScreenedCandidate
        Of ``screening``, best first.
    """
    best = [candidate for candidate in candidates if candidate.guess is not None][:PAIRED]
    rows = [_signatures(screening, candidate) for candidate in best]
    pairs = []
    for i, j in combinations(range(len(best)), 2):
        if best[i].at == best[j].at and best[i].kind == best[j].kind:
            continue
        pair = _pair(screening, best[i], best[j], (rows[i], rows[j]))
        if pair is not None and pair.reduction > PAIR_GAIN * best[0].reduction:
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


def fitted_pairs(
    base: Hypothesis, pairs: Sequence[ScreenedPair], known: Sequence[Hypothesis], budget: RefitBudget
) -> list[Hypothesis]:
    """The most promising pairs, fitted, up to the first that a known hypothesis has: others promise less than that."""
    step = base.fit.problem.data.sampling_interval
    start = replace(base.model, bounds=base.fit.problem.bounds, values=base.fit.values, starts=())
    places = [hypothesis.places for hypothesis in known]
    out: list[Hypothesis] = []
    for pair in pairs:
        model = start
        for candidate in (pair.first, pair.second):
            model = model.with_cause(candidate.kind, candidate.at, candidate.parameters, step)
        if {(cause.kind, cause.at) for cause in model.causes} in places:
            break
        if len(out) == MOST_PAIRS or not compilable([model]) or not budget.take():
            break
        try:
            fit = fit_extended(model, base.fit, FitOptions(exact=False))
        except FIT_ERRORS:
            continue
        out.append(Hypothesis(model, fit, pair.reduction))
    return out


# --- Refits of the candidates that a screening promises most of, everything uncertain free.

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


# --- The end of a search: causes that the others make unneeded are dropped, and any is exchanged for a better one.

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


# --- Several causes, one after another, until the residual is noise; what is not needed later is dropped.

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


# --- What a fit becomes with instruments: signals that move a controlled input and that no noise of a reading reaches.
#
# Under feedback an input follows the errors of readings, and an output-error fit is biased where these have a memory.
# The
# controller's reference moves the input too, and follows no error. A regression on it gives the input as it would be
# without noise; the derivatives of the simulated readings under that input are the instruments (two-stage method; Van
# den
# Hof and Schrama, Automatica 29, 1993). Whether both estimates differ by more than chance is tested after Hausman
# (Econometrica 46, 1978), with the noise's own correlation.

KERNELS = 24  # hat functions that an impulse response is made of, their lags growing geometrically
LONGEST_RESPONSE_S, RESPONSE_SHARE = 2.0, 0.1  # lag of the last; and of the shortest segment at most
CORRELATION_SHARE = 0.05  # of a segment: longest lag of the noise's correlation that is counted
LEAST_MOVED = 0.05  # share of the controlled input's power: an instrument that moves less says nothing
CHANCE = 1e-4  # probability that an unbiased fit is called biased, or a rest without pattern one that has it


@dataclass(frozen=True)
class InstrumentedFit:
    """A fit beside what it becomes with instruments.

    Attributes
    ----------
    moved : float
        Share of the controlled inputs' power that instruments explain, of the worst.
    values, uncertainties : dict of str to float
        Of the fitted parameters with instruments, SI.
    biased : tuple of str
        Parameters that differ by more than chance.
    rest_follows : bool
        What is left follows the instruments: an error of the model, beside which no bias can be told.
    """

    moved: float
    values: dict[str, float]
    uncertainties: dict[str, float]
    biased: tuple[str, ...]
    rest_follows: bool


def instrumented_fit(fit: Fit, references: Mapping[int, Sequence[np.ndarray]]) -> InstrumentedFit:
    """The fit with instruments.

    Parameters
    ----------
    references : mapping of int to sequence of ndarray (t,)
        By controlled input (index): its reference on every segment.
    """
    segments = fit.problem.data.segments
    designs = _designs(fit, references)
    inputs, moved = _free_of_noise(fit, designs, list(references))
    data = replace(
        fit.problem.data, segments=tuple(replace(s, inputs=u) for s, u in zip(segments, inputs, strict=True))
    )
    problem = replace(fit.problem, data=data)
    instruments = jacobian(problem, fit.v, problem.residuals(fit.v[None])[0])
    by_instruments, by_errors = _estimators(fit, instruments), _estimators(fit, fit.jacobian)
    count = len(fit.problem.free)
    step = -by_instruments @ fit.residual
    difference = -(by_instruments - by_errors)[:count] @ fit.residual
    spread = np.sqrt(_variance(fit, (by_instruments - by_errors)[:count], fit.residual))
    uncertainty = np.sqrt(_variance(fit, by_instruments[:count], fit.residual))
    rest = fit.residual + fit.jacobian @ step
    limit = float(stats.norm.isf(CHANCE / 2 / max(count, 1)))
    names = fit.problem.free
    return InstrumentedFit(
        moved,
        dict(zip(names, (float(x) for x in fit.v[:count] + difference), strict=True)),
        dict(zip(names, (float(x) for x in uncertainty), strict=True)),
        tuple(name for name, d, s in zip(names, difference, spread, strict=True) if abs(d) > limit * s > 0),
        _follows(fit, rest, designs),
    )


def _designs(fit: Fit, references: Mapping[int, Sequence[np.ndarray]]) -> list[np.ndarray]:
    """Regressors (t, k) of every segment: references and inputs that no controller moves, through the hat kernels."""
    segments, step = fit.problem.data.segments, fit.problem.data.sampling_interval
    shortest = min(len(segment.time) for segment in segments)
    longest = max(int(min(LONGEST_RESPONSE_S / step, RESPONSE_SHARE * shortest)), KERNELS)
    knots = np.unique(np.concatenate([[0.0], np.geomspace(1, longest, KERNELS - 1)]))
    hats = [np.interp(np.arange(longest + 1), knots, unit) for unit in np.eye(len(knots))]
    open_inputs = [j for j in range(len(fit.problem.model.inputs)) if j not in references]
    out = []
    for i, segment in enumerate(segments):
        sources = [reference[i] for reference in references.values()]
        sources += [segment.inputs[:, j] for j in open_inputs]
        columns = [np.ones(len(segment.time))]
        for source in sources:
            columns += [
                signal.fftconvolve(source - source[0], hat)[: len(source)] for hat in hats if np.ptp(source) > 0
            ]
        out.append(np.stack(columns, axis=1))
    return out


def _free_of_noise(fit: Fit, designs: list[np.ndarray], controlled: list[int]) -> tuple[list[np.ndarray], float]:
    """Inputs (t, u) of every segment with controlled ones as instruments move them, and the least share explained."""
    segments = fit.problem.data.segments
    inputs, least = [segment.inputs.copy() for segment in segments], 1.0
    design = np.concatenate(designs)
    for j in controlled:
        recorded = np.concatenate([segment.inputs[:, j] for segment in segments])
        weights = np.linalg.lstsq(design, recorded, rcond=1e-8)[0]
        for part, values in zip(designs, inputs, strict=True):
            values[:, j] = part @ weights
        power = float(np.var(recorded))
        least = min(least, 1 - float(np.var(recorded - design @ weights)) / power if power > 0 else 0.0)
    return inputs, least


def _estimators(fit: Fit, instruments: np.ndarray) -> np.ndarray:
    """(v, r): how the variables follow the residual, (ZᵀJ + P)⁻¹·Zᵀ with the information P of the ranges."""
    size = np.maximum(np.linalg.norm(fit.jacobian, axis=0), 1e-300)
    width = (fit.problem.upper - fit.problem.lower) * size
    known = np.where(np.isfinite(width), 12 / np.maximum(width, 1e-300) ** 2, 0.0)
    scaled = instruments / size
    inner = scaled.T @ (fit.jacobian / size) + np.diag(known)
    return np.linalg.pinv(inner, rcond=1e-10) @ scaled.T / size[:, None]


def _variance(fit: Fit, weights: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Variance (w,) of weighted sums of errors (r,), weights (w, r)."""
    segments, total = fit.problem.data.segments, np.zeros(len(weights))
    ends = np.cumsum([segment.readings.size for segment in segments])[:-1]
    for part, error in zip(np.split(weights, ends, axis=1), fit.problem.by_sensor(errors), strict=True):
        by_sensor = part.reshape(len(weights), *error.shape)
        total += sum(_variance_of_sums(by_sensor[:, :, j], error[:, j]) for j in range(error.shape[1]))
    return total


def _variance_of_sums(weights: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Variance (w,) of weighted sums, weights (w, t), of errors (t,) with their own correlation over time."""
    count = len(errors)
    longest = max(int(CORRELATION_SHARE * count), 1)
    size = fft.next_fast_len(count + longest, real=True)
    power = np.abs(fft.rfft(errors - errors.mean(), size)) ** 2
    correlation = np.zeros(size)
    taper = 1 - np.arange(longest + 1) / (longest + 1)
    correlation[: longest + 1] = fft.irfft(power, size)[: longest + 1] / count * taper
    correlation[-longest:] = correlation[longest:0:-1]
    density = np.maximum(fft.rfft(correlation).real, 0.0)
    density[1 : (size + 1) // 2] *= 2  # negative frequencies
    return np.abs(fft.rfft(weights, size, axis=1)) ** 2 @ density / size


def _follows(fit: Fit, rest: np.ndarray, designs: list[np.ndarray]) -> bool:
    """Whether a rest (r,) is correlated with the instruments at any of their lags."""
    parts = fit.problem.by_sensor(rest)
    count = designs[0].shape[1] - 1
    sums, variances = np.zeros((count, parts[0].shape[1])), np.zeros((count, parts[0].shape[1]))
    for design, part in zip(designs, parts, strict=True):
        columns = (design[:, 1:] - design[:, 1:].mean(axis=0)).T
        sums += columns @ part
        variances += np.stack([_variance_of_sums(columns, error) for error in part.T], axis=1)
    measured = variances > 0
    largest = float(np.max(np.abs(sums[measured]) / np.sqrt(variances[measured]), initial=0.0))
    return largest > float(stats.norm.isf(CHANCE / 2 / max(int(measured.sum()), 1)))


# --- Held-out data whose simulations are kept: several questions are asked of the same fit.

MOST_KEPT_READINGS = 10_000_000  # of all simulations: 80 MB


class RememberedHoldout:
    """Held-out data that are simulated once with each fit, as far as the memory for it goes."""

    def __init__(self, holdout: Holdout):
        self.holdout = holdout
        self._runs: dict[int, tuple[Fit, list[HoldoutRun]]] = {}  # with the fit, so that no other takes its identity
        self._left = MOST_KEPT_READINGS

    @property
    def data(self) -> FitData:
        """The data."""
        return self.holdout.data

    def simulate(self, fit: Fit) -> list[HoldoutRun]:
        """Simulate them with a fit."""
        if id(fit) in self._runs:
            return self._runs[id(fit)][1]
        runs = self.holdout.simulate(fit)
        size = sum(len(run.residual) for run in runs)
        if size <= self._left:
            self._left -= size
            self._runs[id(fit)] = fit, runs
        return runs

    def segments(self, fit: Fit) -> list[Segment]:
        """The segments to which the residuals of :meth:`simulate` belong, in their order."""
        return self.holdout.segments(fit)


# --- A time window of long data in which causes are searched for: their kind shows in seconds, their size in all data.

MOST_READINGS = 150_000  # of all sensors, in a search: 37 s at 1 kHz and four sensors
WINDOWS_PER_LENGTH = 8  # windows that are compared begin this many times in the length of one


@dataclass(frozen=True)
class _SearchWindow:
    """Samples of a segment and the mean of their squared residuals (all sensors)."""

    square: float
    segment: int
    first: int
    last: int


def search_window(base: Fit) -> FitData | None:
    """The window of long data where a base fit is worst, of at most ``MOST_READINGS`` readings; None of short data.

    Where segments are shorter than that, the next worst windows are taken too.
    """
    data = base.problem.data
    if data.readings_count <= MOST_READINGS:
        return None
    readings_per_sample = data.readings_count / sum(len(segment.time) for segment in data.segments)
    left = int(MOST_READINGS / readings_per_sample)
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


def first_readings(data: FitData) -> FitData:
    """The first ``MOST_READINGS`` readings of data, segment by segment."""
    left, sensors, parts = MOST_READINGS, max(len(data.noise), 1), list[Segment]()
    for segment in data.segments:
        count = min(len(segment.time), left // sensors)
        if count >= min(FEWEST_SAMPLES, len(segment.time)) and count:
            parts.append(segment.part(0, count))
            left -= count * sensors
    return replace(data, segments=tuple(parts))
