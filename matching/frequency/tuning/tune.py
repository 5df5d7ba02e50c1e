"""Tuning of an observer's weights over drawn beds: the beds' mean square error, with what every one has to keep."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy

from matching.frequency.beds.softened import beds_at
from matching.frequency.beds.tuner import DAMPING_RESERVE, STABLE_SHARE, Tuner
from matching.frequency.tuning.opened import with_opened
from matching.frequency.tuning.rounds import TuningEffort, TuningEnd, bounds_of, end_at, rounds
from matching.frequency.tuning.worst import worst_positions
from modelling.common.errors import InputError

BEYOND_POOL = 5.4  # times the pool: beds that are looked through once for what the pool has missed
MOST_ADDED = 12  # of those, the least damped ones
STARTS = 2  # that are followed at most
NEARLY_AS_CHEAP = 1.5  # times the cost of the cheapest start, up to which the requirements decide between starts


def tuned_weights(search: Tuner, effort: TuningEffort | None = None) -> tuple[dict[str, float], float]:
    """Weights by name, and their cost: sequential quadratic programming with exact derivatives.

    The cost is the mean square of the drawn beds' response errors to unmeasured torques, over the tolerance. The search
    begins at the better one of the case's weights and the structure's further starts, and at the next one where it ends
    with a requirement missed; where all do by more than the reserve, at the best of settings drawn over the bounds.
    Then beds with opened cut shafts have to be stable as well, see :mod:`matching.frequency.tuning.opened`, where that
    keeps all else.
    """
    effort = effort or TuningEffort()
    best, used = _from_starts(search, effort)
    if effort.scenarios and best.judged.cost <= 1:  # beyond their tolerance the errors limit the match anyway
        best = with_opened(search, best, effort)
    for _ in range(effort.scenarios):
        if not add_scenarios(search, end_at(search, best.logarithms), effort):
            break
        best, used = _further_round(search, best, effort, used)
    return dict(zip(search.gains.names, (10.0**best.logarithms).tolist(), strict=True)), best.judged.cost


def _from_starts(search: Tuner, effort: TuningEffort) -> tuple[TuningEnd, int]:
    """The best end, and the steps of all."""
    begins, ends = _ranked([_anew(search, start) for start in _starts(search)]), []
    search.guarded = ()
    for begin in begins[:STARTS]:
        ends.append(rounds(search, end_at(search, begin.logarithms), effort, effort.most_steps // 4))
        if ends[-1].keeps_all:
            break
    if effort.blind and all(end.misses for end in ends):
        ends.append(rounds(search, _blind(search, effort.blind), effort, effort.most_steps // 4))
    return min(ends, key=lambda end: end.merit), sum(end.steps for end in ends)


def _starts(search: Tuner) -> list[np.ndarray]:
    loop, names = search.case.loop, search.gains.names
    return [np.log10([values[name] for name in names]) for values in (loop.values, *loop.structure.further_starts)]


def _anew(search: Tuner, logarithms: np.ndarray) -> TuningEnd:
    """A start judged with the beds alone that are least damped there."""
    search.guarded = ()
    return end_at(search, logarithms)


def _ranked(begins: list[TuningEnd]) -> list[TuningEnd]:
    """First those nearly as cheap as the cheapest one, then the others, each by what they miss."""
    cheap = NEARLY_AS_CHEAP * min(begin.judged.cost for begin in begins)
    return sorted(begins, key=lambda begin: (begin.judged.cost > cheap, begin.merit))


def add_scenarios(search: Tuner, at: TuningEnd, effort: TuningEffort) -> bool:
    """Whether beds miss their damping there that the search did not see; it sees the least damped from now on.

    Looked at are the worst beds of the box and further beds that fill it.
    """
    logarithms, box = at.logarithms, search.case.uncertainty
    try:
        worst = worst_positions(
            lambda positions: search.rooms_of(beds_at(search.case, positions), logarithms),
            search.positions[list(search.guarded)],
        )
        unstable = worst[search.rooms_of(beds_at(search.case, worst), logarithms) < STABLE_SHARE - 1]
        count = 0 if at.misses else round(BEYOND_POOL * effort.pool)  # what beds miss anyway, more beds do not cure
        further = box.spread(effort.pool + count)[effort.pool :]
        room = search.rooms_of(beds_at(search.case, further), logarithms) if count else np.zeros(0)
    except InputError:
        return False
    missed = further[np.argsort(room)[: min(MOST_ADDED, int((room < -DAMPING_RESERVE / 2).sum()))]]
    for positions, share in ((unstable, STABLE_SHARE), (missed, 1.0)):
        if len(positions):
            search.add(positions, share)
    return bool(len(unstable) or len(missed))


def _further_round(search: Tuner, best: TuningEnd, effort: TuningEffort, used: int) -> tuple[TuningEnd, int]:
    """One more round with beds that were added, and the steps that all rounds took."""
    left = max(effort.most_steps - used, effort.steps)
    end = rounds(search, end_at(search, best.logarithms), replace(effort, rounds=1), left)
    return end, used + end.steps


def _blind(search: Tuner, count: int) -> TuningEnd:
    """The best of settings spread over all bounds."""
    low, high = bounds_of(search)
    spread = low + (high - low) * scipy.stats.qmc.Sobol(len(low), seed=0).random(count)
    return end_at(search, min(spread, key=lambda logarithms: search.judged(logarithms).merit))
