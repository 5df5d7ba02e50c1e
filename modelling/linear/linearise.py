"""A model linearised about a state, at rest or in steady motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from modelling.equations.casadi_code import Model, compiled
from modelling.errors import InputError, unknown
from modelling.linear.elements import Elements, check_size, null_space, unit_rows
from modelling.linear.steady_motion import BALANCE_TOLERANCE, reference_motion, steady_motion, without_ripple
from modelling.system import System

# --- Linearise


@dataclass(frozen=True)
class Linear:
    """Δẋ = A·Δx + B·Δu, Δy = C·Δx + D·Δu about (x0, u0), with exact delays of inputs and sensors.

    Attributes
    ----------
    A, B, C, D : ndarray (x, x), (x, u), (y, x), (y, u)
        SI; x = [q (n), q̇ (n), z].
    x0, u0, p : ndarray (x,), (u,), (p,)
    input_delays, sensor_delays : ndarray (u,), (y,)
        s.
    model : Model
        The compiled model; it names states, inputs, sensors and parameters.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    x0: np.ndarray
    u0: np.ndarray
    p: np.ndarray
    input_delays: np.ndarray
    sensor_delays: np.ndarray
    model: Model


def linearise(
    system: System | Model,
    values: Mapping[str, float] | None = None,
    state: np.ndarray | None = None,
    inputs: np.ndarray | None = None,
) -> Linear:
    """Linearise a system about a state; by default its operating point, or at rest with every lash just closed.

    Parameters
    ----------
    values : mapping, optional
        Parameters that differ from the system's, by name, SI.
    state, inputs : ndarray (x,), (u,), optional

    Raises
    ------
    InputError
        If a name is unknown, a vector has the wrong length, the operating point is no steady motion, a derivative is
        not finite there, or the system is in no gear.
    """
    model = system if isinstance(system, Model) else compiled(system)
    for box in model.system.gearboxes:
        if box.capacities:
            raise InputError(f"gearboxes.{box.name}", "a linear model holds one gear", "take System.in_gear(1)")
    p = model.vector(values)
    if model.system.operating_point is not None:
        p = without_ripple(model, p)
    about = reference_motion(model, p) if state is None else None
    x = about.state if about is not None else np.asarray(state, float)
    u = (about.inputs if about is not None else np.zeros(len(model.inputs))) if inputs is None else np.asarray(inputs)
    for what, vector, names in (("state", x, model.states), ("inputs", u, model.inputs)):
        if vector.shape != (len(names),):
            raise InputError(what, f"shape {vector.shape} does not fit {len(names)} names", f"give ({len(names)},)")
    return linear_at(model, p, x, u)


def linear_at(model: Model, p: np.ndarray, x: np.ndarray, u: np.ndarray) -> Linear:
    """:func:`linearise` for vectors of a compiled model: p (p,), x (x,), u (u,).

    Raises
    ------
    InputError
        If an element of A, B, C or D is not finite.
    """
    A, B, C, D, of_inputs, of_sensors = (part[0] for part in linear_sets(model, p[None], x[None], u[None]))
    return Linear(A, B, C, D, x, u, p, of_inputs, of_sensors, model)


def linear_sets(model: Model, p: np.ndarray, x: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, ...]:
    """A (b, x, x), B (b, x, u), C (b, y, x), D (b, y, u), and delays of inputs (b, u) and sensors (b, y), s.

    At parameter sets p (b, p), about states x (b, x) and inputs u (b, u).

    Raises
    ------
    InputError
        If an element of A, B, C or D is not finite.
    """
    check_size(model)
    count = len(p)
    columns = x.T, u.T, p.T
    found = [_side_by_side(part, count) for part in model.jacobians.map(count)(*columns, np.zeros((1, count)))]
    for name, part in zip("ABCD", found, strict=True):
        if not np.isfinite(part).all():
            _, row, _ = np.argwhere(~np.isfinite(part))[0]
            of = f"the derivative of {model.states[row]}" if name in "AB" else f"what {model.sensors[row]} reads"
            right = "check the quantities it depends on for values that are far too large or too small"
            raise InputError(model.system.title or "the model", f"{of} is not finite about this state", right)
    delays = [delay.full().T for delay in model.delays.map(count)(p.T)]
    return *found, *delays


