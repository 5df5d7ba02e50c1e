"""The compiled integrator, called through ctypes."""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from ctypes import c_longlong, c_void_p
from itertools import pairwise

import numpy as np

from modelling.simulation.integrator import rosenbrock
from modelling.simulation.integrator.c_library import driver, library
from modelling.simulation.integrator.functions import Functions, functions
from modelling.simulation.integrator.task import IntegrationTask, Trajectories, band_order

SHARES = 2  # a thread, at least: threads end together though not all shares take as long
INTERRUPTIBLE = 3e7  # operations, some 30 ms: what takes longer runs beside the main thread, which takes signals

_COUNTS = [
    "first_row", "end_row", "samples", "states", "coordinates", "inputs", "sensors", "columns", "groups", "constants",
    "parameters", "sz_iw", "sz_w",
]  # fmt: skip
_ARRAYS = [
    "steps", "time", "input", "constant", "start", "input_delay", "group_delay", "group", "state", "out", "error",
    "failed", "stop",
    "selected", "start_derivative", "input_delay_derivative", "sensor_delay_derivative", "derivative",
]  # fmt: skip
_PATTERNS = tuple("ABPCDQ")


class _Pattern(ctypes.Structure):
    _fields_ = [("start", c_void_p), ("row", c_void_p)]


class _Run(ctypes.Structure):
    """``Run`` of ``c/types.h``, field by field."""

    _fields_ = [
        *((name, c_void_p) for name in ("field", "reading", "jacobian")),
        *((name, c_longlong) for name in _COUNTS),
        *((name, c_void_p) for name in _ARRAYS),
        *((name, _Pattern) for name in _PATTERNS),
        ("method", c_void_p),
        ("place", c_void_p),
        *((name, c_longlong) for name in ("lower", "upper")),
    ]


_METHOD = np.concatenate(
    [part.ravel() for part in (rosenbrock.A, rosenbrock.C, rosenbrock.ALPHA, rosenbrock.GAMMA_SUM)]
    + [np.array([rosenbrock.GAMMA])]
)


def run(
    task: IntegrationTask, states: bool = True, readings: bool = True, threads: int = 1, errors: bool = False
) -> Trajectories | None:
    """Run a task; None without a compiler.

    What is not asked for comes back empty. The rows of a batch may be shared out among ``threads``; no result depends
    on how many. Ctrl-C ends a long run at once.
    """
    done = run_all([task], states, readings, threads, errors)
    return None if done is None else done[0]


