"""Rounds of sequential quadratic programming (SciPy's SLSQP), each from where the one before ended."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import scipy

from matching.match.objective import Evaluation, Search


@dataclass(frozen=True)
class SearchEnd:
    """Where a search ended: the point (m,), what was judged there, and the steps that led there."""

    x: np.ndarray
    judged: Evaluation
    steps: int = 0

    @property
    def penalised_cost(self) -> float:
        """By which ends are compared."""
        return self.judged.penalised_cost


def end_at(search: Search, x: np.ndarray) -> SearchEnd:
    """A point (m,) judged with the beds of the pool that are least damped there."""
    search.activate(x)
    return SearchEnd(x, search.judged(x))


def judged_again(search: Search, end: SearchEnd) -> SearchEnd:
    """The same point by what the search asks now, with the beds that it sees."""
    return replace(end, judged=search.judged(end.x))


def keeps_all(search: Search, end: SearchEnd) -> bool:
    """Whether every requirement is met."""
    return bool(end.judged.least_margins.min() >= search.settings.kept)


def misses(search: Search, end: SearchEnd) -> bool:
    """Whether a requirement is missed by more than the reserve by which the search draws it in."""
    reserves = np.full(len(end.judged.least_margins), search.settings.reserve)
    reserves[: len(search.active)] = search.settings.damping_reserve
    return bool((end.judged.least_margins < -reserves).any())


def rounds(search: Search, begin: SearchEnd, most_rounds: int, most_steps: int) -> SearchEnd:
    """Rounds, each from the best point of the one before with the beds that were least damped there."""
    (low, high), best, used, settings = search.bounds(), begin, 0, search.settings
    for _ in range(most_rounds):
        x = best.x
        within = np.maximum(low, x - settings.furthest), np.minimum(high, x + settings.furthest)
        used += _improve(search, x, within, max(min(settings.steps, most_steps - used), 1))
        end = end_at(search, search.best)
        best = judged_again(search, best)
        worth = best.penalised_cost - end.penalised_cost >= max(
            settings.worth_a_round * best.penalised_cost, settings.worth_at_all
        )
        best = min(best, end, key=lambda end: end.penalised_cost)
        if not worth or used >= most_steps or (end.penalised_cost > settings.hopeless and end.judged.cost > 1):
            break
    return replace(best, steps=used)


class _TooManyPoints(Exception):
    """Line searches come to nothing."""


def _improve(search: Search, begin: np.ndarray, within: tuple[np.ndarray, np.ndarray], steps: int) -> int:
    """The steps that were taken; what was judged on the way is known to the search.

    What a start misses is allowed at a price, by one slack for the damping of beds and one for the rest: a setting that
    cannot do anything for one requirement may still do so for the others (elastic mode).
    """
    count, settings = 0, search.settings
    price = 3 * settings.penalty * max(1.0, search.judged(begin).cost)
    moving = np.flatnonzero(search.free)
    room = search.judged(begin).margins
    of_damping = np.arange(len(room)) < len(search.active)
    groups = [group for group in (of_damping, ~of_damping) if room[group].min(initial=0.0) < settings.kept]
    slacks = np.stack([group.astype(float) for group in groups], axis=1) if groups else np.zeros((len(room), 0))
    missed = np.array([-room[group].min() for group in groups])

    def whole(y: np.ndarray) -> np.ndarray:
        x = begin.copy()
        x[moving] = y[: len(moving)]
        return x

    def cost(y: np.ndarray) -> float:
        nonlocal count
        count += 1
        if count > settings.points_a_step * steps:
            raise _TooManyPoints
        return search.judged(whole(y)).cost + price * float(y[len(moving) :].sum())

    @lru_cache(maxsize=1)  # cost and requirements ask for their slopes one after the other, at the same point
    def slopes(y: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
        of_cost, of_room = search.slopes(whole(np.array(y)))
        prices = np.full(slacks.shape[1], price)
        return np.concatenate([of_cost[moving], prices]), np.hstack([of_room[:, moving], slacks])

    bounds = [*zip(within[0][moving], within[1][moving], strict=True), *[(0.0, None)] * len(missed)]
    try:
        result = scipy.optimize.minimize(
            cost, np.concatenate([begin[moving], missed]), bounds=bounds, method="SLSQP",
            jac=lambda y: slopes(tuple(y.tolist()))[0],
            constraints={
                "type": "ineq", "fun": lambda y: search.judged(whole(y)).margins + slacks @ y[len(moving) :],
                "jac": lambda y: slopes(tuple(y.tolist()))[1],
            },
            options={"maxiter": steps, "ftol": settings.settled * max(1.0, search.judged(search.best).cost)},
        )  # fmt: skip
    except _TooManyPoints:
        return steps
    return int(result.nit)
