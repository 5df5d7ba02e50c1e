"""The point that a case is given with, as an end of the search: an answer is never worse than it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from matching.frequency.programme.problem import Problem
from matching.frequency.programme.scaling import scaled
from matching.frequency.solver.ends import End, stable_ends
from matching.frequency.solver.nearest_roots import with_nearest_roots
from matching.frequency.solver.starts import start
from matching.frequency.solver.task import Solution, TuningTask


def given_end(problem: Problem) -> End | None:
    """The case's own values, eigenpairs solved for; None where they miss a constraint or are unstable."""
    size = len(problem.moves)
    v = start(problem, None)
    v[:size] = [scaled(move.start, move) for move in problem.moves]
    v = with_nearest_roots(problem, v)
    lower, upper = problem.lower.copy(), problem.upper.copy()
    lower[:size] = upper[:size] = v[:size]
    return next(stable_ends(replace(problem, lower=lower, upper=upper), [v]), None)


def from_given(problem: Problem, point: End) -> End | None:
    """The local search from the case's own values."""
    return next(stable_ends(problem, [point.v]), None)


def never_worse(task: TuningTask, solution: Solution, point: End | None) -> Solution:
    """The solution, or the given point where that keeps the margin and is better, or the solution does not keep it."""
    if point is None or point.margin < task.case.limits["modulus_margin"]:
        return solution
    if solution.holds and solution.objective <= point.objective:
        return solution
    values = {name: move.start for move in task.moves for name in move.together}
    pairs = tuple(np.asarray(point.v)[len(task.moves) :].tolist())
    return Solution(values, point.objective, solution.starts, True, True, (), pairs)
