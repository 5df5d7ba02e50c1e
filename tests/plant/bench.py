"""Runs a drive under an excitation: what is recorded, free of noise, and the base model replayed on it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from plant.build import chain_of
from plant.engine import Motion, simulate
from plant.excitation import Excitation
from plant.hidden import Hidden
from plant.sensing import converted, read, rows_needed, stamped_inputs
from plant.systems import Drive


@dataclass
class Take:
    """A noise-free recording: time (t,), inputs (t, u), readings by sensor, state (2n: angles, speeds) at its start."""

    time: np.ndarray
    inputs: np.ndarray
    readings: dict[str, np.ndarray]
    start: np.ndarray
    motion: Motion
    stepped: dict[str, np.ndarray]  # the readings as the converter gives them


def record(drive: Drive, effects: list[Hidden], excitation: Excitation, dt: float, step: float = 50e-6) -> Take:
    """Simulate the drive with its hidden effects and read its sensors."""
    chain = chain_of(drive, effects)
    chain.warm_from = excitation.begin * dt
    if np.isfinite(chain.jump_time):
        chain.jump_time += excitation.begin * dt
    for name, (proportional, integral) in excitation.controllers.items():
        j = list(drive.inputs).index(name)
        chain["controlled"][j], chain["gain_p"][j], chain["gain_i"][j] = 1, proportional, integral
        chain["torque_limit"][j] = 8 * drive.torque[name]
    rows = rows_needed(effects)
    turns = np.ones(chain.n)
    turns[: len(drive.inertias)] = [drive.speed_ratio(name) for name in drive.inertias]
    for j in range(len(drive.shafts), chain.s):  # an added inertia turns with what it carries
        turns[chain["first"][j]] = turns[chain["second"][j]]
    start = np.concatenate([np.zeros(chain.n), excitation.start_speed * turns])
    motion = simulate(
        chain,
        excitation.inputs,
        start,
        dt,
        step=step,
        rows_per_sample=rows,
        reference=excitation.reference,
        feedback_noise=excitation.feedback_noise,
    )
    readings = read(drive, motion, effects, rows, excitation.begin)
    inputs = stamped_inputs(drive, motion.input, effects, dt)[excitation.begin :]
    first, n = excitation.begin * rows, len(drive.inertias)
    state = np.concatenate([motion.angle[first, :n], motion.speed[first, :n]])
    time = np.arange(len(inputs)) * dt
    return Take(time, inputs, readings, state, motion, converted(readings, effects))


def replay(
    drive: Drive,
    inputs: np.ndarray,
    start: np.ndarray,
    dt: float,
    values: dict[str, float] | None = None,
    effects: list[Hidden] | None = None,
    step: float = 1e-4,
) -> dict[str, np.ndarray]:
    """Readings of the drive (without effects unless given) on recorded inputs (t, u), from a state (2n)."""
    other, effects = replace(drive, values=values or drive.values), effects or []
    chain, rows, n = chain_of(other, effects), rows_needed(effects), len(drive.inertias)
    follows = [*range(n), *chain["second"][len(drive.shafts) :]]  # an added inertia moves with what it carries
    start = np.concatenate([start[:n][follows], start[n:][follows]])
    motion = simulate(chain, inputs, start, dt, step=step, rows_per_sample=rows)
    return converted(read(other, motion, effects, rows, 0), effects)
