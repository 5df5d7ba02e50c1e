"""Simulations of a model over recorded inputs, and how fine their integration steps have to be."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from matching.diagnosis.data import Segment
from modelling.equations.casadi_code import Model, compiled
from modelling.equations.lagrange import RECORDING, STICK_SPEED
from modelling.resources import threads
from modelling.simulation import interpreted
from modelling.simulation.compiled import compile_ahead, run_all_compiled
from modelling.simulation.stepping import rates_at_rest
from modelling.simulation.task import IntegrationTask, Trajectories, functions, make_task
from modelling.system import System

# --- Simulations of one model over recorded inputs for many sets of parameters and start states.

FEWEST_SAMPLES_FOR_THREADS = 4000  # of all rows; below, threads cost more than they save (measured on two cores)
LEAST_STEPS_PER_SAMPLE, MOST_STEPS_PER_SAMPLE = 1.0, 8.0  # of the plan for a model without abrupt torques
UNSTABLE_RATE = 2.7  # rate times step; the same limit, just reached
STABLE_RATE = 2.2  # rate times step; classical Runge–Kutta of order 4 is stable up to 2.78 on the negative real axis
JUMP_SHARE = 1e-6  # of the time between two samples, in which a held input takes its next value
LOWEST_STICK_SPEED, HIGHEST_STICK_SPEED, STICK_SPEED_FACTOR = 1e-5, 1e3, 1.5  # rad/s, rad/s, between two trials


def compile_models(systems: Iterable[System]) -> None:
    """Compile the models of several systems side by side; what the cache holds is not compiled again."""
    compile_ahead([functions(compiled(system)) for system in systems])


def simulate_readings(
    model: Model,
    segments: Sequence[Segment],
    p: np.ndarray,
    starts: Sequence[np.ndarray],
    steps_per_second: float,
) -> list[np.ndarray]:
    """Readings (b, t, y), SI, of each segment; rows that diverge are NaN.

    Parameters
    ----------
    p : ndarray (b, p)
    starts : sequence of ndarray (b, x)
        Start states of each segment.
    """
    tasks = _tasks(model, segments, p, starts, steps_per_second)
    done = _run(tasks, states=False)
    return [part.readings[:, :: 2 if segment.held else 1] for part, segment in zip(done, segments, strict=True)]


def simulate_states(
    model: Model,
    segments: Sequence[Segment],
    p: np.ndarray,
    starts: Sequence[np.ndarray],
    steps_per_second: float,
) -> list[np.ndarray]:
    """States (t, x) of each segment for parameters (p,) and a start state (x,) of each."""
    tasks = _tasks(model, segments, p[None], [start[None] for start in starts], steps_per_second)
    done = _run(tasks, readings=False)
    return [part.states[0, :: 2 if segment.held else 1] for part, segment in zip(done, segments, strict=True)]


def _tasks(
    model: Model, segments: Sequence[Segment], p: np.ndarray, starts: Sequence[np.ndarray], steps_per_second: float
) -> list[IntegrationTask]:
    stiff = _stiff(model, steps_per_second)
    tasks = []
    for segment, start in zip(segments, starts, strict=True):
        task = make_task(
            model, segment.time, segment.inputs, _of_recording(model, p, segment.recording), start, steps_per_second,
            implicit=stiff,
        )  # fmt: skip
        tasks.append(_with_held_inputs(task, segment.held) if segment.held else task)
    return tasks


def _with_held_inputs(task: IntegrationTask, held: Sequence[int]) -> IntegrationTask:
    """A task whose inputs are straight between samples, with some that are held: a row just before every sample but the
    first keeps the value until there. The samples are then every second row."""
    span = np.diff(task.time)
    time = np.repeat(task.time, 2)[1:]
    time[1::2] = np.maximum(task.time[1:] - JUMP_SHARE * span, np.nextafter(task.time[:-1], np.inf))
    inputs = np.repeat(task.inputs, 2, axis=0)[1:]
    inputs[1::2] = task.inputs[1:]
    inputs[1::2, list(held)] = task.inputs[:-1, list(held)]
    steps = np.ones(len(time) - 1, dtype=np.int64)
    steps[::2] = task.steps
    return replace(task, time=time, inputs=inputs, steps=steps)


def _of_recording(model: Model, p: np.ndarray, number: int) -> np.ndarray:
    """Parameters (b, p) as they hold in a recording."""
    if RECORDING not in model.parameters:
        return p
    return np.where(np.arange(len(model.parameters)) == model.parameters.index(RECORDING), float(number), p)


@functools.lru_cache(maxsize=512)
def _stiff(model: Model, steps_per_second: float) -> bool:
    """Whether explicit steps at this rate are unstable for the model as it stands, dry friction aside.

    Decided by the model's nominal values, so that all simulations of a fit take the same kind of step.
    """
    p = model.p0.copy()
    if STICK_SPEED in model.parameters:
        p[model.parameters.index(STICK_SPEED)] = 1e9  # friction that hardly depends on speed
    return rates_at_rest(model, p[None]).any > UNSTABLE_RATE * steps_per_second


def _run(tasks: Sequence[IntegrationTask], states: bool = True, readings: bool = True) -> list[Trajectories]:
    samples = sum(len(task.p) * len(task.time) for task in tasks)
    count = threads() if samples > FEWEST_SAMPLES_FOR_THREADS else 1
    results = run_all_compiled(tasks, states, readings, count) if tasks else []
    return results if results is not None else [interpreted.run(task, states, readings) for task in tasks]


def fastest_rate(model: Model, p: np.ndarray, states: np.ndarray, inputs: np.ndarray) -> float:
    """Largest magnitude (1/s) of the eigenvalues of the linearised model at several states (b, x)."""
    fastest = 0.0
    for x in states:
        a = np.array(model.jacobians(x, inputs, p, 0.0)[0])
        if np.isfinite(a).all():
            fastest = max(fastest, float(np.abs(np.linalg.eigvals(a)).max(initial=0.0)))
    return fastest


def steps_and_stick_speed(
    model: Model, p: np.ndarray, states: np.ndarray, sampling: float, fine: float, least: float = 0.0
) -> tuple[float, float]:
    """Integration steps per second, and the stick speed (rad/s) that they resolve; NaN without dry friction.

    The fastest mode, dry friction aside, gets ``fine`` steps a radian. The stick speed is then raised until friction at
    rest is no faster than the steps can follow.

    Parameters
    ----------
    states : ndarray (b, x)
        At which the rates are looked at.
    sampling : float
        Of the recording, Hz.
    fine : float
        Steps a radian of the fastest mode.
    least : float
        Steps per second at least.
    """
    inputs = np.zeros(len(model.inputs))
    index = model.parameters.index(STICK_SPEED) if STICK_SPEED in model.parameters else None
    p = p.copy()
    if index is not None:
        p[index] = 1e9  # friction that hardly depends on speed
    wanted = min(fine * fastest_rate(model, p, states, inputs), MOST_STEPS_PER_SAMPLE * sampling)
    steps = max(LEAST_STEPS_PER_SAMPLE * sampling, least, wanted)
    steps = float(np.ceil(steps / sampling - 1e-6)) * sampling
    if index is None:
        return steps, np.nan
    rest = np.zeros((1, states.shape[1]))
    stick_speed = LOWEST_STICK_SPEED
    while stick_speed < HIGHEST_STICK_SPEED:
        p[index] = stick_speed
        if fastest_rate(model, p, rest, inputs) < STABLE_RATE * steps:
            break
        stick_speed *= STICK_SPEED_FACTOR
    return steps, stick_speed
