"""The least damped beds of a box: descents from the least damped ones of a pool."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from matching.match.beds import (
    descended,
)
from matching.match.objective import Search, SpeedSearch
from matching.match.rounds import SearchEnd, misses
from modelling.errors import NoDesign


@dataclass(frozen=True)
class DescentSettings:
    """Numbers of the descents to the least damped beds; all were chosen by trial.

    Attributes
    ----------
    begins : int
        Beds of the pool from which a descent begins, the least damped ones.
    rounds : int
        Of a descent at most, each with a gradient of its own.
    further : float
        Times the pool: beds that are looked through once for what the pool has missed.
    most_added : int
        Of those, the least damped ones.
    """

    begins: int = 2
    rounds: int = 3
    further: float = 5.4
    most_added: int = 12


DESCENT = DescentSettings()


def worst_positions(room: Callable[[np.ndarray], np.ndarray], pool: np.ndarray) -> np.ndarray:
    """Positions (n, p) in the box at which least is left of a requirement, by descents from those of a pool (b, p).

    Parameters
    ----------
    room : callable
        What is left (b,) of the requirement at positions (b, p), each coordinate from −1 to 1.
    """
    if not pool.size:
        return pool[:0]
    begins = pool[np.argsort(room(pool))[: DESCENT.begins]]
    ends = [descended(lambda at: 1 + room(at)[:, None], begin, DESCENT.rounds) for begin in begins]
    return np.unique([position for _, position, _ in ends], axis=0)


def add_scenarios(search: Search, at: SearchEnd) -> bool:
    """Whether beds miss their damping there that the search did not see; it sees the least damped from now on.

    Looked at are the worst beds of the box and further beds that fill it, at every speed of the search.
    """
    added = [_added(one, SearchEnd(at.x, one.judged(at.x))) for one in search.members]
    return any(added)


def _added(search: SpeedSearch, at: SearchEnd) -> bool:
    settings, box = search.settings, search.case.uncertainty
    if not box.uncertain:
        return False
    try:
        seen = np.array([number for number in search.active if number not in search.opened])
        worst = worst_positions(lambda positions: search.damping_margins_at(at.x, positions), search.positions[seen])
        unstable = worst[search.damping_margins_at(at.x, worst) < settings.stable_share - 1]
        # what beds miss anyway, more beds do not cure
        count = 0 if misses(search, at) else round(DESCENT.further * settings.pool)
        further = box.spread(settings.pool + count)[settings.pool :]
        misses_by = search.misses_damping_at(at.x, further) if count else np.zeros(0)
    except NoDesign:
        return False
    number = min(DESCENT.most_added, int((misses_by > 0).sum()))
    missed = further[np.argsort(-misses_by)[:number]]
    for positions, share in ((unstable, settings.stable_share), (missed, 1.0)):
        if len(positions):
            search.add(positions, share)
    return bool(len(unstable) or len(missed))
