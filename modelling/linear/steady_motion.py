"""Steady motion of the nonlinear model: the one solver for start states and operating points.

No coordinate accelerates (or all move with one common acceleration), no shaft's twist changes, internal states rest.
Damped Newton steps of least norm, because angles of a free drivetrain and torques beyond the balance are not unique.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from modelling.effects.torques import ENGAGED
from modelling.equations.casadi_code import Model, compiled
from modelling.errors import InputError, unknown
from modelling.linear.elements import Elements, elements, null_space, rest_state, unit_rows, with_lash_closed
from modelling.system import System

MAX_NEWTON_STEPS = 60
HIGH_SPEED = 1e3  # rad/s, above what powertrains reach
COUPLED = (
    0.97  # of a pump's speed, from which a turbine's is sought: tables are straight from the coupling point to there
)
BALANCE_TOLERANCE = 1e-9  # of the largest torque in the balance, and of the largest speed


@dataclass(frozen=True)
class SteadyMotion:
    """State (x,) and inputs (u,), in N·m or a pedal, of a steady motion, and how exactly they balance.

    ``error`` is the largest residual in times :data:`BALANCE_TOLERANCE` of the torques and speeds that balance: the
    motion is steady if it is at most 1.
    """

    state: np.ndarray
    inputs: np.ndarray
    error: float


@dataclass(frozen=True)
class _Problem:
    """What is fixed: parameters (p,), rows of locked twists (l, n), rows (c, n) and values (c,) of wanted speeds.

    ``free`` are the inputs to solve for, pedals among them within ``ends`` (u, 2); ``common`` (n, a) the coordinate
    accelerations that are allowed.
    """

    model: Model
    p: np.ndarray
    parts: Elements
    locked: np.ndarray
    speed_rows: np.ndarray
    speeds: np.ndarray
    free: Sequence[int]
    ends: np.ndarray
    common: np.ndarray


NO_BOUND = 1e30  # of a rate, SI
PEDALS = (0.5, 0.1, 0.9)  # of its range, from which a pedal is sought


def steady_motion(
    model: Model,
    p: np.ndarray,
    u: np.ndarray,
    speeds: Mapping[str, float] | None = None,
    free: Sequence[int] = (),
    *,
    accelerating: bool = False,
) -> SteadyMotion:
    """Find a steady motion under the torques ``u``, some of which may be ``free``.

    Slip runs at constant slip speed. Torque ripple is averaged over a turn (taken as 0). Lash lies on the flank that
    balances. The best of several starts is returned, also when it does not balance: see :attr:`SteadyMotion.error`.

    Parameters
    ----------
    p, u : ndarray (p,), (u,)
        SI.
    speeds : mapping, optional
        Wanted speeds by inertia, rad/s; without, they follow from the balance of torques.
    free : sequence of int
        Inputs whose torque, or pedal within its map, is to be found. Where more are free than the balance needs, the
        least torques are taken.
    accelerating : bool
        Let the parts that no shaft holds accelerate together.

    Raises
    ------
    InputError
        If an inertia is unknown.
    """
    p = without_rate_bounds(model, without_ripple(model, p))
    parts = elements(model, p[None])
    twists, turns = (rows.reshape(-1, model.n) for rows in (parts.spring_transformation, parts.mass_transformation))
    for name in speeds or ():
        if f"inertias.{name}" not in parts.masses:
            raise unknown(name, [part.name for part in model.system.inertias], "speeds")
    in_series = ~np.abs(parts.deflection_jacobian[:, : model.n]).any(axis=1)
    locked = twists[~in_series]
    problem = _Problem(
        model,
        p,
        parts,
        locked,
        np.array([turns[parts.masses.index(f"inertias.{name}")] for name in speeds or ()]).reshape(-1, model.n),
        np.array([float(value) for value in (speeds or {}).values()]),
        list(free),
        _ends(model),
        _untwisted(locked) if accelerating else np.zeros((model.n, 0)),
    )
    # lash may lie on either flank; from a high speed Newton runs down to a balance that friction near rest would hide
    starts = [(1.0, 0.0), (-1.0, 0.0)] + ([] if speeds else [(1.0, HIGH_SPEED), (-1.0, -HIGH_SPEED)])
    shares = PEDALS if any(np.isfinite(problem.ends[i]).all() for i in problem.free) else PEDALS[:1]
    tried = []
    for share, (flank, speed) in itertools.product(shares, starts):
        tried.append(_solve(problem, flank, speed, _begun(problem, np.asarray(u, float), share)))
        if tried[-1].error <= 1.0:
            break
    return min(tried, key=lambda motion: motion.error)


def _ends(model: Model) -> np.ndarray:
    """Ends (u, 2) of every input: those of the map of a pedal, of others none."""
    ends = np.tile([-np.inf, np.inf], (len(model.inputs), 1))
    for name, own in model.system.pedals.items():
        ends[model.inputs.index(name)] = own.pedals[[0, -1]]
    return ends


def _begun(problem: _Problem, u: np.ndarray, share: float) -> np.ndarray:
    """Inputs (u,) with which a search begins: pedals that are free at a share of their range."""
    begun = u.copy()
    for i in problem.free:
        low, high = problem.ends[i]
        if np.isfinite(high):
            begun[i] = low + share * (high - low)
    return begun


def _untwisted(locked: np.ndarray) -> np.ndarray:
    """Basis (n, r) of the motions that twist none of the rows (l, n)."""
    return null_space(unit_rows(locked)) if len(locked) else np.eye(locked.shape[1])


def without_rate_bounds(model: Model, p: np.ndarray) -> np.ndarray:
    """Parameters (p,) with which no state is at the bound of its rate, as none is in a motion that stays."""
    out = p.copy()
    for effect in model.system.effects:
        if effect.law.rate_bound:
            out[model.parameters.index(f"{effect.name}.{effect.law.rate_bound}")] = NO_BOUND
    return out


def without_ripple(model: Model, p: np.ndarray) -> np.ndarray:
    """Parameters (p,) with every torque that averages to zero over a turn (torque ripple) taken as zero."""
    p = np.array(p, float)
    for effect in model.system.effects:
        for key in effect.law.zero_mean:
            if (name := f"{effect.name}.{key}") in model.parameters:  # harmonics are optional
                p[model.parameters.index(name)] = 0.0
    return p


def _solve(problem: _Problem, flank: float, speed: float, u: np.ndarray) -> SteadyMotion:
    """Newton from a motion that twists nothing, at the wanted speeds or else near ``speed``, lash on one flank."""
    model, n = problem.model, problem.model.n
    x = flank * np.atleast_2d(rest_state(model, problem.p))[0]
    untwisted = _untwisted(problem.locked)
    x[n : 2 * n] = untwisted @ untwisted.sum(axis=0) * speed
    closed = _closed(problem, u)
    teeth = [f"{clutch}{ENGAGED}" for clutch in closed if f"{clutch}{ENGAGED}" in model.states]
    x[[model.states.index(name) for name in teeth]] = 1.0
    if len(problem.speeds):
        weight = 1e3  # the wanted speeds before the untwisted motion
        held = [problem.parts.spring_transformation.reshape(-1, n), *_coupled(problem), *closed.values()]
        rows = np.vstack([*held, weight * problem.speed_rows])
        values = np.concatenate([np.zeros(len(rows) - len(problem.speeds)), weight * problem.speeds])
        x[n : 2 * n] = np.linalg.lstsq(rows, values)[0]
    acceleration = np.zeros(problem.common.shape[1])
    residual, scale = _residual(problem, x, u, acceleration)
    for _ in range(MAX_NEWTON_STEPS):
        if not _error(residual, scale) > 1e-3:
            break
        step = _least_norm(_jacobian(problem, x, u), -residual)
        if not np.isfinite(step).all():
            break
        for length in 0.5 ** np.arange(12):
            new_x, new_u = x + length * step[: len(x)], u.copy()
            new_u[problem.free] += length * step[len(x) : len(x) + len(problem.free)]
            new_u[problem.free] = np.clip(new_u[problem.free], *problem.ends[problem.free].T)
            new_acceleration = acceleration + length * step[len(x) + len(problem.free) :]
            new, new_scale = _residual(problem, new_x, new_u, new_acceleration)
            if np.isfinite(new).all() and np.linalg.norm(new / scale) < np.linalg.norm(residual / scale):
                x, u, acceleration, residual, scale = new_x, new_u, new_acceleration, new, new_scale
                break
        else:
            break
    error = _error(residual, scale)
    return SteadyMotion(x, u, error if np.isfinite(error) else np.inf)


def _closed(problem: _Problem, u: np.ndarray) -> dict[str, np.ndarray]:
    """Rows (1, n), by the state of each clutch that carries a torque, that are 0 where it does not slip."""
    masses, p, model = problem.parts.masses, problem.p, problem.model
    turns, rows = problem.parts.mass_transformation.reshape(-1, model.n), dict[str, np.ndarray]()
    for box in model.system.gearboxes:
        first, second = (turns[masses.index(f"inertias.{name}")] for name in box.between)
        for gear, capacity in enumerate(box.capacities, 1):
            if u[list(model.inputs).index(capacity)] > 0:
                ratio = p[model.parameters.index(f"gearboxes.{box.name}.ratio_{gear}")]
                rows[f"gearboxes.{box.name}.{capacity}"] = (first - ratio * second)[None]
    return rows


def _coupled(problem: _Problem) -> list[np.ndarray]:
    """Rows (1, n) that are 0 where the turbine of each converter turns nearly with its pump."""
    masses, p, model = problem.parts.masses, problem.p, problem.model
    turns, rows = problem.parts.mass_transformation.reshape(-1, model.n), list[np.ndarray]()
    for box in model.system.gearboxes:
        if box.converter is not None:
            ratio = p[model.parameters.index(f"gearboxes.{box.name}.ratio_1")]
            pump, turbine = (turns[masses.index(f"inertias.{name}")] for name in box.between)
            rows.append((COUPLED * pump - ratio * turbine)[None])
    return rows


def _residual(
    problem: _Problem, x: np.ndarray, u: np.ndarray, acceleration: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Torque balance (n,), rates of internal states, twist rates, speeds; and the size each is measured against."""
    model, n = problem.model, problem.model.n
    inertial = model.mass(problem.p).full() @ (problem.common @ acceleration)
    torque = model.force(x, u, problem.p).full().ravel() - inertial
    rate = model.rates(x, u, problem.p).full().ravel()[2 * n :]
    speed = x[n : 2 * n]
    wanted = problem.speed_rows @ speed - problem.speeds
    deflection = problem.parts.deflection_jacobian @ x
    torques = max(1.0, np.abs(u).max(initial=0.0), np.abs(problem.parts.stiffness[0] * deflection).max(initial=0.0))
    speeds = max(1.0, np.abs(problem.speeds).max(initial=0.0))
    # the rate of a fast lag carries the rounding of what it follows: size of the state over its time constant
    inverse_time = np.abs(np.diag(model.jacobians(x, u, problem.p, 0.0)[0].full())[2 * n :])
    rates = np.maximum(speeds, inverse_time * np.maximum(np.abs(x[2 * n :]), 1.0))
    residual = np.concatenate([torque, rate, problem.locked @ speed, wanted])
    rest_scale = np.full(len(problem.locked) + len(wanted), speeds)
    return residual, np.concatenate([np.full(n, torques), rates, rest_scale])


