"""Fits over short windows, each with its own start state: multiple shooting without matching conditions.

Over a short horizon χ² is nearly convex in the parameters, where over a long one phases slip past each other and
rattling forgets where it began (multiple shooting: Bock and Plitt 1984).
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from matching.diagnosis.candidates.carry_over import start_states
from matching.diagnosis.candidates.cause import ExtendedModel
from matching.diagnosis.candidates.refit import extended_problem
from matching.diagnosis.fitting.fit import Fit, FitOptions, chi_square, solve

SHORTEST_WINDOW = 0.5  # s
MOST_WINDOWS = 24
ITERATIONS, AGAIN_ITERATIONS = 30, 15
ROUNDS = 3  # in which windows may begin where the one before ends
GOOD = 1.2  # mean square of the residual in times the noise, which needs no further round
PROGRESS = 0.98  # of χ², for a round to count


def fit_short_windows(model: ExtendedModel, parent: Fit, motion: np.ndarray) -> Fit:
    """Fit an extended model over short windows.

    Parameters
    ----------
    motion : ndarray (t, x)
        States of the parent's model as measured, segments one after another: windows begin there.

    Raises
    ------
    FloatingPointError
        If it does not simulate from there.
    """
    windows = _cut(parent, motion)
    problem, p = extended_problem(model, windows)
    problem.held_states = start_states(problem, windows, p)
    fit = solve(problem, problem.pack(model.values, problem.held_states), None, FitOptions(ITERATIONS))
    for _ in range(ROUNDS):
        if fit.cost < GOOD * problem.data.readings_count:
            break
        again = solve(problem, _joined(fit), None, FitOptions(AGAIN_ITERATIONS))
        if again.cost > PROGRESS * fit.cost:
            break
        fit = again
    return fit


def _cut(parent: Fit, motion: np.ndarray) -> Fit:
    """The parent fit over windows that begin in a motion (t, x); residual and Jacobian are those of the segments."""
    data = parent.problem.data
    total = sum(float(np.ptp(segment.time)) for segment in data.segments)
    length = max(SHORTEST_WINDOW, total / MOST_WINDOWS)
    windows, starts, begin = [], [], 0
    for segment in data.segments:
        count = max(1, round(float(np.ptp(segment.time)) / length))
        edges = np.linspace(0, len(segment.time), count + 1).astype(int)
        for first, last in pairwise(edges):
            windows.append(segment.part(int(first), int(last) + 1))  # the last sample is also the next window's first
            starts.append(motion[begin + first])
        begin += len(segment.time)
    problem = replace(parent.problem, data=replace(data, segments=tuple(windows)), held_states=starts)
    return replace(parent, problem=problem, v=problem.pack(parent.values, starts))


def _joined(fit: Fit) -> np.ndarray:
    """Variables of a fit over windows, each beginning where the one before ends if it fits better from there."""
    problem, starts = fit.problem, fit.starts
    ends = [states[-1] for states in problem.states(fit.v)]
    v = problem.pack(fit.values, [starts[0], *ends[:-1]])
    from_ends = problem.by_sensor(problem.residuals(v[None])[0])
    joined = [
        end if chi_square(moved.ravel()) < chi_square(kept.ravel()) else start
        for start, end, moved, kept in zip(starts, problem.unpack(v)[1], from_ends, fit.by_sensor(), strict=True)
    ]
    return problem.pack(fit.values, joined)
