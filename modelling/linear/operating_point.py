"""Steady motion at a speed and torque, found from the equations, and the model made linear about it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from modelling.common.errors import InputError, unknown
from modelling.equations.compiled import Model, compiled
from modelling.linear.elements import Elements, elements, rest
from modelling.linear.linearise import Linear, linear_at
from modelling.model.system import System

_STEPS = 60
_TOLERANCE = 1e-9  # of the largest torque in the balance


@dataclass(frozen=True)
class _Problem:
    model: Model
    p: np.ndarray
    u: np.ndarray
    parts: Elements
    locked: np.ndarray  # (l, n) rows whose twist rate is zero: shafts without a damper in series
    conditions: np.ndarray  # (c, n) rows of the speeds that are given
    wanted: np.ndarray  # (c,) rad/s
    free: list[int]


def operating_point(
    system: System,
    speeds: Mapping[str, float],
    inputs: Mapping[str, float] | None = None,
    free: Sequence[str] | None = None,
    values: Mapping[str, float] | None = None,
) -> Linear:
    """Steady motion: no acceleration, no twist that changes, internal states at rest; slip runs at constant slip speed.

    A vehicle at 50 km/h is ``operating_point(vehicle, {"body": 13.9 / tyre_radius}, free=["motor_torque"])``.

    Parameters
    ----------
    speeds : mapping
        Speed of one or more inertias by name, rad/s.
    inputs : mapping, optional
        Torques that are given, N·m; others that are not free are 0.
    free : sequence of str, optional
        Inputs whose torque is to be found; default all that are not given. Where more are free than the balance
        needs, the smallest set of torques is taken.
    values : mapping, optional
        Parameters that differ from the system's, by name, SI.

    Returns
    -------
    Linear
        With state ``x0`` and torques ``u0``. Torque ripple is averaged out over a turn (its amplitude in ``p`` is 0).

    Raises
    ------
    InputError
        If a name is unknown or there is no such steady motion.
    """
    model = compiled(system)
    given = dict(inputs or {})
    free = [name for name in model.inputs if name not in given] if free is None else list(free)
    for name in (*given, *free):
        if name not in model.inputs:
            raise unknown(name, model.inputs, "inputs")
    problem = _problem(model, speeds, given, free, values)
    ends = []
    for side in (1.0, -1.0):  # lash may lie on either flank
        x, u, error = _solve(problem, side)
        if error <= 1.0:
            return linear_at(model, problem.p, x, u)
        ends.append(error)
    raise InputError(
        "operating point",
        f"no steady motion found at these speeds (balance misses by {min(ends) * _TOLERANCE:.2g} of its torques)",
        "free another input or give another speed",
    )


def _problem(
    model: Model,
    speeds: Mapping[str, float],
    given: dict[str, float],
    free: list[str],
    values: Mapping[str, float] | None,
) -> _Problem:
    p = model.vector(values)
    for effect in model.system.effects:
        for key in effect.law.zero_mean:
            p[model.parameters.index(f"{effect.name}.{key}")] = 0.0
    parts = elements(model, p[None])
    for name in speeds:
        if f"inertias.{name}" not in parts.masses:
            raise unknown(name, [part.name for part in model.system.inertias], "speeds")
    wanted = np.array([float(value) for value in speeds.values()])
    if not speeds or not np.isfinite(wanted).all():
        raise InputError("speeds", "no finite speed is given", "give the speed of at least one inertia in rad/s")
    u = np.zeros(len(model.inputs))
    for name, torque in given.items():
        u[model.inputs.index(name)] = torque
    conditions = np.array([parts.turns[parts.masses.index(f"inertias.{name}")] for name in speeds])
    slipping = ~np.abs(parts.deflections[:, : model.n]).any(axis=1)
    return _Problem(
        model, p, u, parts, parts.twists[~slipping], conditions, wanted, [model.inputs.index(name) for name in free]
    )


def _solve(problem: _Problem, side: float) -> tuple[np.ndarray, np.ndarray, float]:
    """State, torques and error (≤ 1 if solved) after Newton steps of least norm, begun at turning together."""
    model, n = problem.model, problem.model.n
    x, u = side * np.atleast_2d(rest(model, problem.p))[0], problem.u.copy()
    together = np.vstack([problem.parts.twists, problem.conditions * 1e3])
    x[n : 2 * n] = np.linalg.lstsq(
        together, np.concatenate([np.zeros(len(problem.parts.twists)), problem.wanted * 1e3])
    )[0]
    residual, scale = _residual(problem, x, u)
    for _ in range(_STEPS):
        error = _error(residual, scale)
        if not error > 1e-3:
            break
        step = _least_norm(_jacobian(problem, x, u), -residual)
        if not np.isfinite(step).all():
            break
        for length in 0.5 ** np.arange(12):
            new_x, new_u = x + length * step[: len(x)], u.copy()
            new_u[problem.free] += length * step[len(x) :]
            new, new_scale = _residual(problem, new_x, new_u)
            if np.isfinite(new).all() and np.linalg.norm(new) < np.linalg.norm(residual):
                x, u, residual, scale = new_x, new_u, new, new_scale
                break
        else:
            break
    error = _error(residual, scale)
    return x, u, error if np.isfinite(error) else np.inf


def _residual(problem: _Problem, x: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Torque balance (n,), rates of internal states, twist rates, speeds; and the size each is measured against."""
    model, n = problem.model, problem.model.n
    torque = model.force(x, u, problem.p).full().ravel()
    internal = model.rates(x, u, problem.p).full().ravel()[2 * n :]
    speed = x[n : 2 * n]
    residual = np.concatenate([torque, internal, problem.locked @ speed, problem.conditions @ speed - problem.wanted])
    deflection = problem.parts.deflections @ x
    torques = max(1.0, np.abs(u).max(initial=0.0), np.abs(problem.parts.stiffness[0] * deflection).max(initial=0.0))
    turning = max(1.0, np.abs(problem.wanted).max())
    return residual, np.concatenate([np.full(n, torques), np.full(len(residual) - n, turning)])


def _jacobian(problem: _Problem, x: np.ndarray, u: np.ndarray) -> np.ndarray:
    model, n = problem.model, problem.model.n
    A, B = (part.full() for part in model.jacobians(x, u, problem.p, 0.0)[:2])
    mass = model.mass(problem.p).full()
    extra = np.zeros((len(problem.locked) + len(problem.conditions), A.shape[1] + len(problem.free)))
    extra[:, n : 2 * n] = np.vstack([problem.locked, problem.conditions])
    both = np.hstack([A, B[:, problem.free]])
    return np.vstack([mass @ both[n : 2 * n], both[2 * n :], extra])


def _least_norm(jacobian: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Least-squares solution of least norm, rows and columns brought to size one first."""
    rows = np.maximum(np.linalg.norm(jacobian, axis=1), 1e-12)
    scaled = jacobian / rows[:, None]
    columns = np.linalg.norm(scaled, axis=0)
    columns = np.where(columns > 0, columns, 1.0)
    return np.linalg.lstsq(scaled / columns, right / rows, rcond=1e-12)[0] / columns


def _error(residual: np.ndarray, scale: np.ndarray) -> float:
    return float(np.max(np.abs(residual) / (_TOLERANCE * scale)))
