"""Beds with opened cut shafts have to be stable: asked for little by little, and first with less dead time.

From weights that know no opened shafts the requirements are far off and their slopes lead nowhere. So what is missed
is asked for in parts, each round beginning near what it has to keep; and where that comes to a stop, shorter dead
times, at which opened shafts cost little, lead there (continuation: Allgower and Georg, Numerical Continuation
Methods, 1990).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from matching.frequency.beds.rounds import TuningEffort, TuningEnd, end_at, judged_again, rounds
from matching.frequency.beds.softened import SHARES, beds_at, damping_left
from matching.frequency.beds.tuner import STABLE_SHARE, Tuner, tuner
from matching.frequency.case.case import Case

DRAWN = 16  # drawn beds, each looked at with all shares of its cut shafts left
PLANNED_PRICE, DRAWN_PRICE = 2.0, 0.25  # relative cost that stable opened beds may add, as planned and drawn
PARTS = 12  # that a requirement is asked for in, at most
PART = 0.5  # of what the worst one misses, that a round leaves
SMALL = 1.0  # of the damping that drawn beds need: what is missed by less is asked for at once
STEPS = 8  # of a round that asks for a part
STUCK = 0.9  # of what the worst one missed before: a round that leaves more is the last one
LAST_ROUNDS = 4  # that ask for everything
DEAD_TIMES = (0.5, 0.6, 0.7, 0.8, 0.9)  # of the case's own, over which the search comes to it


def with_opened(search: Tuner, best: TuningEnd, effort: TuningEffort) -> TuningEnd:
    """The best end with opened cut shafts that are stable, or ``best`` where none is there at the price.

    First the bed as planned has to be stable with every share of its cut shafts, then drawn beds have to be. What is
    kept is seen by the search from then on.
    """
    planned = {left: np.zeros((1, search.positions.shape[1])) for left in SHARES}
    end = _kept(search, best, effort, planned, PLANNED_PRICE)
    if end is None:
        return best
    drawn = least_stable_opened(search, end.logarithms)
    return (_kept(search, end, effort, drawn, DRAWN_PRICE) if drawn else None) or end


def least_stable_opened(search: Tuner, logarithms: np.ndarray) -> dict[float, np.ndarray]:
    """Position (1, p) of the least stable of some beds with opened cut shafts, by the share left, if it is unstable."""
    positions, least = search.case.uncertainty.spread(DRAWN), {}
    for left in SHARES:
        room = search.rooms_of(beds_at(search.case, positions, left), logarithms)
        if room.min() < STABLE_SHARE * damping_left(left) - 1:
            least[left] = positions[[int(room.argmin())]]
    return least


def _kept(
    search: Tuner, best: TuningEnd, effort: TuningEffort, opened: Mapping[float, np.ndarray], price: float
) -> TuningEnd | None:
    """The end with opened beds, positions (n, p) by the share left, if they are stable at no more than the price.

    Without an end they are not seen any more.
    """
    if not best.keeps_all:
        return None
    count, most = len(search.positions), min((1 + price) * best.judged.cost, 1.0)
    _add(search, opened)
    end = _in_parts(search, best.logarithms, effort, count, most)
    if not (end.keeps_all and end.judged.cost <= most) and price == PLANNED_PRICE:
        begin = _over_dead_times(search.case, best.logarithms, effort, opened, most)
        if begin is not None:
            end = _last_rounds(search, end_at(search, begin), effort)
    if end.keeps_all and end.judged.cost <= most:
        return end
    search.keep_first(count)
    return None


def _add(search: Tuner, opened: Mapping[float, np.ndarray]) -> None:
    for left, positions in opened.items():
        search.add(positions, STABLE_SHARE, left)


def _last_rounds(search: Tuner, begin: TuningEnd, effort: TuningEffort) -> TuningEnd:
    return rounds(search, begin, replace(effort, rounds=LAST_ROUNDS), effort.most_steps // 2)


def _in_parts(search: Tuner, begin: np.ndarray, effort: TuningEffort, count: int, most: float) -> TuningEnd:
    """The end from ``begin`` (w,) on, the beds after the first ``count`` asked for in parts.

    It is where the rounds stopped, if they came to a stop or if the cost rose above ``most``.
    """
    opened = np.arange(count, len(search.positions))
    beds = search.sampled_pool.some(opened)
    asked = np.array([search.shares[number] for number in opened.tolist()])
    end, before = end_at(search, begin), np.inf
    for _ in range(PARTS):
        missed = np.maximum(asked - 1 - search.rooms_of(beds, end.logarithms), 0.0)
        worst = float(missed.max())
        left = PART * worst if worst > SMALL else 0.0
        stopped = worst > SMALL and (worst > STUCK * before or end.judged.cost > most)
        search.ask(dict(zip(opened.tolist(), asked if stopped else asked - np.minimum(missed, left), strict=True)))
        if stopped:
            return judged_again(search, end)
        if not left:
            break
        end = rounds(search, judged_again(search, end), replace(effort, rounds=1), STEPS)
        before = worst
    search.ask(dict(zip(opened.tolist(), asked, strict=True)))
    return _last_rounds(search, judged_again(search, end), effort)


def _over_dead_times(
    case: Case, begin: np.ndarray, effort: TuningEffort, opened: Mapping[float, np.ndarray], most: float
) -> np.ndarray | None:
    """Weights (w,) for nearly the dead time of the case, with which opened beds are stable; none where they are not."""
    dead_time = case.loop["dead_time"]
    for i, share in enumerate(DEAD_TIMES):
        search = tuner(_with_dead_time(case, share * dead_time), effort.drawn, effort.pool)
        if not i:
            begin = rounds(search, end_at(search, begin), effort, effort.steps).logarithms
        count = len(search.positions)
        _add(search, opened)
        end = _last_rounds(search, end_at(search, begin), effort) if i else _in_parts(search, begin, effort, count, most)
        if not end.keeps_all or end.judged.cost > most:
            return None
        begin = end.logarithms
    return begin


def _with_dead_time(case: Case, dead_time: float) -> Case:
    """The same case with another dead time (s) in the middle of what it may be."""
    loop = case.loop.with_values({"dead_time": dead_time})
    return replace(case, loop=loop, uncertainty=case.uncertainty.about({"loop.dead_time": dead_time}))
