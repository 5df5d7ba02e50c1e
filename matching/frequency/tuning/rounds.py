"""Rounds of the search over an observer's weights, each from where the one before ended."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import scipy

from matching.frequency.beds.design_point import Judged
from matching.frequency.beds.tuner import DAMPING_RESERVE, RESERVE, Tuner

FURTHEST = 1.0  # decades that a round may go
WORTH_A_ROUND = 0.01  # relative gain of a round below which no other follows
WORTH_AT_ALL = 1e-3  # of the squared tolerance: the same where the errors are far below it
SETTLED = 1e-4  # change of the cost at which a round ends; where the cost is above 1, relative to it
POINTS_A_STEP = 4  # that a round may judge for each of its steps: where line searches come to nothing, it ends
KEPT = -2e-3  # of a requirement: what is missed by so little is within its reserve
HOPELESS_MERIT = 50.0  # merit after a round, several requirements missed by all of them: no other round follows


@dataclass(frozen=True)
class TuningEffort:
    """Of the search and of its judgement.

    Attributes
    ----------
    drawn, pool : int
        Beds whose errors are tuned, and beds that are kept damped.
    rounds, steps : int
        At most, and steps of each.
    most_steps : int
        Of all rounds together, as many from every start; added beds get what is left, one round at least.
    scenarios : int
        Times that the least damped beds of the whole box, and of further beds that fill it, are added to the pool, at
        most, each with one more round.
    blind : int
        Settings spread over the whole bounds, where every start of the structure's ends with a requirement missed.
    fresh : int
        Beds that judge the result.
    """

    drawn: int = 24
    pool: int = 160
    rounds: int = 6
    steps: int = 20
    most_steps: int = 200
    scenarios: int = 2
    blind: int = 64
    fresh: int = 200


@dataclass(frozen=True)
class TuningEnd:
    """Where a search ended: logarithms (w,) of the weights, what was judged there, and the steps that led there."""

    logarithms: np.ndarray
    judged: Judged
    steps: int = 0

    @property
    def merit(self) -> float:
        """By which ends are compared."""
        return self.judged.merit

    @property
    def keeps_all(self) -> bool:
        """Whether every requirement is met."""
        return bool(self.judged.least.min() >= KEPT)

    @property
    def misses(self) -> bool:
        """Whether a requirement is missed by more than the reserve by which the search draws it in."""
        *damping, noise, rolled_off, margin = self.judged.least
        return min(damping, default=0.0) < -DAMPING_RESERVE or min(noise, rolled_off, margin) < -RESERVE


def end_at(search: Tuner, logarithms: np.ndarray) -> TuningEnd:
    """A point (w,) judged with the beds of the pool that are least damped there."""
    search.guard(logarithms)
    return TuningEnd(logarithms, search.judged(logarithms))


def judged_again(search: Tuner, end: TuningEnd) -> TuningEnd:
    """The same point by what the search asks now, with the beds that it sees."""
    return replace(end, judged=search.judged(end.logarithms))


def bounds_of(search: Tuner) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper logarithms (w,) of the weights."""
    quantities, names = search.case.loop.structure.quantities, search.gains.names
    low, high = (np.log10([getattr(quantities[name], side) for name in names]) for side in ("lower", "upper"))
    return low, np.minimum(high, [search.highest.get(name, np.inf) for name in names])


def rounds(search: Tuner, begin: TuningEnd, effort: TuningEffort, most_steps: int) -> TuningEnd:
    """Rounds of the search, each from the best point of the one before with the beds that were least damped there."""
    (low, high), best, used = bounds_of(search), begin, 0
    for _ in range(effort.rounds):
        at = best.logarithms
        within = list(zip(np.maximum(low, at - FURTHEST), np.minimum(high, at + FURTHEST), strict=True))
        used += _improve(search, at, within, max(min(effort.steps, most_steps - used), 1))
        end = end_at(search, search.best)
        worth = best.merit - end.merit >= max(WORTH_A_ROUND * best.merit, WORTH_AT_ALL)
        best = min(best, end, key=lambda end: end.merit)
        if not worth or used >= most_steps or (end.merit > HOPELESS_MERIT and end.judged.cost > 1):
            break
    return replace(best, steps=used)


class _TooManyPoints(Exception):
    """Line searches come to nothing."""


def _improve(search: Tuner, begin: np.ndarray, within: list[tuple[float, float]], steps: int) -> int:
    """The steps that were taken; what was judged on the way is known to the search."""
    judged = 0

    def cost(logarithms: np.ndarray) -> float:
        nonlocal judged
        judged += 1
        if judged > POINTS_A_STEP * steps:
            raise _TooManyPoints
        return search.judged(logarithms).cost

    @lru_cache(maxsize=1)  # cost and requirements ask for their slopes one after the other, at the same point
    def slopes(logarithms: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
        return search.slopes(np.array(logarithms))

    try:
        result = scipy.optimize.minimize(
            cost, begin, bounds=within, method="SLSQP",
            jac=lambda at: slopes(tuple(at.tolist()))[0],
            constraints={
                "type": "ineq", "fun": lambda at: search.judged(at).room,
                "jac": lambda at: slopes(tuple(at.tolist()))[1],
            },
            options={"maxiter": steps, "ftol": SETTLED * max(1.0, search.judged(search.best).cost)},
        )  # fmt: skip
    except _TooManyPoints:
        return steps
    return int(result.nit)
