"""The torque balance that is left over: which torque on which inertia, or in which shaft, the measurement asks for.

The deviation of measurement from simulation is smoothed (Rauch, Tung and Striebel 1965, gains constant) by the linear
model
with an unknown, slowly changing torque on every inertia and in every shaft. Nothing is differentiated; noise is weighed
by the sensors' uncertainty. It says where, not yet why.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import expm

from matching.diagnosis.fitting.fit import Fit
from modelling.equations.compiled import Model, compiled
from modelling.model.components import Input
from modelling.model.system import System

CORRELATION = 0.01  # s over which an unknown torque may change
SHARE = 0.2  # standard deviation of an unknown torque, of the largest torque in the drivetrain (rms)


@dataclass(frozen=True)
class Leftover:
    """Deviation of the states ``names`` (t, x) and unknown torques: on inertias (t, i), in shafts (t, s); N·m."""

    names: list[str]
    states: np.ndarray
    inertias: np.ndarray
    shafts: np.ndarray

    def added_to(self, names: list[str], states: np.ndarray) -> np.ndarray:
        """States (t, x) with these names, where the measurement has them."""
        out = states.copy()
        for i, name in enumerate(names):
            if name in self.names:
                out[:, i] += self.states[:, self.names.index(name)]
        return out


def linear(system: System, value: dict[str, float]) -> tuple[Model, list[np.ndarray]]:
    """The linear part of a system with a torque input on every inertia and in every shaft: A, B, C, D."""
    probe = replace(
        system.with_values({name: v for name, v in value.items() if name in system.parameters}),
        inputs=tuple(Input(f"probe{i}", part.name) for i, part in enumerate(system.inertias)),
    )
    model = compiled(probe)
    u = np.zeros(len(probe.inputs))
    A, B, C, D = (np.array(m) for m in model.jacobians(np.zeros(len(model.states)), u, model.p0, 0.0))
    names = [part.name for part in system.inertias]
    for shaft in system.shafts:
        mix = np.zeros(len(u))
        mix[names.index(shaft.between[0])] = -1 / value.get(f"shafts.{shaft.name}.ratio", 1.0)
        mix[names.index(shaft.between[1])] = 1.0
        B = np.column_stack([B, B[:, : len(u)] @ mix])
        read = [float(sensor.measures == "torque" and sensor.of == shaft.name) for sensor in system.sensors]
        D = np.column_stack([D, D[:, : len(u)] @ mix + read])
    return model, [A, B, C, D]


def leftover(fit: Fit, system: System, value: dict[str, float], scale: float) -> Leftover:
    """Smooth the residual of a fit by its linear model.

    Parameters
    ----------
    system : System
        The fitted system without the effects that have states or are not smooth.
    scale : float
        A torque typical of the drivetrain, N·m.
    """
    model, (A, B, C, D) = linear(system, value)
    nx, nd, ny = A.shape[0], B.shape[1], C.shape[0]
    step = float(np.median(np.diff(fit.problem.data.segments[0].time)))
    full = np.block([[A, B], [np.zeros((nd, nx)), -np.eye(nd) / CORRELATION]])
    F = expm(full * step)
    H = np.hstack([C, D])
    Q = np.zeros((nx + nd, nx + nd))
    Q[nx:, nx:] = np.eye(nd) * (SHARE * scale) ** 2 * (1 - np.exp(-2 * step / CORRELATION))
    R = np.diag(fit.problem.data.noise**2)
    # no reading tells where the whole stands: hold the angles loosely
    H = np.vstack([H, np.hstack([np.eye(model.n), np.zeros((model.n, nx + nd - model.n))])])
    R = np.block([[R, np.zeros((ny, model.n))], [np.zeros((model.n, ny)), np.eye(model.n)]])
    K, S = _gains(F, H, Q, R, nx, scale)
    states, torques = [], []
    for residual, segment in zip(fit.by_sensor(), fit.problem.data.segments, strict=True):
        y = np.where(segment.counts, residual * fit.problem.data.noise, 0.0)
        x = _smooth(F, H, K, S, np.hstack([y, np.zeros((len(y), model.n))]))
        states.append(x[:, :nx])
        torques.append(x[:, nx:])
    unknown = np.concatenate(torques)
    split = len(system.inertias)
    return Leftover(model.states, np.concatenate(states), unknown[:, :split], unknown[:, split:])


def _gains(
    F: np.ndarray, H: np.ndarray, Q: np.ndarray, R: np.ndarray, nx: int, scale: float
) -> tuple[np.ndarray, np.ndarray]:
    """Constant gains of filter and smoother, from the Riccati recursion run until it rests."""
    P = np.eye(len(F))
    P[nx:, nx:] *= (SHARE * scale) ** 2
    for _ in range(3000):
        K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
        kept = P - K @ H @ P
        after = F @ kept @ F.T + Q
        after = (after + after.T) / 2
        change = np.max(np.abs(after - P) / np.sqrt(np.outer(np.diag(after), np.diag(after)) + 1e-300))
        P = after
        if change < 1e-5:
            break
    ridge = 1e-12 * np.diag(np.diag(P))
    return K, np.linalg.solve(P + ridge, F @ kept).T


def _smooth(F: np.ndarray, H: np.ndarray, K: np.ndarray, S: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Filter forwards, smooth backwards; (t, y) → (t, x)."""
    filtered = np.empty((len(y), len(F)))
    keep = (np.eye(len(F)) - K @ H) @ F
    driven = y @ K.T
    x = np.zeros(len(F))
    for k, own in enumerate(driven):
        x = keep @ x + own
        filtered[k] = x
    back = np.eye(len(F)) - S @ F
    anchored = filtered @ back.T
    for k in range(len(y) - 2, -1, -1):
        x = anchored[k] + S @ x
        filtered[k] = x
    return filtered
