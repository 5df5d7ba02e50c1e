"""Many runs of one model over recorded inputs."""

from __future__ import annotations

import functools
import os
from collections.abc import Iterable, Sequence

import numpy as np

from matching.diagnosis.data.segments import Segment
from modelling.equations.assembly import STICK_SPEED
from modelling.equations.compiled import Model, compiled
from modelling.model.system import System
from modelling.simulation.integrator import native, virtual
from modelling.simulation.integrator.c_library import compile_ahead
from modelling.simulation.integrator.functions import functions
from modelling.simulation.integrator.task import Task, make_task

WORTH = 4000  # samples of all rows, below which threads cost more than they save


@functools.cache
def threads() -> int:
    """How many threads share a batch: ``OMP_NUM_THREADS`` where that is set, as for any library, else all cores."""
    told = os.environ.get("OMP_NUM_THREADS", "")
    if told.isdecimal() and int(told) > 0:
        return int(told)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def prepare(systems: Iterable[System]) -> None:
    """Compile the models of several systems side by side; what the cache holds is not compiled again."""
    compile_ahead([functions(compiled(system)) for system in systems])


def readings(model: Model, segment: Segment, p: np.ndarray, start: np.ndarray, steps: float) -> np.ndarray:
    """Readings (b, t, y) for parameters (b, p) and starts (b, x); rows that diverge are NaN."""
    return all_readings(model, [segment], p, [start], steps)[0]


def all_readings(
    model: Model, segments: Sequence[Segment], p: np.ndarray, starts: Sequence[np.ndarray], steps: float
) -> list[np.ndarray]:
    """Readings (b, t, y) of each segment for parameters (b, p) and starts (b, x) of each; rows that diverge are NaN."""
    return [done[1] for done in _run(_tasks(model, segments, p, starts, steps), states=False)]


def all_states(
    model: Model, segments: Sequence[Segment], p: np.ndarray, starts: Sequence[np.ndarray], steps: float
) -> list[np.ndarray]:
    """States (t, x) of each segment for parameters (p,) and a start (x,) of each."""
    tasks = _tasks(model, segments, p[None], [start[None] for start in starts], steps)
    return [done[0][0] for done in _run(tasks, readings=False)]


def _tasks(
    model: Model, segments: Sequence[Segment], p: np.ndarray, starts: Sequence[np.ndarray], steps: float
) -> list[Task]:
    return [
        make_task(model, segment.time, segment.inputs, p, start, steps)
        for segment, start in zip(segments, starts, strict=True)
    ]


def _run(tasks: Sequence[Task], states: bool = True, readings: bool = True) -> list[tuple[np.ndarray, ...]]:
    long = sum(len(task.p) * len(task.time) for task in tasks) > WORTH
    done = native.run_all(tasks, states, readings, threads() if long else 1) if tasks else []
    return done if done is not None else [virtual.run(task, states, readings) for task in tasks]


def fastest_rate(model: Model, p: np.ndarray, points: np.ndarray, inputs: np.ndarray) -> float:
    """Largest magnitude (1/s) of the eigenvalues of the linearised model at several states (b, x)."""
    found = 0.0
    for x in points:
        a = np.array(model.jacobians(x, inputs, p, 0.0)[0])
        if np.isfinite(a).all():
            found = max(found, float(np.abs(np.linalg.eigvals(a)).max(initial=0.0)))
    return found


def steps_and_stick(
    model: Model, p: np.ndarray, points: np.ndarray, sampling: float, fine: float, least: float = 0.0
) -> tuple[float, float]:
    """Steps per second, and the stick speed (rad/s) that they resolve.

    Without dry friction the fastest mode gets ``fine`` steps a radian; the stick speed is then raised until
    the slope of friction at rest is no faster than the steps can follow.
    """
    inputs = np.zeros(len(model.inputs))
    where = model.parameters.index(STICK_SPEED) if STICK_SPEED in model.parameters else None
    p = p.copy()
    if where is not None:
        p[where] = 1e9
    steps = max(2.0 * sampling, least, min(fine * fastest_rate(model, p, points, inputs), 8.0 * sampling))
    steps = float(np.ceil(steps / sampling - 1e-6)) * sampling
    if where is None:
        return steps, np.nan
    rest = np.zeros((1, points.shape[1]))
    stick = 1e-5
    while stick < 1e3:
        p[where] = stick
        if fastest_rate(model, p, rest, inputs) < 2.2 * steps:  # the method is stable up to 2.78
            break
        stick *= 1.5
    return steps, stick
