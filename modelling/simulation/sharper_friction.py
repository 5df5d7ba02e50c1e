"""Dry friction sharp enough: what its regularisation changes is part of the error that a simulation controls."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from modelling.equations.assembly import STICK_SPEED
from modelling.simulation.result import SimulationError
from modelling.simulation.step_control import Controlled, InitialValueProblem, run_to_tolerance
from modelling.simulation.stepping import difference

SHARPER = 5.0  # times sharper from run to run; what still changes then is this less one times the error that is left
MOST_RUNS = 5
STEPS_SHARE = 0.1  # of the tolerance, for the steps: a transition that a whole step skips hides in their error estimate


def sharp_enough(
    problem: InitialValueProblem,
    blunt: Controlled,
    tolerance: float,
    compiled: bool | None,
    most_runs: int,
) -> tuple[Controlled, float]:
    """The run with a stick speed so small that it changes no reading by more than the tolerance, and that speed, rad/s.

    The error of the regularised law is proportional to its stick speed, so it is read off two runs. Where a sharper
    law comes no nearer (a torque that jumps between two samples; a motion that depends on it without end), the last run
    that did is taken, and its error says so.

    Parameters
    ----------
    problem : InitialValueProblem
        Of one parameter set.
    blunt : Controlled
        Its run.
    tolerance : float
        Share of each reading's range.
    most_runs : int
        0: the law stays as it is. Without dry friction it does anyway, and there is no stick speed (NaN).
    """
    if STICK_SPEED not in problem.model.parameters:
        return blunt, float("nan")
    at = problem.model.parameters.index(STICK_SPEED)
    best, before = blunt, np.inf
    for _ in range(most_runs):
        p = problem.p.copy()
        p[0, at] /= SHARPER
        try:
            sharper = run_to_tolerance(replace(problem, p=p), STEPS_SHARE * tolerance, compiled)
        except SimulationError:
            break
        change = difference(best.trajectories, sharper.trajectories, rough=True)
        if change.max(initial=0.0) >= before:
            break
        before = float(change.max(initial=0.0))
        left = change / (SHARPER - 1)
        best, problem = replace(sharper, error=np.maximum(sharper.error, left)), replace(problem, p=p)
        if left.max(initial=0.0) <= tolerance:
            break
    return best, float(problem.p[0, at])
