"""Gains of the speed hold that the controller falls back to: slow, plain, and checked on the rig's model."""

from __future__ import annotations

import numpy as np
import scipy

from modelling.common.errors import InputError
from modelling.linear.state_space import StateSpace

CROSSOVER_TIMES_DELAY = 0.25  # rad: crossover of the lone rotor over the sum of dead time and lags; 76° of phase margin
INTEGRAL_BELOW = 20.0  # the integral sets in this many times below the crossover
HALVINGS = 12  # of both gains, until the rig's model is stable
ON_THE_CIRCLE = 1e-6  # of |z|: poles this near 1 are angles that nothing depends on


def hold_gains(
    bed: StateSpace, rotor_inertias: np.ndarray, dead_time: float, lag: float, sample_time: float
) -> tuple[np.ndarray, np.ndarray]:
    """Proportional (k,) and integral (k,) gains, N·m·s/rad and N·m/rad, of a speed hold that is stable on the rig.

    Parameters
    ----------
    bed : StateSpace
        Inputs start with the torque commands (k); outputs are the rotor speeds (k).
    rotor_inertias : ndarray (k,)
        kg·m².
    dead_time, lag, sample_time : float
        s; the lag of inverter and sensor together.

    Raises
    ------
    InputError
        If no such gains are stable.
    """
    crossover = CROSSOVER_TIMES_DELAY / (dead_time + lag + sample_time)
    proportional = rotor_inertias * crossover
    integral = proportional * crossover / INTEGRAL_BELOW
    for _ in range(HALVINGS):
        if _is_stable(bed, proportional, integral, dead_time, sample_time):
            return proportional, integral
        proportional, integral = proportional / 2, integral / 4
    raise InputError(
        "controller", "no speed hold is stable on this rig", "check dead time, lags and the rotors' inertias"
    )


def _is_stable(bed: StateSpace, proportional: np.ndarray, integral: np.ndarray, dead: float, step: float) -> bool:
    k, delay = len(proportional), int(np.ceil(dead / step - 1e-9))
    A, B, *_ = scipy.signal.cont2discrete((bed.A, bed.B[:, :k], bed.C, np.zeros((k, k))), step)
    n, fifo = len(A), k * delay
    size = n + fifo + k
    law = np.zeros((k, size))  # the command on [bed, commands on their way (oldest first), integrals]
    law[:, :n], law[:, n + fifo :] = -proportional[:, None] * bed.C, np.eye(k)
    M = np.zeros((size, size))
    M[:n, :n] = A
    if delay:
        M[:n, n : n + k] = B
        M[n : n + fifo - k, n + k : n + fifo] = np.eye(fifo - k)
        M[n + fifo - k : n + fifo] = law
    else:
        M[:n] += B @ law
    M[n + fifo :, :n], M[n + fifo :, n + fifo :] = -step * integral[:, None] * bed.C, np.eye(k)
    return bool(np.abs(np.linalg.eigvals(M)).max() <= 1 + ON_THE_CIRCLE)
