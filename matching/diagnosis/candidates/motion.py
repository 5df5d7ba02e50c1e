"""What a fitted model did over the recorded inputs, as effects are shown it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from matching.diagnosis.candidates.balance import Leftover
from matching.diagnosis.fitting.fit import Fit
from modelling.effects.first_guess import FittedMotion
from modelling.equations.lagrange import derive
from modelling.model.components import Shaft
from modelling.model.system import System


def seen(fit: Fit, leftover: Leftover | None = None) -> FittedMotion:
    """The motion of a fit, segments one after another; with what is left over, as the measurement has it."""
    problem, system = fit.problem, fit.problem.system
    model, segments = problem.model, problem.data.segments
    x = np.concatenate(problem.states(fit.v))
    if leftover is not None:
        x = leftover.added_to(model.states, x)
    p, _ = problem.unpack(fit.v)
    value = dict(zip(model.parameters, (float(v) for v in p), strict=True))
    shares = inertia_shares(system, model.coordinates, value)
    n, inputs = model.n, np.concatenate([segment.inputs for segment in segments])
    angles, speeds = (x[:, first : first + n] @ shares.T for first in (0, n))
    torques = np.array(model.shaft_torques.map(len(x))(x.T, inputs.T, p)).reshape(-1, len(x))
    ends = np.cumsum([0, *(len(segment.time) for segment in segments)])
    parts = tuple(slice(int(a), int(b)) for a, b in pairwise(ends))
    time = np.concatenate([segment.time for segment in segments])
    acceleration = np.concatenate([np.gradient(speeds[part], time[part], axis=0) for part in parts])
    names = [part.name for part in system.inertias]
    twist, rate = ({s.name: _twist(motion, s, names, value) for s in system.shafts} for motion in (angles, speeds))
    y = np.concatenate(problem.simulated(fit.v))
    angle, speed, faster = (dict(zip(names, motion.T, strict=True)) for motion in (angles, speeds, acceleration))
    return FittedMotion(
        time, parts, angle, speed, faster, twist, rate,
        {s.name: torques[j] for j, s in enumerate(system.shafts)},
        {part.name: inputs[:, j] for j, part in enumerate(system.inputs)},
        {sensor.name: y[:, j] for j, sensor in enumerate(system.sensors)},
        {sensor.name: float(problem.data.noise[j]) for j, sensor in enumerate(system.sensors)},
        value, {s.name: s.between for s in system.shafts},
    )  # fmt: skip


def inertia_shares(system: System, coordinates: list[str], value: dict[str, float]) -> np.ndarray:
    """(i, n) how every inertia moves with the coordinates."""
    motions = derive(system).assembly.motions
    out = np.zeros((len(system.inertias), len(coordinates)))
    for i, part in enumerate(system.inertias):
        for j, share in motions[part.name].coefficients.items():
            out[i, j] = float(share.subs({s: value[str(s)] for s in share.free_symbols}))
    return out


def _twist(motion: np.ndarray, shaft: Shaft, names: list[str], value: dict[str, float]) -> np.ndarray:
    first, second = (motion[:, names.index(end)] for end in shaft.between)
    return first / value.get(f"shafts.{shaft.name}.ratio", 1.0) - second