def run_all(
    tasks: Sequence[IntegrationTask], states: bool = True, readings: bool = True, threads: int = 1, errors: bool = False
) -> list[Trajectories] | None:
    """The same for several tasks of one model, side by side.

    Raises
    ------
    MemoryError
        If the integrator gets no memory.
    """
    made = functions(tasks[0].model, tasks[0].columns > 0, tasks[0].implicit)
    code = library(made)
    general = driver() if code else None
    if code is None or general is None:
        return None
    stop = ctypes.c_int(0)
    last_rows = np.cumsum([len(task.p) for task in tasks])
    constants = np.split(made.constants_of(np.concatenate([task.p for task in tasks])), last_rows[:-1])
    prepared = [
        _Prepared(task, made, code, constant, stop, states, readings, errors)
        for task, constant in zip(tasks, constants, strict=True)
    ]
    runs = [task.run for task in prepared]
    work = sum(task.step_count for task in tasks) * 4 * made.field.n_instructions()
    if threads > 1:
        pieces = -(-SHARES * threads // len(tasks))
        runs = [share for whole in runs for share in _shares(whole, pieces)]
    if threads > 1 or (work > INTERRUPTIBLE and threading.current_thread() is threading.main_thread()):
        ends = _run_beside(general, runs, stop, threads)
    else:
        ends = [general.run(ctypes.byref(each)) for each in runs]
    if any(ends):
        raise MemoryError("the integrator found no memory")
    return [task.results for task in prepared]


def _run_beside(general: ctypes.CDLL, runs: Sequence[_Run], stop: ctypes.c_int, threads: int) -> list[int]:
    """Run in other threads, which ctypes lets go on during a call; whatever interrupts the wait ends the runs."""
    with ThreadPoolExecutor(threads) as pool:
        futures = [pool.submit(general.run, ctypes.byref(each)) for each in runs]
        try:
            return [future.result() for future in futures]
        except BaseException:
            stop.value = 1
            raise


class _Prepared:
    """The integrator's view ``run`` of a task, the arrays that it points to, and the results that it fills."""

    def __init__(
        self,
        task: IntegrationTask,
        made: Functions,
        code: ctypes.CDLL,
        constant: np.ndarray,
        stop: ctypes.c_int,
        states: bool,
        readings: bool,
        errors: bool,
    ):  # what a run consists of
        model, b, t, s = task.model, len(task.p), len(task.time), task.columns
        x, y = len(model.states), len(model.sensors)
        self.results = Trajectories(
            np.full((b, t, x) if states else (0,), np.nan),
            np.full((b, t, y) if readings else (0,), np.nan),
            np.full((b, 2), -1, dtype=np.int64),
            np.full((b, t, y, s), np.nan),
            np.full((b, t - 1, y + x - model.n) if errors else (0,), np.nan),
        )
        pointers = [ctypes.cast(getattr(code, function.name()), c_void_p) for function in made.all]
        self.run = _Run(
            *pointers, *[None] * (3 - len(pointers)), 0, b, t, x, model.n, len(model.inputs), y, s,
            task.group_delay.shape[1], constant.shape[1], len(model.parameters),
            max(function.sz_iw() for function in made.all), max(function.sz_w() for function in made.all),
            stop=ctypes.addressof(stop),
        )  # fmt: skip
        self._kept: list = [stop]
        reals = {
            "time": task.time, "input": task.inputs, "constant": constant, "start": task.start,
            "input_delay": task.input_delay, "group_delay": task.group_delay,
            "start_derivative": task.start_derivative, "input_delay_derivative": task.input_delay_derivative,
            "sensor_delay_derivative": task.sensor_delay_derivative,
        }  # fmt: skip
        for name, array in reals.items():
            self._point(name, np.ascontiguousarray(array, dtype=float))
        self._point("steps", task.steps)
        self._point("group", task.group)
        self._point("selected", task.selected)
        self._point("failed", self.results.failed)
        self._point("derivative", self.results.derivatives)
        if states:
            self._point("state", self.results.states)
        if errors:
            self._point("error", self.results.errors)
        if readings:
            self._point("out", self.results.readings)
        if s:
            outputs = [function.sparsity_out(i) for function in (made.field, made.reading) for i in (1, 2, 3)]
            self._patterns(dict(zip(_PATTERNS, outputs, strict=True)))
        if made.jacobian is not None:
            order = band_order(made.jacobian)
            self._patterns({"A": made.jacobian.sparsity_out(0), "B": made.jacobian.sparsity_out(1)})
            self._point("place", order.place)
            self._point("method", _METHOD)
            self.run.lower, self.run.upper = order.lower, order.upper

    def _point(self, name: str, array: np.ndarray) -> None:
        self._kept.append(array)
        setattr(self.run, name, array.ctypes.data)

    def _patterns(self, patterns: dict) -> None:
        for name, sparsity in patterns.items():
            start, row = (np.array(part, dtype=np.int64) for part in (sparsity.colind(), sparsity.row()))
            self._kept += [start, row]
            setattr(self.run, name, _Pattern(start.ctypes.data, row.ctypes.data))


def _shares(run: _Run, pieces: int) -> list[_Run]:
    """The same run in pieces, each for some rows of the batch only."""
    out = []
    for first, last in pairwise(np.linspace(0, run.end_row, min(pieces, run.end_row) + 1).astype(int)):
        share = _Run.from_buffer_copy(run)
        share.first_row, share.end_row = int(first), int(last)
        out.append(share)
    return out
