"""The Jacobian of the residuals by finite differences, many variables in one batch of simulations."""

from __future__ import annotations

import numpy as np

from matching.diagnosis.fitting.problem import FitProblem

PARAMETER_STEP = 1e-3  # of the value, or of the width of its range where that is less
ZERO_STEP = 1e-6  # SI, of a parameter that is 0 and has no width
ANGLE_STEP, STATE_STEP = 1e-6, 1e-4  # rad; rad/s or the SI unit of an effect's state
BATCH = 8  # simulations that are held at once
DIVERGED = 1e100  # of a derivative, in times the noise: no parameter's influence but a simulation that diverged


def jacobian(
    problem: FitProblem,
    v: np.ndarray,
    residual: np.ndarray,
    columns: np.ndarray | None = None,
    largest_central: np.ndarray | None = None,
) -> np.ndarray:
    """Derivatives (r, c) of the residuals by the variables.

    Parameters
    ----------
    v : ndarray (v,)
    residual : ndarray (r,)
        At ``v``.
    columns : ndarray (c,), optional
        Indices of the variables; all if not given.
    largest_central : ndarray (v,), optional
        Take central differences with steps of at most these; forward differences if not given.
    """
    columns = np.arange(problem.size) if columns is None else columns
    central = largest_central is not None
    steps = _steps(problem, v)
    if largest_central is not None:
        steps = np.minimum(steps, largest_central)
    steps = np.where(v + steps > problem.upper, -steps, steps)
    out = np.zeros((len(residual), len(columns)), order="F")
    ends = np.cumsum([0, *(segment.readings.size for segment in problem.data.segments)])
    groups = _moved_together(problem, columns)
    for first in range(0, len(groups), BATCH):
        members = groups[first : first + BATCH]
        batch = np.repeat(v[None], len(members), axis=0)
        for row, group in zip(batch, members, strict=True):
            row[columns[group]] += steps[columns[group]]
        forward = problem.residuals(batch)
        mirrored = np.clip(2 * v - batch, problem.lower, problem.upper)
        backward = problem.residuals(mirrored) if central else [residual] * len(members)
        for moved, back, group in zip(forward, backward, members, strict=True):
            for c in group:
                j = columns[c]
                low = np.clip(v[j] - steps[j], problem.lower[j], problem.upper[j]) if central else v[j]
                segment = _segment_of(problem, j)
                rows = slice(None) if segment is None else slice(ends[segment], ends[segment + 1])
                np.subtract(moved[rows], back[rows], out=out[rows, c])
                out[rows, c] /= v[j] + steps[j] - low if central else steps[j]
                _remove_diverged(out[rows, c])
    return out


def _steps(problem: FitProblem, v: np.ndarray) -> np.ndarray:
    """(v,) steps of the differences, before any limit."""
    k = len(problem.free)
    width = problem.upper[:k] - problem.lower[:k]
    magnitudes = np.abs([problem.model.p0[problem.model.parameters.index(name)] for name in problem.free])
    at_zero = PARAMETER_STEP * np.minimum(width, np.where(magnitudes > 0, magnitudes, 1.0))
    at_zero[at_zero == 0] = ZERO_STEP
    parameters = np.where(v[:k] != 0, PARAMETER_STEP * np.minimum(np.abs(v[:k]), width), at_zero)
    states = [ANGLE_STEP if i < problem.model.n else STATE_STEP for i in problem.free_states]
    return np.concatenate([parameters, np.tile(states, len(problem.data.segments))])


def _segment_of(problem: FitProblem, j: int) -> int | None:
    """The segment whose start state a variable is; None of a parameter."""
    k = len(problem.free)
    return None if j < k else (j - k) // len(problem.free_states)


def _moved_together(problem: FitProblem, columns: np.ndarray) -> list[list[int]]:
    """Positions in ``columns`` that one simulation serves: a start state moves its own segment only, so the same state
    of all segments is moved at once."""
    k = len(problem.free)
    groups: dict[int, list[int]] = {}
    for position, j in enumerate(columns):
        key = int(j) if j < k else k + (int(j) - k) % len(problem.free_states)
        groups.setdefault(key, []).append(position)
    return list(groups.values())


def _remove_diverged(column: np.ndarray) -> None:
    """Set to 0, in place, what a diverged simulation left in a column whose square is not finite."""
    with np.errstate(over="ignore", invalid="ignore"):
        square = float(column @ column)
    if not np.isfinite(square):
        column[~(np.abs(column) < DIVERGED)] = 0.0
