"""Searches from about the best end: what several starts agree on may still be a poor optimum.

Starts drawn over the whole range share what is typical of it, so that they may all end in one poor basin; an end that
is left from steps of its own size in every direction, without a better one being reached, is not of that kind
(iterated local search: Lourenço, Martin and Stützle, in Handbook of Metaheuristics, 2003).
"""

from __future__ import annotations

import numpy as np

from matching.frequency.programme.problem import Problem
from matching.frequency.solver.continuation import follows_targets
from matching.frequency.solver.ends import End, stable_ends
from matching.frequency.solver.task import AGREEMENT, TuningTask

STEPS = (0.2, 0.4, 0.3, 0.5, 0.25, 0.6)  # standard deviations, of each quantity's range; tried in turn
MOST_SEARCHES = 12  # about one end after another, as far as they get better


def improved(task: TuningTask, problem: Problem, best: End, seed: int) -> End:
    """The best end that searches from about it reach; itself where none in a row of :data:`STEPS` gets better."""
    random, size, failed = np.random.default_rng([seed, len(problem.moves)]), len(problem.moves), 0
    for number in range(MOST_SEARCHES):
        begin = best.v.copy()
        begin[:size] += STEPS[number % len(STEPS)] * random.normal(size=size)
        begin[:size] = np.clip(begin[:size], 0.01, 0.99)
        end = next(stable_ends(problem, [begin]), None)
        better = end is not None and end.objective < best.objective - AGREEMENT * abs(best.objective)
        if better and end is not None and follows_targets(task, end):
            best, failed = end, 0
            continue
        failed += 1
        if failed == len(STEPS):
            break
    return best
