"""Rounds of sequential quadratic programming (SciPy's SLSQP), each from where the one before ended."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import scipy

from matching.match.objective import OF_ERRORS, Evaluation, Search, SpeedSearch


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
    """Whether every robustness requirement is met; the errors are no such requirement."""
    return bool(end.judged.least_margins[:-OF_ERRORS].min() >= search.settings.kept)


def within_errors(search: Search, end: SearchEnd) -> bool:
    """Whether both errors of the bed as planned are allowed."""
    return bool(end.judged.least_margins[-OF_ERRORS:].min() >= search.settings.kept)


def misses(search: Search | SpeedSearch, end: SearchEnd) -> bool:
    """Whether a robustness requirement is missed by more than the reserve by which the search draws it in."""
    margins = end.judged.least_margins[:-OF_ERRORS]
    reserves = np.full(len(margins), search.settings.reserve)
    reserves[: search.beds_seen] = search.settings.damping_reserve
    return bool((margins < -reserves).any())


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

    What a start misses is allowed at a price, by one slack each for the damping of beds, for the errors of the bed as
    planned and for the rest: a setting that cannot do anything for one requirement may still do so for the others
    (elastic mode). Errors are asked to be allowed where the rest is kept, so that nothing robust is given up for them.
    """
    count, settings = 0, search.settings
    moving = np.flatnonzero(search.free)
    room = search.judged(begin).margins
    of_damping = np.arange(len(room)) < search.beds_seen
    of_errors = np.arange(len(room)) >= len(room) - search.of_errors
    robust = bool(room[~of_errors].min(initial=np.inf) >= settings.kept)
    kinds = (
        (of_damping, settings.penalty), (~of_damping & ~of_errors, settings.penalty),
        (of_errors, settings.penalty if robust else settings.error_penalty),
    )  # fmt: skip
    groups = [
        (group, price) for group, price in kinds
        if room[group].min(initial=0.0) < settings.kept or (group is of_errors and not robust)
    ]  # fmt: skip
    slacks = np.stack([group.astype(float) for group, _ in groups], axis=1) if groups else np.zeros((len(room), 0))
    missed = np.array([max(-room[group].min(), 0.0) for group, _ in groups])
    prices = 3 * max(1.0, search.judged(begin).cost) * np.array([price for _, price in groups])

    def whole(y: np.ndarray) -> np.ndarray:
        x = begin.copy()
        x[moving] = y[: len(moving)]
        return x

    def cost(y: np.ndarray) -> float:
        nonlocal count
        count += 1
        if count > settings.points_a_step * steps:
            raise _TooManyPoints
        return search.judged(whole(y)).cost + float(prices @ y[len(moving) :])

    @lru_cache(maxsize=1)  # cost and requirements ask for their slopes one after the other, at the same point
    def slopes(y: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
        of_cost, of_room = search.slopes(whole(np.array(y)))
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
