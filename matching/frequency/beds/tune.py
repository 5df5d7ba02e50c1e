"""Tuning of an observer's weights over drawn beds: the beds' mean square error, with what every one has to keep."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import scipy

from matching.frequency.beds.closed_loop import SampledBeds, sampled_beds
from matching.frequency.beds.design_point import Judged
from matching.frequency.beds.softened import SHARES, damping_left, softened
from matching.frequency.beds.tuner import DAMPING_RESERVE, RESERVE, STABLE_SHARE, Tuner
from matching.frequency.beds.worst import worst_positions
from modelling.common.errors import InputError

FURTHEST = 1.0  # decades that a round may go
WORTH_A_ROUND = 0.01  # relative gain of a round below which no other follows
WORTH_AT_ALL = 1e-3  # of the squared tolerance: the same where the errors are far below it
SETTLED = 1e-4  # change of the cost at which a round ends; where the cost is above 1, relative to it
POINTS_A_STEP = 4  # that a round may judge for each of its steps: where line searches come to nothing, it ends
KEPT = -2e-3  # of a requirement: what is missed by so little is within its reserve
BEYOND_POOL = 5.4  # times the pool: beds that are looked through once for what the pool has missed
MOST_ADDED = 12  # of those, the least damped ones
OPENED = 16  # drawn beds, each looked at with all shares of its cut shafts left
PLANNED_ROUNDS, PLANNED_PRICE = 2, 1.2  # for the bed as planned with opened cut shafts; relative cost that it may add
DRAWN_ROUNDS, DRAWN_PRICE = 1, 0.25  # for drawn beds with them
OUT_OF_REACH = 50.0  # merit after a round, several requirements missed by all of them: no other round follows
STARTS = 2  # that are followed at most
NEARLY_AS_CHEAP = 1.5  # times the cost of the cheapest start, up to which the requirements decide between starts
BLIND = 64  # settings over the whole bounds, where every start of the structure's ends with a requirement missed


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
    fresh : int
        Beds that judge the result.
    """

    drawn: int = 24
    pool: int = 160
    rounds: int = 6
    steps: int = 20
    most_steps: int = 200
    scenarios: int = 2
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


def tuned_weights(search: Tuner, effort: TuningEffort | None = None) -> tuple[dict[str, float], float]:
    """Weights by name, and their cost: sequential quadratic programming with exact derivatives.

    The cost is the mean square of the drawn beds' response errors to unmeasured torques, over the tolerance. The search
    begins at the better one of the case's weights and the structure's further starts, and at the next one where it ends
    with a requirement missed; where all do by more than the reserve, at the best of settings drawn over the bounds.
    Then the bed as planned has to be stable with opened cut shafts as well, and after it drawn beds, where that keeps
    all else and adds no more than :data:`PLANNED_PRICE` and :data:`DRAWN_PRICE` to the cost.
    """
    effort = effort or TuningEffort()
    best, used = _from_starts(search, effort)
    if effort.scenarios and best.judged.cost <= 1:  # beyond their tolerance the errors limit the match anyway
        planned = {left: np.zeros((1, search.positions.shape[1])) for left in SHARES}
        best, used, kept = _with_opened(search, best, effort, used, planned, (PLANNED_ROUNDS, PLANNED_PRICE))
        if kept:
            drawn = least_stable_opened(search, best.logarithms)
            best, used, _ = _with_opened(search, best, effort, used, drawn, (DRAWN_ROUNDS, DRAWN_PRICE))
    for _ in range(effort.scenarios):
        if not add_scenarios(search, _end(search, best.logarithms), effort):
            break
        best, used = _further_round(search, best, effort, used)
    return dict(zip(search.gains.names, (10.0**best.logarithms).tolist(), strict=True)), best.judged.cost


