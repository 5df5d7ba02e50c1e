"""Beds with opened cut shafts have to be stable: asked for little by little, and first with less dead time.

From weights that know no opened shafts the requirements are far off and their slopes lead nowhere. So what is missed
is asked for in parts, each round beginning near what it has to keep; and where that comes to a stop, shorter dead
times, at which opened shafts cost little, lead there (continuation: Allgower and Georg, Numerical Continuation
Methods, 1990).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TypeGuard

import numpy as np

from matching.frequency.beds.softened import SHARES, beds_at, damping_left
from matching.frequency.beds.tuner import STABLE_SHARE, Tuner, tuner
from matching.frequency.tuning.rounds import TuningEffort, TuningEnd, end_at, judged_again, rounds

DRAWN = 16  # drawn beds, each looked at with all shares of its cut shafts left
PLANNED_PRICE, DRAWN_PRICE = 2.0, 0.25  # relative cost that stable opened beds may add, as planned and drawn
RAISED = {"command_weight": 2.0}  # decades at most: more would damp the emulated modes along with the opened beds
PARTS = 12  # that a requirement is asked for in, at most
PART = 0.5  # of what the worst one misses, that a round leaves
SMALL = 1.0  # of the damping that drawn beds need: what is missed by less is asked for at once
STEPS = 8  # of a round that asks for a part
STUCK = 0.9  # of what the worst one missed before: a round that leaves more is the last one
LAST_ROUNDS, DRAWN_ROUNDS = 4, 2  # that ask for everything, as planned and drawn
DEAD_TIMES = (0.5, 0.6, 0.7, 0.8, 0.9)  # of the case's own, over which the search comes to it


def with_opened(search: Tuner, best: TuningEnd, effort: TuningEffort) -> TuningEnd:
    """The best end with opened cut shafts that are stable, or ``best`` where none is there at the price.

    First the bed as planned has to be stable with every share of its cut shafts, then drawn beds have to be. What is
    kept is seen by the search from then on.
    """
    planned = {left: np.zeros((1, search.positions.shape[1])) for left in SHARES}
    begin = dict(zip(search.gains.names, best.logarithms.tolist(), strict=True))
    search.highest = {name: begin[name] + decades for name, decades in RAISED.items()}
    end = _kept(search, best, effort, planned)
    if end is None:
        search.highest = {}
        return best
    drawn = least_stable_opened(search, end.logarithms)
    return (_kept_of_drawn(search, end, effort, drawn) if drawn else None) or end


def least_stable_opened(search: Tuner, logarithms: np.ndarray) -> dict[float, np.ndarray]:
    """Position (1, p) of the least stable of some beds with opened cut shafts, by the share left, if it is unstable."""
    positions, least = search.case.uncertainty.spread(DRAWN), {}
    for left in SHARES:
        room = search.rooms_of(beds_at(search.case, positions, left), logarithms)
        if room.min() < STABLE_SHARE * damping_left(left) - 1:
            least[left] = positions[[int(room.argmin())]]
    return least


def _kept(
    search: Tuner, best: TuningEnd, effort: TuningEffort, opened: Mapping[float, np.ndarray]
) -> TuningEnd | None:  # fmt: skip
    """The end with opened beds, positions (n, p) by the share left, if they are stable at no more than the price.

    Without an end they are not seen any more.
    """
    if not best.keeps_all:
        return None
    count, most = len(search.positions), min((1 + PLANNED_PRICE) * best.judged.cost, 1.0)
    numbers = _add(search, opened)
    end: TuningEnd | None = _in_parts(search, best.logarithms, effort, numbers, most)
    if not _is_within(end, most):
        search.guarded = numbers
        end = _over_dead_times(search, best.logarithms, effort, opened, most)
    if not _is_within(end, most):
        search.keep_first(count)
        return None
    return end


def _kept_of_drawn(
    search: Tuner, best: TuningEnd, effort: TuningEffort, opened: Mapping[float, np.ndarray]
) -> TuningEnd | None:  # fmt: skip
    """The same of drawn beds, which the best end nearly keeps: at once, and for less."""
    count = len(search.positions)
    _add(search, opened)
    end = _asked_at_once(search, end_at(search, best.logarithms), effort, DRAWN_ROUNDS)
    if not _is_within(end, min((1 + DRAWN_PRICE) * best.judged.cost, 1.0)):
        search.keep_first(count)
        return None
    return end


def _is_within(end: TuningEnd | None, most: float) -> TypeGuard[TuningEnd]:
    return end is not None and end.keeps_all and end.judged.cost <= most


def _add(search: Tuner, opened: Mapping[float, np.ndarray]) -> tuple[int, ...]:
    """The numbers that they have in the pool."""
    count = len(search.positions)
    for left, positions in opened.items():
        search.add(positions, STABLE_SHARE, left)
    return tuple(range(count, len(search.positions)))


def _asked_at_once(search: Tuner, begin: TuningEnd, effort: TuningEffort, most_rounds: int = LAST_ROUNDS) -> TuningEnd:
    return rounds(search, begin, replace(effort, rounds=most_rounds), effort.most_steps // 2)


def _in_parts(
    search: Tuner, begin: np.ndarray, effort: TuningEffort, numbers: tuple[int, ...], most: float
) -> TuningEnd:  # fmt: skip
    """The end from ``begin`` (w,) on, the beds of some numbers asked for in parts.

    It is where the rounds stopped, if they came to a stop or if the cost rose above ``most``.
    """
    beds = search.sampled_pool.some(np.array(numbers))
    asked = np.array([search.shares[number] for number in numbers])
    end, before = end_at(search, begin), np.inf
    for _ in range(PARTS):
        missed = np.maximum(asked - 1 - search.rooms_of(beds, end.logarithms), 0.0)
        worst = float(missed.max())
        stopped = worst > SMALL and (worst > STUCK * before or end.judged.cost > most)
        if stopped or worst <= SMALL:
            break
        search.ask(dict(zip(numbers, asked - np.minimum(missed, PART * worst), strict=True)))
        end = rounds(search, judged_again(search, end), replace(effort, rounds=1), STEPS)
        before = worst
    search.ask(dict(zip(numbers, asked, strict=True)))
    end = judged_again(search, end)
    return end if stopped else _asked_at_once(search, end, effort)


def _over_dead_times(
    search: Tuner, begin: np.ndarray, effort: TuningEffort, opened: Mapping[float, np.ndarray], most: float
) -> TuningEnd | None:
    """The end at the dead time of the case, reached from ``begin`` (w,) over shorter ones; none where one has none."""
    first, *others = DEAD_TIMES
    at = _with_dead_time(search, first, effort)
    begin = rounds(at, end_at(at, begin), effort, effort.steps).logarithms
    end = _in_parts(at, begin, effort, _add(at, opened), most)
    for part in (*others, 1.0):
        if not _is_within(end, most):
            return None
        at = search if part == 1 else _with_dead_time(search, part, effort)
        if at is not search:
            _add(at, opened)
        end = _asked_at_once(at, end_at(at, end.logarithms), effort)
    return end


def _with_dead_time(search: Tuner, part: float, effort: TuningEffort) -> Tuner:
    """The same search where the dead time in the middle of the box is only a part of the case's."""
    case = search.case
    dead_time = part * case.loop["dead_time"]
    loop = case.loop.with_values({"dead_time": dead_time})
    box = case.uncertainty.about({"loop.dead_time": dead_time})
    made = tuner(replace(case, loop=loop, uncertainty=box), effort.drawn, effort.pool)
    made.highest = search.highest
    return made