def _jacobian(problem: _Problem, x: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Derivatives of the residual by state, free inputs and common acceleration."""
    model, n = problem.model, problem.model.n
    A, B = (part.full() for part in model.jacobians(x, u, problem.p, 0.0)[:2])
    mass = model.mass(problem.p).full()
    both = np.hstack([A, B[:, problem.free]])
    balance = np.hstack([np.vstack([mass @ both[n : 2 * n], both[2 * n :]]), np.zeros((len(A) - n, 0))])
    inertial = np.vstack([-mass @ problem.common, np.zeros((len(A) - 2 * n, problem.common.shape[1]))])
    motion = np.vstack([problem.locked, problem.speed_rows])
    below = np.zeros((len(motion), balance.shape[1] + inertial.shape[1]))
    below[:, n : 2 * n] = motion
    return np.vstack([np.hstack([balance, inertial]), below])


def _least_norm(jacobian: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Least-squares solution of least norm, rows and columns of size one first; NaN where an entry is not finite."""
    if not (np.isfinite(jacobian).all() and np.isfinite(right).all()):
        return np.full(jacobian.shape[1], np.nan)
    rows = np.maximum(np.linalg.norm(jacobian, axis=1), 1e-12)
    scaled = jacobian / rows[:, None]
    columns = np.linalg.norm(scaled, axis=0)
    columns = np.where(columns > 0, columns, 1.0)
    return np.linalg.lstsq(scaled / columns, right / rows, rcond=1e-12)[0] / columns


def _error(residual: np.ndarray, scale: np.ndarray) -> float:
    return float(np.max(np.abs(residual) / (BALANCE_TOLERANCE * scale), initial=0.0))


# --- The motion that a system is linearised about: its operating point, or rest with every lash just closed.


@dataclass(frozen=True)
class ReferenceMotion:
    """State (x,) and torques or pedals of the inputs (u,), SI; angles whose speed is not 0 are those at time 0."""

    state: np.ndarray
    inputs: np.ndarray


def is_linear(system: System) -> bool:
    """Whether the linear model says everything about a system."""
    return not system.gearboxes and all(effect.law.linear for effect in system.effects)


def reference_motion(model: Model, p: np.ndarray) -> ReferenceMotion:
    """The motion about which a model is linearised, at parameters (p,).

    A linear model is the same about every motion and stands at rest here; see :func:`operating_motion` for its motion.
    A lash that nothing loads is just closed.

    Raises
    ------
    InputError
        If the operating point is no steady motion.
    """
    if model.system.operating_point is None or is_linear(model.system):
        return ReferenceMotion(np.atleast_2d(rest_state(model, p))[0], np.zeros(len(model.inputs)))
    motion = _solved(model, p)
    return ReferenceMotion(with_lash_closed(model, p, motion.state), motion.inputs)


def reference_motions(model: Model, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """States (b, x) and inputs (b, u) of :func:`reference_motion` at parameter sets (b, p)."""
    if model.system.operating_point is None or is_linear(model.system):
        x = np.broadcast_to(rest_state(model, p), (len(p), len(model.states)))
        return x, np.zeros((len(p), len(model.inputs)))
    motions = [reference_motion(model, row) for row in p]
    return np.stack([one.state for one in motions]), np.stack([one.inputs for one in motions])


def reference_states(model: Model, p: np.ndarray) -> np.ndarray:
    """States of :func:`reference_motion` at parameter sets (b, p): (x,) where all are one, else (b, x).

    Raises
    ------
    InputError
        If there is no equilibrium at the operating point.
    """
    if model.system.operating_point is None or is_linear(model.system):
        return rest_state(model, p)
    return np.stack([with_lash_closed(model, row, _solved(model, row).state) for row in p])


@functools.lru_cache(maxsize=256)
def operating_motion(system: System) -> ReferenceMotion:
    """State and torques of a system at its operating point; all zero without one.

    Raises
    ------
    InputError
        If the operating point is no steady motion.
    """
    model = compiled(system)
    if system.operating_point is None:
        return ReferenceMotion(np.zeros(len(model.states)), np.zeros(len(model.inputs)))
    return _solved(model, model.p0)


def speeds_of(system: System) -> dict[str, float]:
    """Speed of every inertia at the operating point, rad/s; 0 without one."""
    model = compiled(system)
    parts = elements(model, model.p0[None])
    rows = parts.mass_transformation.reshape(-1, model.n)
    speeds = rows @ operating_motion(system).state[model.n : 2 * model.n]
    named = zip(parts.masses, speeds.tolist(), strict=True)
    return {name.removeprefix("inertias."): speed for name, speed in named if name.startswith("inertias.")}


def torques_of(system: System) -> dict[str, float]:
    """Torque (N·m) or pedal of every input at the operating point; 0 without one."""
    return dict(zip(compiled(system).inputs, operating_motion(system).inputs.tolist(), strict=True))


def acting_torques_of(system: System) -> dict[str, float]:
    """Torque of every input at the operating point, N·m, of a pedal that of its map; 0 without an operating point."""
    held = torques_of(system)
    if not system.pedals:
        return held
    speeds, on = speeds_of(system), {part.name: part.on for part in system.inputs}
    return held | {name: own.torque(speeds[on[name]], held[name]) for name, own in system.pedals.items()}


def _solved(model: Model, p: np.ndarray) -> ReferenceMotion:
    return _solved_at(model, np.asarray(p, float).tobytes())


@functools.lru_cache(maxsize=4096)  # a match over speeds asks for the same beds in search and judgement
def _solved_at(model: Model, values: bytes) -> ReferenceMotion:
    point, p = model.system.operating_point, np.frombuffer(values)
    assert point is not None
    torques = dict(point.torques)
    u = np.array([torques.get(name, 0.0) for name in model.inputs])
    free = [i for i, name in enumerate(model.inputs) if name not in torques]
    motion = steady_motion(model, p, u, dict(point.speeds) or None, free)
    if not motion.error <= 1.0:
        missed = motion.error * BALANCE_TOLERANCE
        raise InputError(
            "operating_point",
            f"{model.system.title or 'the model'!r} has no steady motion with these speeds and torques "
            f"(the balance misses by {missed:.2g} of its torques){_of_pedals(model, free)}",
            "leave a torque or a speed open, or give another one",
        )
    return ReferenceMotion(motion.state, motion.inputs)


def _of_pedals(model: Model, free: Sequence[int]) -> str:
    """What free pedals would have to give, and what their maps do; empty where that is not the reason."""
    try:
        short = pedals_too_short(model.system)
    except InputError:  # nor would any torque hold it
        return ""
    return "".join(
        f": no pedal holds it, for {one.needed:.4g} N·m are needed at inputs.{name}, and its torque map "
        f"gives {one.least:.4g} to {one.most:.4g} N·m at {one.speed:.4g} rad/s"
        for name, one in short.items()
        if model.inputs.index(name) in free
    )


class TooShort(NamedTuple):
    """What a pedal would have to give, N·m, the least and most that its map has, N·m, at that speed, rad/s, and the
    pedal that comes nearest."""

    needed: float
    least: float
    most: float
    speed: float
    nearest: float


def pedals_too_short(system: System) -> dict[str, TooShort]:
    """By input: pedals that an operating point leaves open, and whose maps lack the torque that it needs.

    Raises
    ------
    InputError
        If no torque in their place would hold it.
    """
    point = system.operating_point
    stated = dict(point.torques) if point else {}
    maps = {name: own for name, own in system.pedals.items() if name not in stated}
    if not maps:
        return {}
    plain = replace(system, effects=tuple(each for each in system.effects if not each.law.pedal))
    held, speeds, on = torques_of(plain), speeds_of(plain), {part.name: part.on for part in system.inputs}
    found = {}
    for name, own in maps.items():
        speed, needed = speeds[on[name]], held[name]
        over = own.over_pedal(speed)
        if not over.min() <= needed <= over.max():
            found[name] = TooShort(needed, float(over.min()), float(over.max()), speed, own.pedal(speed, needed))
    return found
