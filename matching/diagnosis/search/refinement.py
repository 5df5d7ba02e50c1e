"""Second looks at refitted candidates: sharper friction, simpler kinds, short windows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from matching.diagnosis.candidates.cause import Cause, ExtendedModel
from matching.diagnosis.candidates.refit import SEARCH, fit_extended
from matching.diagnosis.candidates.screening import Screening
from matching.diagnosis.candidates.short_windows import fit_longer_windows, fit_short_windows
from matching.diagnosis.fitting.fit import Fit
from matching.diagnosis.fitting.friction_regularisation import MOST_STEPS, with_sharper_friction
from matching.diagnosis.search.hypothesis import Hypothesis, at_noise
from modelling.common.time_limit import time_is_over
from modelling.effects import EFFECTS

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
    return replace(hypothesis, fit=with_sharper_friction(hypothesis.fit, MOST_STEPS))


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
