"""Tuning of an observer's weights over drawn beds: the beds' mean square error, with what every one has to keep."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from matching.frequency.beds.closed_loop import SampledBeds, sampled_beds
from matching.frequency.beds.design_point import Judged
from matching.frequency.beds.tuner import DAMPING_RESERVE, RESERVE, Tuner
from matching.frequency.beds.worst import worst_positions
from modelling.common.errors import InputError

FURTHEST = 1.0  # decades that a round may go
WORTH_A_ROUND = 0.01  # relative gain of a round below which no other follows
WORTH_AT_ALL = 1e-3  # of the squared tolerance: the same where the errors are far below it
SETTLED = 1e-4  # change of the cost at which a round ends
KEPT = -2e-3  # of a requirement: what is missed by so little is within its reserve
WORST_BED_SHARE = 0.1  # of the damping that drawn beds need, for the worst of the box: stable, with a reserve
BEYOND_POOL = 5.4  # times the pool: beds that are looked through once for what the pool has missed
MOST_ADDED = 12  # of those, the least damped ones
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
    """
    effort, structure = effort or TuningEffort(), search.case.loop.structure
    starts = [
        np.log10([values[name] for name in search.gains.names])
        for values in (search.case.loop.values, *structure.further_starts)
    ]
    ends: list[TuningEnd] = []
    for begin in sorted((_end(search, start) for start in starts), key=lambda end: end.merit):
        ends.append(_rounds(search, begin, effort, effort.most_steps // len(starts)))
        if ends[-1].keeps_all:
            break
    if all(end.misses for end in ends):
        ends.append(_rounds(search, _blind(search), effort, effort.most_steps // len(starts)))
    best, used = min(ends, key=lambda end: end.merit), sum(end.steps for end in ends)
    for _ in range(effort.scenarios):
        if not add_scenarios(search, _end(search, best.logarithms), effort):
            break
        begin = _end(search, best.logarithms)
        best = _rounds(search, begin, replace(effort, rounds=1), max(effort.most_steps - used, effort.steps))
        used += best.steps
    return dict(zip(search.gains.names, (10.0**best.logarithms).tolist(), strict=True)), best.judged.cost


def add_scenarios(search: Tuner, at: TuningEnd, effort: TuningEffort) -> bool:
    """Whether beds miss their damping there that the search did not see; it sees the least damped from now on."""
    logarithms, box = at.logarithms, search.case.uncertainty
    try:
        worst = worst_positions(
            lambda positions: search.rooms_of(_beds(search, positions), logarithms),
            search.positions[list(search.guarded)],
        )
        unstable = worst[search.rooms_of(_beds(search, worst), logarithms) < WORST_BED_SHARE - 1]
        count = 0 if at.misses else round(BEYOND_POOL * effort.pool)  # what beds miss anyway, more beds do not cure
        further = box.spread(effort.pool + count)[effort.pool :]
        room = search.rooms_of(_beds(search, further), logarithms) if count else np.zeros(0)
    except InputError:
        return False
    missed = further[np.argsort(room)[: min(MOST_ADDED, int((room < -DAMPING_RESERVE / 2).sum()))]]
    for positions, share in ((unstable, WORST_BED_SHARE), (missed, 1.0)):
        if len(positions):
            search.add(positions, share)
    return bool(len(unstable) or len(missed))


def _beds(search: Tuner, positions: np.ndarray) -> SampledBeds:
    return sampled_beds(search.case, [search.case.uncertainty.at(position) for position in positions])


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
        if not worth or used >= most_steps:
            break
    return replace(best, steps=used)


def _improve(search: Tuner, begin: np.ndarray, within: list[tuple[float, float]], steps: int) -> int:
    """The steps that were taken; what was judged on the way is known to the search."""
    result = scipy.optimize.minimize(
        lambda at: search.judged(at).cost, begin, bounds=within, method="SLSQP", jac=lambda at: search.slopes(at)[0],
        constraints={
            "type": "ineq", "fun": lambda at: search.judged(at).room, "jac": lambda at: search.slopes(at)[1],
        },
        options={"maxiter": steps, "ftol": SETTLED},
    )  # fmt: skip
    return int(result.nit)
