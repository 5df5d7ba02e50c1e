"""Steady motion at a speed and torque, and the model linearised about it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from modelling.common.errors import InputError, unknown
from modelling.equations.compiled import compiled
from modelling.linear.linearise import Linear, linear_at
from modelling.linear.steady_motion import BALANCE_TOLERANCE, steady_motion, without_ripple
from modelling.model.system import System


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