def _side_by_side(stacked: ca.DM, count: int) -> np.ndarray:
    """Matrices (b, i, j) that a mapped function puts one after another, (i, b·j)."""
    whole = stacked.full()
    rows = len(whole)
    return np.ascontiguousarray(whole.reshape(rows, count, whole.shape[1] // count).swapaxes(0, 1))


@dataclass(frozen=True)
class Deflated:
    """A linear model without the angles that nothing depends on.

    Attributes
    ----------
    A : ndarray (l, l) or (b, l, l)
        Of the states that remain.
    lift : ndarray (x, l)
        Takes those to all states, free angles 0; its columns are orthonormal, so liftᵀ takes B along.
    free_angles : ndarray (n, r)
        Orthonormal basis of the angles that are left out.
    """

    A: np.ndarray
    lift: np.ndarray
    free_angles: np.ndarray


def deflated(linear: Linear, parts: Elements) -> Deflated:
    """Leave out the angles that nothing depends on.

    With them, a rigid motion is a double eigenvalue 0 with one eigenvector, which rounding spreads to ±1e-8·|λ|max, and
    small twists are lost beside large speeds near 0 Hz. So angles and speeds are written in a basis of those free
    angles and their orthogonal complement, and the free angles are left out.

    Parameters
    ----------
    parts : Elements
        Of the same model at one parameter set and state.
    """
    one = deflated_states(linear.A, parts.deflection_jacobian, linear.model.n)
    assert one is not None, "one matrix has one set of free angles"
    return one


def deflated_states(A: np.ndarray, deflections: np.ndarray, n: int) -> Deflated | None:
    """:func:`deflated` of state matrices A (x, x) or (b, x, x) with n angles.

    None if something else than springs holds a free angle to ground in some of the matrices and not in others.

    Parameters
    ----------
    deflections : ndarray (s, x)
        Deflection of every spring for unit states, the same of all.
    """
    free, basis = _bases(deflections[:, :n].tobytes(), n)
    of_angles = A[..., :n]
    held = np.linalg.norm(of_angles @ free, axis=(-2, -1)) > 1e-9 * np.linalg.norm(of_angles, axis=(-2, -1))
    if np.any(held):
        if not np.all(held):
            return None
        free, basis = np.zeros((n, 0)), np.eye(n)  # something else holds an angle to ground
    r = free.shape[1]
    x = A.shape[-1]
    lift = np.zeros((x, x - r))
    lift[:n, : n - r] = basis
    lift[n : 2 * n, n - r : n], lift[n : 2 * n, n : 2 * n - r] = free, basis
    lift[2 * n :, 2 * n - r :] = np.eye(x - 2 * n)
    inner = lift.T @ A @ lift
    inner[..., : n - r, :] = 0.0
    inner[..., : n - r, n : 2 * n - r] = np.eye(n - r)  # the rate of a twist is a difference of speeds, exactly
    speeds = inner[..., n - r : n]  # of the free angles: only drag slows them, what is smaller is rounding
    speeds[np.abs(speeds) < 1e-13 * np.linalg.norm(inner, axis=-1)[..., None]] = 0.0
    return Deflated(inner, lift, free)


@lru_cache(maxsize=64)  # the same for all values of a model whose ratios stay
def _bases(twists: bytes, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Orthonormal bases of free angles (n, r) and of all others (n, n − r), by the twists (s, n) of unit angles."""
    held = np.frombuffer(twists).reshape(-1, n)
    held = held[np.abs(held).any(axis=1)]
    free = null_space(unit_rows(held)) if len(held) else np.eye(n)
    return free, null_space(free.T) if free.size else np.eye(n)


# --- Steady motion at a speed and torque, and the model linearised about it.


def operating_point(
    system: System,
    speeds: Mapping[str, float],
    inputs: Mapping[str, float] | None = None,
    free: Sequence[str] | None = None,
    values: Mapping[str, float] | None = None,
) -> Linear:
    """Linearise about steady motion: no acceleration, constant twists, internal states at rest, constant slip speed.

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
        With state ``x0`` and torques ``u0``. Torque ripple is averaged over a turn (its amplitude in ``p`` is 0).

    Raises
    ------
    InputError
        If a name is unknown or there is no such steady motion.
    """
    model = compiled(system)
    known = dict(inputs or {})
    free = [name for name in model.inputs if name not in known] if free is None else list(free)
    for name in (*known, *free):
        if name not in model.inputs:
            raise unknown(name, model.inputs, "inputs")
    if not speeds or not np.isfinite([float(value) for value in speeds.values()]).all():
        raise InputError("speeds", "no finite speed is given", "give the speed of at least one inertia in rad/s")
    u = np.array([float(known.get(name, 0.0)) for name in model.inputs])
    p = without_ripple(model, model.vector(values))
    motion = steady_motion(model, p, u, speeds, [model.inputs.index(name) for name in free])
    if motion.error > 1.0:
        raise InputError(
            "operating point",
            f"no steady motion found at these speeds (balance misses by {motion.error * BALANCE_TOLERANCE:.2g} "
            "of its torques)",
            "free another input or give another speed",
        )
    return linear_at(model, p, motion.state, motion.inputs)
