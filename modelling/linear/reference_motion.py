"""The motion that a system is linearised about: its operating point, or rest with every lash just closed."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from modelling.common.errors import InputError
from modelling.equations.compiled import Model, compiled
from modelling.linear.elements import elements, rest_state, with_lash_closed
from modelling.linear.steady_motion import BALANCE_TOLERANCE, steady_motion
from modelling.model.system import System


@dataclass(frozen=True)
class ReferenceMotion:
    """State (x,) and torques of the inputs (u,) in N·m, SI; angles whose speed is not 0 are those at time 0."""

    state: np.ndarray
    inputs: np.ndarray


def is_linear(system: System) -> bool:
    """Whether the linear model says everything about a system."""
    return all(effect.law.linear for effect in system.effects)


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
    """Torque of every input at the operating point, N·m; 0 without one."""
    return dict(zip(compiled(system).inputs, operating_motion(system).inputs.tolist(), strict=True))


def _solved(model: Model, p: np.ndarray) -> ReferenceMotion:
    point = model.system.operating_point
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
            f"(the balance misses by {missed:.2g} of its torques)",
            "leave a torque or a speed open, or give another one",
        )
    return ReferenceMotion(motion.state, motion.inputs)
