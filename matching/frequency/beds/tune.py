"""Tuning of an observer's weights over drawn beds: the beds' mean square error, with what every one has to keep."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from matching.frequency.beds.tuner import Judged, Tuner

FURTHEST = 1.0  # decades that a round may go
WORTH_A_ROUND = 0.01  # relative gain of a round below which no other follows
SETTLED = 1e-4  # change of the cost at which a round ends
KEPT = -2e-3  # of a requirement: what is missed by so little is within its reserve


@dataclass(frozen=True)
class TuningEffort:
    """Of the search and of its judgement.

    Attributes
    ----------
    drawn, pool : int
        Beds whose errors are tuned, and beds that are kept damped.
    rounds, steps : int
        At most, and steps of each.
    fresh : int
        Beds that judge the result.
    """

    drawn: int = 24
    pool: int = 160
    rounds: int = 6
    steps: int = 20
    fresh: int = 200


@dataclass(frozen=True)
class TuningEnd:
    """Where a search ended: logarithms (w,) of the weights, and what was judged there."""

    logarithms: np.ndarray
    judged: Judged

    @property
    def merit(self) -> float:
        """By which ends are compared."""
        return self.judged.merit

    @property
    def keeps_all(self) -> bool:
        """Whether every requirement is met."""
        return bool(self.judged.least.min() >= KEPT)


def tuned_weights(search: Tuner, effort: TuningEffort | None = None) -> tuple[dict[str, float], float]:
    """Weights by name, and their cost: sequential quadratic programming with exact derivatives.

    The cost is the mean square of the drawn beds' response errors to unmeasured torques, over the tolerance. The search
    begins at the better one of the case's weights and the structure's further starts, and at the next one where it ends
    with a requirement missed.
    """
    effort, structure = effort or TuningEffort(), search.case.loop.structure
    starts = [
        np.log10([values[name] for name in search.gains.names])
        for values in (search.case.loop.values, *structure.further_starts)
    ]
    ends: list[TuningEnd] = []
    for begin in sorted((_end(search, start) for start in starts), key=lambda end: end.merit):
        ends.append(_rounds(search, begin, effort))
        if ends[-1].keeps_all:
            break
    best = min(ends, key=lambda end: end.merit)
    return dict(zip(search.gains.names, (10.0**best.logarithms).tolist(), strict=True)), best.judged.cost


def _end(search: Tuner, logarithms: np.ndarray) -> TuningEnd:
    """A point judged with the beds of the pool that are least damped there."""
    search.guard(logarithms)
    return TuningEnd(logarithms, search.judged(logarithms))


def _rounds(search: Tuner, begin: TuningEnd, effort: TuningEffort) -> TuningEnd:
    """Rounds of the search, each from the best point of the one before with the beds that were least damped there."""
    quantities, best = search.case.loop.structure.quantities, begin
    ends = [np.log10([getattr(quantities[name], side) for name in search.gains.names]) for side in ("lower", "upper")]
    for _ in range(effort.rounds):
        at = best.logarithms
        within = list(zip(np.maximum(ends[0], at - FURTHEST), np.minimum(ends[1], at + FURTHEST), strict=True))
        _improve(search, at, within, effort.steps)
        end = _end(search, search.best)
        worth = end.merit <= (1 - WORTH_A_ROUND) * best.merit
        best = min(best, end, key=lambda end: end.merit)
        if not worth:
            break
    return best


def _improve(search: Tuner, begin: np.ndarray, within: list[tuple[float, float]], steps: int) -> None:
    scipy.optimize.minimize(
        lambda at: search.judged(at).cost, begin, bounds=within, method="SLSQP", jac=lambda at: search.slopes(at)[0],
        constraints={
            "type": "ineq", "fun": lambda at: search.judged(at).room, "jac": lambda at: search.slopes(at)[1],
        },
        options={"maxiter": steps, "ftol": SETTLED},
    )  # fmt: skip
