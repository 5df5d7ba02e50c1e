"""Beds with opened cut shafts have to be stable."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeGuard

import numpy as np

from matching.match.beds import (
    SHARES,
    damping_left,
)
from matching.match.case import apply
from matching.match.objective import Search
from matching.match.rounds import SearchEnd, end_at, judged_again, keeps_all, rounds
from matching.match.variables import CONTROLLER, REGULATOR

# --- Beds with opened cut shafts have to be stable: reached by homotopy in the constraint level and in the dead time.
#
# From weights that know no opened shafts the requirements are far off and their slopes lead nowhere. So what is missed
# is asked for in parts, each round beginning near what it has to keep; and where that comes to a stop, shorter dead
# times, at which opened shafts cost little, lead there (continuation: Allgower and Georg, Numerical Continuation
# Methods, 1990).


@dataclass(frozen=True)
class OpenedSettings:
    """Numbers of that homotopy; all were chosen by trial.

    Attributes
    ----------
    drawn : int
        Drawn beds, each looked at with all shares of its cut shafts left.
    planned_price, drawn_price : float
        Relative cost that stable opened beds may add, as planned and drawn.
    raised : float
        Decades that the weight on commands may rise: more would damp the emulated modes along with the opened beds.
    parts : int
        That a requirement is asked for in, at most.
    part : float
        Of what the worst bed misses, that a round leaves.
    small : float
        Of the damping that drawn beds need: what is missed by less is asked for at once.
    steps : int
        Of a round that asks for a part.
    stuck : float
        Of what the worst bed missed before: a round that leaves more is the last one.
    last_rounds, drawn_rounds : int
        Rounds that ask for everything, as planned and drawn.
    dead_times : tuple of float
        Of the case's own, over which the search comes to it.
    """

    drawn: int = 16
    planned_price: float = 2.0
    drawn_price: float = 0.25
    raised: float = 2.0
    parts: int = 12
    part: float = 0.25
    small: float = 1.0
    steps: int = 20
    stuck: float = 0.9
    last_rounds: int = 4
    drawn_rounds: int = 2
    dead_times: tuple[float, ...] = (0.5, 0.6, 0.7, 0.8, 0.9)


OPENED = OpenedSettings()


def with_opened(search: Search, best: SearchEnd) -> SearchEnd:
    """The best end with opened cut shafts that are stable, or ``best`` where none is there at the price.

    First the bed as planned has to be stable with every share of its cut shafts, then drawn beds have to be. What is
    kept is seen by the search from then on.
    """
    planned_beds = {left: np.zeros((1, search.positions.shape[1])) for left in SHARES}
    name = f"{CONTROLLER}{REGULATOR[0]}"
    search.highest = {name: float(best.x[search.names.index(name)]) + OPENED.raised}
    end = _kept_opened(search, best, planned_beds)
    if end is None:
        search.highest = {}
        return best
    drawn = least_stable_opened(search, end.x)
    return (_kept_of_drawn(search, end, drawn) if drawn else None) or end


def least_stable_opened(search: Search, x: np.ndarray) -> dict[float, np.ndarray]:
    """Position (1, p) of the least stable of some beds with opened cut shafts, by the share left, if it is unstable."""
    positions, least = search.case.uncertainty.spread(OPENED.drawn), {}
    for left in SHARES:
        room = search.damping_margins_at(x, positions, left)
        if room.min() < search.settings.stable_share * damping_left(left) - 1:
            least[left] = positions[[int(room.argmin())]]
    return least


def _kept_opened(search: Search, best: SearchEnd, opened: Mapping[float, np.ndarray]) -> SearchEnd | None:
    """The end with opened beds, positions (n, p) by the share left, if they are stable at no more than the price.

    Without an end they are not seen any more.
    """
    if not keeps_all(search, best):
        return None
    count, most = len(search.positions), min((1 + OPENED.planned_price) * best.judged.cost, 1.0)
    numbers = _add(search, opened)
    end: SearchEnd | None = _in_parts(search, best.x, numbers, most)
    if not _is_within(search, end, most):
        search.active = (0, *numbers)
        search.forget()
        end = _over_dead_times(search, best.x, opened, most)
    if not _is_within(search, end, most):
        search.keep_first(count)
        return None
    return end


def _kept_of_drawn(search: Search, best: SearchEnd, opened: Mapping[float, np.ndarray]) -> SearchEnd | None:
    """The same of drawn beds, which the best end nearly keeps: at once, and for less."""
    count = len(search.positions)
    _add(search, opened)
    end = _asked_at_once(search, end_at(search, best.x), OPENED.drawn_rounds)
    if not _is_within(search, end, min((1 + OPENED.drawn_price) * best.judged.cost, 1.0)):
        search.keep_first(count)
        return None
    return end


def _is_within(search: Search, end: SearchEnd | None, most: float) -> TypeGuard[SearchEnd]:
    return end is not None and keeps_all(search, end) and end.judged.cost <= most


def _add(search: Search, opened: Mapping[float, np.ndarray]) -> tuple[int, ...]:
    """The numbers that they have in the pool."""
    return tuple(
        number
        for left, positions in opened.items()
        for number in search.add(positions, search.settings.stable_share, left)
    )


def _asked_at_once(search: Search, begin: SearchEnd, most_rounds: int = OPENED.last_rounds) -> SearchEnd:
    return rounds(search, begin, most_rounds, search.settings.most_steps // 2)


def _in_parts(search: Search, begin: np.ndarray, numbers: tuple[int, ...], most: float) -> SearchEnd:
    """The end from ``begin`` (m,) on, the beds of some numbers asked for in parts.

    It is where the rounds stopped, if they came to a stop or if the cost rose above ``most``.
    """
    asked = np.array([search.shares[number] for number in numbers])
    lefts = np.array([search.left[number] for number in numbers])
    positions = search.positions[list(numbers)]

    def rooms(x: np.ndarray) -> np.ndarray:
        each = [
            search.damping_margins_at(x, position[None], left)[0]
            for position, left in zip(positions, lefts, strict=True)
        ]
        return np.array(each)

    end, before = end_at(search, begin), np.inf
    for _ in range(OPENED.parts):
        missed = np.maximum(asked - 1 - rooms(end.x), 0.0)
        worst = float(missed.max())
        stopped = worst > OPENED.small and (worst > OPENED.stuck * before or end.judged.cost > most)
        if stopped or worst <= OPENED.small:
            break
        search.ask(dict(zip(numbers, (asked - np.minimum(missed, OPENED.part * worst)).tolist(), strict=True)))
        end = rounds(search, judged_again(search, end), 1, OPENED.steps)
        before = worst
    search.ask(dict(zip(numbers, asked.tolist(), strict=True)))
    end = judged_again(search, end)
    return end if stopped else _asked_at_once(search, end)


def _over_dead_times(
    search: Search, begin: np.ndarray, opened: Mapping[float, np.ndarray], most: float
) -> SearchEnd | None:
    """The end at the dead time of the case, reached from ``begin`` (m,) over shorter ones; none where one has none."""
    first, *others = OPENED.dead_times
    at = _with_dead_time(search, first)
    begin = rounds(at, end_at(at, begin), search.settings.rounds, search.settings.steps).x
    end = _in_parts(at, begin, _add(at, opened), most)
    for part in (*others, 1.0):
        if not _is_within(at, end, most):
            return None
        at = search if part == 1 else _with_dead_time(search, part)
        if at is not search:
            _add(at, opened)
        end = _asked_at_once(at, end_at(at, end.x))
    return end


def _with_dead_time(search: Search, part: float) -> Search:
    """The same search where the dead time in the middle of the box is only a part of the case's."""
    dead_time = part * search.case.loop["dead_time"]
    case = apply(search.case, {"loop.dead_time": dead_time})
    positions = search.positions[: search.settings.pool + 1]
    return Search(
        case, search.variables, search.required, search.demands, search.settings, positions, search.free,
        highest=search.highest,
    )  # fmt: skip
