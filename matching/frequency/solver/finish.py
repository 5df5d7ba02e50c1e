"""The best ends solved again to more digits, with the margin held between the grid as well."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from matching.frequency.programme.margin_grid import SLOTS
from matching.frequency.programme.problem import Problem
from matching.frequency.solver.ends import End, stable_ends
from matching.frequency.solver.starts import gentler
from matching.frequency.solver.task import AGREEMENT, Solution, TuningTask

ENDS_FINISHED = 3  # ends that are tried for one that holds the margin between the grid as well
MARGIN_ROUNDS = 8  # of putting frequencies where the margin is missed between the grid
FREQUENCIES_AROUND = (
    0.015  # about such a frequency more are held, as it moves when it is held; a third of it the next time
)
SMALL_STEP = 0.02  # of each quantity's range, which no quantity leaves where the whole range leads to no stable loop


def first_that_holds(task: TuningTask, ends: list[End], starts: tuple[float | None, ...]) -> Solution:
    """The best end that can be made to hold the margin between the grid as well; the best of all if none can.

    Keeping the margin may raise the objective of an end above that of the next one: ends below it are tried as well.
    """
    candidates: list[Solution] = []
    last, least = -np.inf, np.inf
    for end in sorted(ends, key=lambda end: end.objective):
        if end.objective <= last + AGREEMENT * abs(last):  # the one before again
            continue
        last = end.objective
        if last >= least - AGREEMENT * abs(least) or len(candidates) == ENDS_FINISHED:
            break
        candidates.append(finish(task, end, starts))
        least = min((candidate.objective for candidate in candidates if candidate.holds), default=np.inf)
    holding = [candidate for candidate in candidates if candidate.holds]
    return min(holding, key=lambda candidate: candidate.objective) if holding else candidates[0]


def finish(task: TuningTask, best: End, starts: tuple[float | None, ...], added: tuple[float, ...] = ()) -> Solution:
    """Solve again to more digits, and ask for the margin where it is missed between the grid, until it holds.

    ``added`` are frequencies, Hz, at which it is asked for from the beginning.

    What IPOPT then does not call a minimum is solved once more with the exact Hessian.
    """
    problem, extra = task.build(tight=True, slots=SLOTS), np.array(added)
    least = task.case.limits["modulus_margin"]
    for number in range(MARGIN_ROUNDS):
        if best.margin < least:
            missed = np.append(problem.missed(best.v), best.margin_frequency)
            apart = FREQUENCIES_AROUND / 3**number
            extra = np.concatenate([extra, *(missed * part for part in (1 - apart, 1 + apart, 1.0))])
        end = next(_ends_from(problem, best.v, extra), None)
        if end is None:
            break
        best = end
        if best.margin >= least:
            break
    if not best.converged:
        exact = task.build(tight=True, exact=True, slots=SLOTS)
        end = next(stable_ends(exact, [best.v], extra), None)
        if end and end.objective < best.objective and end.margin >= least:
            best = end
    holds, pairs = best.margin >= least, best.v[len(problem.moves) :]
    values = problem.values(best.v)
    return Solution(values, best.objective, starts, True, holds, tuple(extra.tolist()), tuple(pairs.tolist()))


def _ends_from(problem: Problem, v: np.ndarray, extra: np.ndarray) -> Iterator[End]:
    """Stable ends from a start (v,): over the whole ranges, by a small step, and from gentler loops.

    Where the margin is missed by far between the grid, the search leaps to a loop that is unstable, from gentler ones
    to another optimum; a small step stays.
    """
    yield from stable_ends(problem, [v], extra)
    lower, upper, size = problem.lower.copy(), problem.upper.copy(), len(problem.moves)
    lower[:size] = np.maximum(lower[:size], v[:size] - SMALL_STEP)
    upper[:size] = np.minimum(upper[:size], v[:size] + SMALL_STEP)
    yield from stable_ends(replace(problem, lower=lower, upper=upper), [v], extra)
    yield from stable_ends(problem, gentler(problem, v), extra)