def _from_starts(search: Tuner, effort: TuningEffort) -> tuple[TuningEnd, int]:
    """The best end, and the steps of all."""
    begins, ends = _ranked([_anew(search, start) for start in _starts(search)]), []
    search.guarded = ()
    for begin in begins[:STARTS]:
        ends.append(_rounds(search, _end(search, begin.logarithms), effort, effort.most_steps // 4))
        if ends[-1].keeps_all:
            break
    if all(end.misses for end in ends):
        ends.append(_rounds(search, _blind(search), effort, effort.most_steps // 4))
    return min(ends, key=lambda end: end.merit), sum(end.steps for end in ends)


def _starts(search: Tuner) -> list[np.ndarray]:
    loop, names = search.case.loop, search.gains.names
    return [np.log10([values[name] for name in names]) for values in (loop.values, *loop.structure.further_starts)]


def _anew(search: Tuner, logarithms: np.ndarray) -> TuningEnd:
    """A start judged with the beds alone that are least damped there."""
    search.guarded = ()
    return _end(search, logarithms)


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
            lambda positions: search.rooms_of(_beds(search, positions), logarithms),
            search.positions[list(search.guarded)],
        )
        unstable = worst[search.rooms_of(_beds(search, worst), logarithms) < STABLE_SHARE - 1]
        count = 0 if at.misses else round(BEYOND_POOL * effort.pool)  # what beds miss anyway, more beds do not cure
        further = box.spread(effort.pool + count)[effort.pool :]
        room = search.rooms_of(_beds(search, further), logarithms) if count else np.zeros(0)
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
    end = _rounds(search, _end(search, best.logarithms), replace(effort, rounds=1), left)
    return end, used + end.steps


def _with_opened(
    search: Tuner, best: TuningEnd, effort: TuningEffort, used: int, beds: Mapping[float, np.ndarray],
    allowed: tuple[int, float],
) -> tuple[TuningEnd, int, bool]:  # fmt: skip
    """Rounds in which beds with opened cut shafts have to be stable, positions (n, p) by the share that is left.

    They begin at the best end so far and, where several rounds do not lead from there to what is ``allowed`` (rounds,
    and the relative rise of the cost), at the start that misses least with them. Last returned is whether the beds
    stay.
    """
    rounds, price = allowed
    count = len(search.positions)
    if not best.keeps_all or not beds:
        return best, used, best.keeps_all
    for left, positions in beds.items():
        search.add(positions, STABLE_SHARE, left)
    end, guarded = best, search.guarded
    for attempt in range(min(rounds, 2)):
        if attempt:
            search.guarded = guarded
            end = min((_end(search, start) for start in _starts(search)), key=lambda begin: begin.merit)
        for _ in range(rounds):
            end, used = _further_round(search, end, effort, used)
            if end.merit > OUT_OF_REACH:
                break
        if end.keeps_all and end.judged.cost <= (1 + price) * best.judged.cost:
            return end, used, True
        if end.merit > OUT_OF_REACH:
            break
    search.keep_first(count)
    return best, used, False


def least_stable_opened(search: Tuner, logarithms: np.ndarray) -> dict[float, np.ndarray]:
    """Position (1, p) of the least stable of some beds with opened cut shafts, by the share left, if it is unstable."""
    positions, least = search.case.uncertainty.spread(OPENED), {}
    for left in SHARES:
        room = search.rooms_of(_beds(search, positions, left), logarithms)
        if room.min() < STABLE_SHARE * damping_left(left) - 1:
            least[left] = positions[[int(room.argmin())]]
    return least


def _beds(search: Tuner, positions: np.ndarray, left: float = 1.0) -> SampledBeds:
    case = search.case
    return sampled_beds(case, [softened(case, case.uncertainty.at(position), left) for position in positions])


def _end(search: Tuner, logarithms: np.ndarray) -> TuningEnd:
    """A point judged with the beds of the pool that are least damped there."""
    search.guard(logarithms)
    return TuningEnd(logarithms, search.judged(logarithms))


def _blind(search: Tuner) -> TuningEnd:
    """The best of settings spread over all bounds."""
    low, high = _bounds(search)
    spread = low + (high - low) * scipy.stats.qmc.Sobol(len(low), seed=0).random(BLIND)
    return _end(search, min(spread, key=lambda logarithms: search.judged(logarithms).merit))


def _bounds(search: Tuner) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper logarithms (w,) of the weights."""
    quantities, names = search.case.loop.structure.quantities, search.gains.names
    low, high = (np.log10([getattr(quantities[name], side) for name in names]) for side in ("lower", "upper"))
    return low, high


def _rounds(search: Tuner, begin: TuningEnd, effort: TuningEffort, most_steps: int) -> TuningEnd:
    """Rounds of the search, each from the best point of the one before with the beds that were least damped there."""
    (low, high), best, used = _bounds(search), begin, 0
    for _ in range(effort.rounds):
        at = best.logarithms
        within = list(zip(np.maximum(low, at - FURTHEST), np.minimum(high, at + FURTHEST), strict=True))
        used += _improve(search, at, within, max(min(effort.steps, most_steps - used), 1))
        end = _end(search, search.best)
        worth = best.merit - end.merit >= max(WORTH_A_ROUND * best.merit, WORTH_AT_ALL)
        best = min(best, end, key=lambda end: end.merit)
        if not worth or used >= most_steps or (end.merit > OUT_OF_REACH and end.judged.cost > 1):
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
