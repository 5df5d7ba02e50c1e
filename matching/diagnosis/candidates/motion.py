"""The motion of a fitted model over the recorded inputs, from which effects make their first guesses."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from matching.diagnosis.candidates.balance import TorqueBalance
from matching.diagnosis.fitting.fit import Fit
from modelling.effects.first_guess import FittedMotion
from modelling.equations.lagrange import derive
from modelling.model.components import Shaft
from modelling.model.system import System


def simulated_motion(fit: Fit, balance: TorqueBalance | None = None) -> FittedMotion:
    """The motion of a fit, segments one after another; with a torque balance, as the measurement has it."""
    problem, system = fit.problem, fit.problem.system
    model, segments = problem.model, problem.data.segments
    x = np.concatenate(problem.states(fit.v))
    if balance is not None:
        x = balance.added_to(model.states, x)
    p, _ = problem.unpack(fit.v)
    value = dict(zip(model.parameters, (float(v) for v in p), strict=True))
    shares = inertia_shares(system, model.coordinates, value)
    n, inputs = model.n, np.concatenate([segment.inputs for segment in segments])
    angles, speeds = (x[:, first : first + n] @ shares.T for first in (0, n))
    torques = np.array(model.shaft_torques.map(len(x))(x.T, inputs.T, p)).reshape(-1, len(x))
    ends = np.cumsum([0, *(len(segment.time) for segment in segments)])
    parts = tuple(slice(int(a), int(b)) for a, b in pairwise(ends))
    time = np.concatenate([segment.time for segment in segments])
    accelerations = np.concatenate([np.gradient(speeds[part], time[part], axis=0) for part in parts])
    names = [part.name for part in system.inertias]
    angle, speed, acceleration = (dict(zip(names, motion.T, strict=True)) for motion in (angles, speeds, accelerations))
    y = np.concatenate(problem.simulated(fit.v))
    return FittedMotion(
        time, parts, angle, speed, acceleration,
        {shaft.name: _twist(angle, shaft, value) for shaft in system.shafts},
        {shaft.name: _twist(speed, shaft, value) for shaft in system.shafts},
        {shaft.name: torques[j] for j, shaft in enumerate(system.shafts)},
        {part.name: inputs[:, j] for j, part in enumerate(system.inputs)},
        {sensor.name: y[:, j] for j, sensor in enumerate(system.sensors)},
        {sensor.name: float(problem.data.noise[j]) for j, sensor in enumerate(system.sensors)},
        value, {shaft.name: shaft.between for shaft in system.shafts},
        gear_torque=_gear_torques(fit, x, inputs, p), gear_ends={gear.name: gear.between for gear in system.gears},
        recording=np.concatenate([np.full(len(segment.time), segment.recording) for segment in segments]),
    )  # fmt: skip


def _gear_torques(fit: Fit, x: np.ndarray, inputs: np.ndarray, p: np.ndarray) -> dict[str, np.ndarray]:
    """By rigid gear, what it passes on (t,), where it follows from both sides."""
    gears, model = fit.problem.system.gears, fit.problem.model
    if not gears:
        return {}
    torques = np.array(model.gear_torques.map(len(x))(x.T, inputs.T, p)).reshape(-1, len(x))
    return {gear.name: torque for gear, torque in zip(gears, torques, strict=True) if np.isfinite(torque).all()}


def inertia_shares(system: System, coordinates: list[str], value: dict[str, float]) -> np.ndarray:
    """(i, n) motion of every inertia per motion of each coordinate: ratios of gears, shares of differentials."""
    assembly = derive(system).assembly
    motions, value = assembly.motions, assembly.with_abbreviations(value)
    out = np.zeros((len(system.inertias), len(coordinates)))
    for i, part in enumerate(system.inertias):
        for j, share in motions[part.name].coefficients.items():
            out[i, j] = float(share.subs({s: value[str(s)] for s in share.free_symbols}))
    return out


def _twist(motion: dict[str, np.ndarray], shaft: Shaft, value: dict[str, float]) -> np.ndarray:
    """Twist of a shaft from angles, or its rate from speeds, (t,)."""
    first, second = (motion[end] for end in shaft.between)
    return first / value.get(f"shafts.{shaft.name}.ratio", 1.0) - second
