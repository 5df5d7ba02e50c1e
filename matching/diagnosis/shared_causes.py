"""Causes of one kind and size at several channels, as one: a filter, a clock or a supply that these share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from matching.diagnosis.causes import Cause, compilable
from matching.diagnosis.screening import fit_extended
from matching.diagnosis.selection import Hypothesis, UnseenData
from modelling.effects import EFFECTS
from modelling.effects.effect import members, shared_place
from modelling.effects.sensors_and_actuators import LATE_SIGN, ClockOffset, DeadTime, SensorDelay, recorded_late
from modelling.errors import FitError
from modelling.resources import time_is_over
from modelling.system import System


@dataclass
class RefitBudget:
    """How many refits a search may still make: a count, so that no answer depends on the machine, unless the caller
    limits the time."""

    left: int
    share: float

    def take(self) -> bool:
        """Take one refit; whether there was one."""
        if time_is_over(self.share):
            self.left = 0
        self.left -= 1
        return self.left >= 0


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


def with_shared_causes(hypothesis: Hypothesis, unseen: UnseenData, budget: RefitBudget) -> Hypothesis:
    """A hypothesis whose causes of one kind at several channels are one, unless several sizes are likelier and meet
    unseen data better beyond chance; so too where channels are recorded late by the same time, whatever the kinds that
    say so."""
    late = tuple(cause for cause in hypothesis.causes if cause.kind in LATE_SIGN)
    for causes in dict.fromkeys((*combinations(hypothesis.causes, 2), *combinations(late, len(late)))):
        shared = _shared(hypothesis, causes)
        if shared is None or not budget.take():
            continue
        joined = _joined(hypothesis, causes, shared)
        if joined is not None and (joined.cost < hypothesis.cost or not unseen.accepts(hypothesis, joined)):
            return with_shared_causes(_without_idle_inputs(joined, shared, unseen, budget), unseen, budget)
    return hypothesis


def _without_idle_inputs(
    joined: Hypothesis, shared: _SharedCause, unseen: UnseenData, budget: RefitBudget
) -> Hypothesis:
    """A hypothesis whose clock has only those inputs that speak for it.

    Which logger an input belongs to that hardly acts cannot be seen; as one more late channel it would be invented.
    """
    for place in members(shared.at):
        few = [other for other in members(shared.at) if other != place]
        if shared.kind != ClockOffset.kind or not few or not place.startswith("inputs.") or not budget.take():
            continue
        fewer = _of_channels(joined.model.base, few, shared.sizes["offset"])
        cause = next(cause for cause in joined.causes if (cause.kind, cause.at) == (shared.kind, shared.at))
        without = _joined(joined, [cause], fewer)
        if without is not None and (without.cost < joined.cost or not unseen.accepts(joined, without)):
            return _without_idle_inputs(without, fewer, unseen, budget)
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
