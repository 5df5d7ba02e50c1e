"""What the fit of an extended model takes over from its parent fit: start states and columns of the Jacobian."""

from __future__ import annotations

import numpy as np

from matching.diagnosis.fitting.finite_differences import jacobian
from matching.diagnosis.fitting.fit import Fit
from matching.diagnosis.fitting.problem import FitProblem
from modelling.equations.compiled import Model

NEWTON_STEPS = 2  # towards start states of new effects; their equations are nearly linear


def common_states(states: list[str], parent: Fit) -> tuple[list[int], list[int]]:
    """Indices of the states that the parent's model has too: in ``states``, and in the parent's own."""
    pairs = [(states.index(name), i) for i, name in enumerate(parent.problem.model.states) if name in states]
    return [there for there, _ in pairs], [here for _, here in pairs]


def states_from(parent_states: list[np.ndarray], states: list[str], parent: Fit) -> list[np.ndarray]:
    """States (x,) of another model with the values that the parent's states have; 0 for what is new."""
    there, here = common_states(states, parent)
    out = []
    for known in parent_states:
        x = np.zeros(len(states))
        x[there] = known[here]
        out.append(x)
    return out


def start_states(problem: FitProblem, parent: Fit, p: np.ndarray) -> list[np.ndarray]:
    """Start states (x,) of the segments: the parent's; new states begin so that accelerations and readings stay.

    Parameters
    ----------
    p : ndarray (p,)
        Parameters of the problem's model.
    """
    model = problem.model
    p_parent, parent_starts = parent.problem.unpack(parent.v)
    starts = states_from(parent_starts, model.states, parent)
    there, _ = common_states(model.states, parent)
    new = [i for i in range(len(model.states)) if i not in there]
    if new:
        for segment, known, x in zip(problem.data.segments, parent_starts, starts, strict=True):
            _begin_as(x, new, segment.inputs[0], (model, p), (parent.problem.model, known, p_parent))
    return starts


def _begin_as(
    x: np.ndarray,
    new: list[int],
    u: np.ndarray,
    extended: tuple[Model, np.ndarray],
    parent: tuple[Model, np.ndarray, np.ndarray],
) -> None:
    """Set the new states in x (x,), in place, so that accelerations and readings are those of the parent."""
    model, p = extended
    before, known, p_parent = parent
    shared = [model.coordinates.index(name) for name in before.coordinates if name in model.coordinates]
    rows = [model.n + i for i in shared]
    rows_before = [before.n + before.coordinates.index(model.coordinates[i]) for i in shared]
    wanted = _accelerations_and_readings(before, known, u, p_parent, rows_before)
    for _ in range(NEWTON_STEPS):
        A, _, C, _ = (np.array(m) for m in model.jacobians(x, u, p, 0.0))
        now = _accelerations_and_readings(model, x, u, p, rows)
        derivative = np.vstack([A[rows], C])[:, new]
        if not np.isfinite(derivative).all() or not np.isfinite(now).all():
            break
        weight = 1 / (np.abs(derivative).max(axis=1) + 1e-9)
        x[new] += np.linalg.lstsq(derivative * weight[:, None], (wanted - now) * weight, rcond=1e-9)[0]


def _accelerations_and_readings(
    model: Model, x: np.ndarray, u: np.ndarray, p: np.ndarray, rows: list[int]
) -> np.ndarray:
    rates = np.array(model.rates(x, u, p)).ravel()[rows]
    return np.concatenate([rates, np.array(model.readings(x, u, p, 0.0)).ravel()])


def known_jacobian(problem: FitProblem, parent: Fit, v: np.ndarray) -> np.ndarray:
    """A Jacobian (r, v) to begin with: the parent's columns where it has them, differences for what is new.

    Raises
    ------
    FloatingPointError
        If the problem does not simulate from v (v,).
    """
    names = _variables(problem)
    column = {name: i for i, name in enumerate(_variables(parent.problem))}
    out = np.empty((len(parent.residual), len(names)), order="F")
    new = np.array([i for i, name in enumerate(names) if name not in column], dtype=int)
    for i, name in enumerate(names):
        if name in column:
            out[:, i] = parent.jacobian[:, column[name]]
    if len(new):
        residual = problem.residuals(v[None])[0]
        if not np.isfinite(residual).all():
            raise FloatingPointError("the simulation diverges at the start of the fit")
        out[:, new] = jacobian(problem, v, residual, new)
    return out


def _variables(problem: FitProblem) -> list[str]:
    """Names of the variables (v,)."""
    states = [problem.model.states[i] for i in problem.free_states]
    return problem.free + [f"{segment}:{name}" for segment in range(len(problem.data.segments)) for name in states]
