"""Of answers that are as good, the one that changes least.

The error alone decides what is best. Of answers as good, the one nearest to what was planned is taken (ε-constraint
programming: Haimes, Lasdon and Wismer, IEEE Trans. Syst. Man Cybern. 1 (1971) 296). So no weight trades error for
change, and a second search, from the answer of a first, comes to the same values.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from matching.frequency.programme.margin_grid import SLOTS
from matching.frequency.programme.problem import Problem
from matching.frequency.programme.scaling import scaled
from matching.frequency.solver.ends import End, check, run_from
from matching.frequency.solver.finish import finish
from matching.frequency.solver.task import Solution, TuningTask

AS_GOOD = 0.02  # relative, in the response error: within it nothing is ordered that can stay as planned
SAME_ERROR = 0.002  # relative, in the response error: within it settings that cost nothing stay where they were
NEGLIGIBLE_ERROR = 1e-3  # response error below which no answer is better than another
REACHED = 1e-4  # relative, of the largest objective: what IPOPT's tolerance on a constraint leaves


def as_good_as(objective: float, within: float) -> float:
    """Largest objective whose response error, its root, is as good as that of the best within a relative tolerance."""
    return float((1 + within) ** 2 * objective + NEGLIGIBLE_ERROR**2)


def least_change(task: TuningTask, best: Solution, limit: float) -> Solution:
    """The solution of least weighted change from what was planned among those with an objective up to a limit."""
    if not best.feasible or not best.holds or not task.moves:
        return best
    nearest = replace(task, error_limit=limit)
    problem, v = nearest.build(slots=SLOTS), vector_of(task, best)
    begin = _end_at(problem, v, best.added)
    end = run_from(problem, v, np.array(best.added))
    if end is not None and end.objective < begin.objective:
        margin, frequency, stable = check(problem, end.v)
        begin = end._replace(margin=margin, margin_frequency=frequency) if stable else begin
    solution = finish(nearest, begin, best.starts, best.added)
    error = float(task.build(slots=SLOTS).objective(vector_of(task, solution), problem.extra())[0])
    if not solution.holds or error > limit * (1 + REACHED):
        return best
    return replace(solution, objective=error, as_good_to=best.as_good_to, blind=best.blind)


def vector_of(task: TuningTask, solution: Solution) -> np.ndarray:
    """Decisions (v,) of a solution."""
    return np.array([*(scaled(solution.values[move.name], move) for move in task.moves), *solution.pairs])


def _end_at(problem: Problem, v: np.ndarray, added: tuple[float, ...]) -> End:
    """The decisions (v,) themselves as an end."""
    change = float(problem.objective(v, problem.extra(added))[0])
    margin, frequency, _ = check(problem, v)
    return End(change, v, False, margin, frequency)
