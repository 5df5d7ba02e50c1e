"""The torque balance of a fit: which further torque on which inertia, or in which shaft, the measurement asks for.

The deviation of measurement from simulation is smoothed by the linear model with an unknown, slowly changing torque on
every inertia and in every shaft. Nothing is differentiated; noise is weighted by the sensors' uncertainty. It tells
where a cause may be, not which.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import expm

from matching.diagnosis.candidates.smoother import stationary_smoother
from matching.diagnosis.fitting.fit import Fit
from modelling.common.errors import InputError
from modelling.equations.compiled import Model, compiled
from modelling.model.components import Input
from modelling.model.system import System

CORRELATION_TIME = 0.01  # s over which an unknown torque may change; faster than the modes of drivability (30 Hz)
TORQUE_SHARE = 0.2  # standard deviation of an unknown torque, of the largest torque in the drivetrain (rms)
ANGLE_SIGMA = 1.0  # rad within which angles are held: no reading tells where a drivetrain as a whole stands


@dataclass(frozen=True)
class TorqueBalance:
    """Deviations of the states and unknown torques, segments one after another.

    Attributes
    ----------
    names : list of str
        Of the states.
    states : ndarray (t, x)
        Measurement − simulation.
    inertias : ndarray (t, i)
        Torque that each inertia lacks, N·m.
    shafts : ndarray (t, s)
        Torque that each shaft lacks, N·m, on the second end's side.
    """

    names: list[str]
    states: np.ndarray
    inertias: np.ndarray
    shafts: np.ndarray

    def added_to(self, names: list[str], states: np.ndarray) -> np.ndarray:
        """Simulated states (t, x) of these names, where the measurement has them."""
        out = states.copy()
        for i, name in enumerate(names):
            if name in self.names:
                out[:, i] += self.states[:, self.names.index(name)]
        return out


@dataclass(frozen=True)
class LinearModel:
    """ẋ = A·x + B·T, y = C·x + D·T with a torque T (u,) on every inertia, then in every shaft.

    A (x, x), B (x, u), C (y, x), D (y, u).
    """

    model: Model
    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray


def linear_model(system: System, value: dict[str, float]) -> LinearModel:
    """The linear part of a system at parameter values, SI by name.

    A further torque T in a shaft turns its second end by T and its first end by −T over the ratio.
    """
    known = {name: v for name, v in value.items() if name in system.parameters}
    inputs = tuple(Input(f"probe{i}", part.name, "torque") for i, part in enumerate(system.inertias))
    model = compiled(replace(system.with_values(known), inputs=inputs))
    A, B, C, D = (np.array(m) for m in model.jacobians(np.zeros(len(model.states)), np.zeros(len(inputs)), model.p0, 0))
    names = [part.name for part in system.inertias]
    mixes, direct = [], []
    for shaft in system.shafts:
        mix = np.zeros(len(inputs))
        mix[names.index(shaft.between[0])] = -1 / value.get(f"shafts.{shaft.name}.ratio", 1.0)
        mix[names.index(shaft.between[1])] = 1.0
        mixes.append(mix)
        direct.append([float(sensor.measures == "torque" and sensor.of == shaft.name) for sensor in system.sensors])
    if mixes:
        mix = np.array(mixes).T
        B, D = np.hstack([B, B @ mix]), np.hstack([D, D @ mix + np.array(direct).T])
    return LinearModel(model, A, B, C, D)


def torque_balance(fit: Fit, system: System, value: dict[str, float], scale: float) -> TorqueBalance:
    """Smooth the residual of a fit by its linear model.

    Parameters
    ----------
    system : System
        The fitted system without the effects that have states or are not smooth.
    value : dict of str to float
        Parameters by name, SI.
    scale : float
        A torque typical of the drivetrain, N·m.

    Raises
    ------
    InputError
        If the readings determine no motion: absurd values, units or sampling.
    """
    linear, data = linear_model(system, value), fit.problem.data
    n, x, torques = linear.model.n, len(linear.A), linear.B.shape[1]
    step = data.sampling_interval
    decay = -np.eye(torques) / CORRELATION_TIME
    F = expm(np.block([[linear.A, linear.B], [np.zeros((torques, x)), decay]]) * step)
    variance = (TORQUE_SHARE * scale) ** 2 * (1 - np.exp(-2 * step / CORRELATION_TIME))
    Q = np.diag([0.0] * x + [variance] * torques)
    angles = np.hstack([np.eye(n), np.zeros((n, x + torques - n))])
    H = np.vstack([np.hstack([linear.C, linear.D]), angles])
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # of absurd data, which are refused
            smoother = stationary_smoother(F, H, Q, np.concatenate([data.noise**2, np.full(n, ANGLE_SIGMA**2)]))
    except (np.linalg.LinAlgError, ValueError):
        raise InputError(
            data.segments[0].name or "recording",
            "no motion of the model's inertias follows from its readings",
            "check units and sampling of the channels, and the sensors' uncertainties",
        ) from None
    parts = []
    for residual, segment in zip(fit.errors, data.segments, strict=True):
        deviation = np.where(segment.measured, residual * data.noise, 0.0)
        parts.append(smoother.smooth(np.hstack([deviation, np.zeros((len(deviation), n))])))
    states, unknown = np.split(np.concatenate(parts), [x], axis=1)
    inertias, shafts = np.split(unknown, [len(system.inertias)], axis=1)
    return TorqueBalance(linear.model.states, states, inertias, shafts)
