"""Simulations of a model over recorded inputs, and how fine their integration steps have to be."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import make_interp_spline

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
SMOOTH_ROWS, SPLINE = 4, 5  # rows a sample of smooth inputs, and order of their spline, which misses 0.01 % of a sine
# of a fifth of the sampling frequency
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
    return [part.readings[:, :: rows_per_sample(segment)] for part, segment in zip(done, segments, strict=True)]


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
    return [part.states[0, :: rows_per_sample(segment)] for part, segment in zip(done, segments, strict=True)]


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
        if rows_per_sample(segment) > 1:
            time, inputs, share = between_samples(segment)
            steps = np.maximum(np.ceil(np.repeat(task.steps, rows_per_sample(segment)) * share), 1).astype(np.int64)
            task = replace(task, time=time, inputs=inputs, steps=steps)
        tasks.append(task)
    return tasks


def rows_per_sample(segment: Segment) -> int:
    """Rows of :func:`between_samples` from one sample to the next."""
    return (SMOOTH_ROWS if segment.smooth else 1) + bool(segment.held)


def between_samples(segment: Segment) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (r,), s, and inputs (r, u) whose straight lines act as a segment's inputs do between its samples, and the
    share of its interval that lies between two rows (r - 1,).

    Smooth inputs have rows near a spline through their samples, such that lines through them have its moments: by the
    series of 1/sinc², 1 + x²/12 + x⁴/240 with x the angle that a sine turns between two rows. Held ones keep their
    value up to a row just before the next sample. The samples are every :func:`rows_per_sample`-th row.
    """
    rows, parts = rows_per_sample(segment), SMOOTH_ROWS if segment.smooth else 1
    begin, span = segment.time[:-1, None], np.diff(segment.time)[:, None]
    at = np.arange(parts) / parts * np.ones((len(span), 1))
    if segment.held:
        at = np.hstack([at, np.full((len(span), 1), 1 - JUMP_SHARE)])
    time = np.append((begin + at * span).ravel(), segment.time[-1])
    inputs = np.stack([np.interp(time, segment.time, column) for column in segment.inputs.T], axis=1)
    for j in segment.smooth:
        curve, apart = make_interp_spline(segment.time, segment.inputs[:, j], SPLINE), np.gradient(segment.time) / parts
        step = np.interp(time, segment.time, apart)
        inputs[:, j] = curve(time) - step**2 / 12 * curve(time, 2) + step**4 / 240 * curve(time, 4)
    for j in segment.held:
        inputs[:-1, j] = np.repeat(segment.inputs[:-1, j], rows)
    return time, inputs, np.diff(np.hstack([at, np.ones((len(span), 1))]), axis=1).ravel()


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
