"""Starts by continuation in dead time: begun at a shorter dead time and led to the case's own in steps.

Where starts do not agree, as with feedback alone across a long dead time, good optima are reached that way that no
start at the full dead time reaches.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from matching.frequency.programme.problem import Problem, eigenpairs
from matching.frequency.solver.ends import End, stable_ends
from matching.frequency.solver.starts import gentler, numbered_start
from matching.frequency.solver.task import TuningTask

RUNAWAY_FREQUENCY = 2.0  # times the frequency of a target mode
DEAD_TIME_STEPS = (
    np.geomspace(0.25, 1, 14),
    np.linspace(0.4, 1, 9),
)  # in parts of the dead time; the second where one fails
STEPS_LOST = 2  # steps in a row that end infeasible or unstable: it is not led this way any further


def continued_starts(task: TuningTask, seed: int, numbers: Sequence[int]) -> Iterator[End | None]:
    """Starts at a shorter dead time, led to the case's own; None if no way leads there."""
    loop = task.case.loop

    @cache  # every start passes there
    def at(part: float, tight: bool) -> Problem:
        shorter = replace(task.case, loop=loop.with_values({"dead_time": part * loop["dead_time"]}))
        return replace(task, case=shorter).build(tight=tight)

    for number in numbers:
        yield next((end for way in DEAD_TIME_STEPS if (end := _along(task, way, at, seed, number))), None)


def _along(
    task: TuningTask, way: np.ndarray, at: Callable[[float, bool], Problem], seed: int, number: int
) -> End | None:
    """One start on one way; None if the last step or two in a row end nowhere."""
    v, end, failed = None, None, 0
    for part in way:
        problem = at(part, v is not None)
        if v is None:
            problem = problem.oscillating()
            v = numbered_start(problem, seed, number)
        end = next((end for end in stable_ends(problem, [v, *gentler(problem, v)]) if follows_targets(task, end)), None)
        v, failed = (v, failed + 1) if end is None else (end.v, 0)
        if failed == STEPS_LOST:
            return None
    return end


def follows_targets(task: TuningTask, end: End) -> bool:
    """Whether the eigenvalues tracked are not roots far above the modes they were to follow."""
    pairs = eigenpairs(end.v, len(task.moves), task.case)
    return bool((np.hypot(pairs[:, 0], pairs[:, 1]) < RUNAWAY_FREQUENCY).all())
