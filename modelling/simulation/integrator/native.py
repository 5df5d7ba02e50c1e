"""The compiled integrator, called through ctypes."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from ctypes import c_double, c_longlong, c_void_p
from itertools import pairwise

import numpy as np

from modelling.simulation.integrator.c_library import driver, library
from modelling.simulation.integrator.functions import Functions, functions
from modelling.simulation.integrator.task import Task

_COUNTS = [
    "first", "batch", "samples", "states", "coordinates", "inputs", "sensors", "columns", "groups", "constants",
    "parameters", "sz_iw", "sz_w",
]  # fmt: skip
_ARRAYS = ["time", "input", "constant", "start", "input_delay", "group_delay"]
_PATTERNS = tuple("ABPCDQ")
SHARES = 2  # a thread, at least: threads end together though not all shares take as long


class _Pattern(ctypes.Structure):
    _fields_ = [("start", c_void_p), ("row", c_void_p)]


class _Run(ctypes.Structure):
    """The driver's ``Run``, field by field."""

    _fields_ = [
        *((name, c_void_p) for name in ("field", "reading")),
        *((name, c_longlong) for name in _COUNTS),
        ("steps_per_second", c_double),
        *((name, c_void_p) for name in _ARRAYS),
        *((name, c_void_p) for name in ("group", "state", "out", "failed", "selected")),
        *((name, c_void_p) for name in ("start_slope", "input_delay_slope", "sensor_delay_slope")),
        *((name, _Pattern) for name in _PATTERNS),
        ("slope", c_void_p),
    ]  # fmt: skip


def run(task: Task, states: bool = True, readings: bool = True, threads: int = 1) -> tuple[np.ndarray, ...] | None:
    """States (b, t, x), readings (b, t, y), failures (b, 2) and derivatives (b, t, y, s); None without a compiler.

    What is not asked for comes back empty. The rows of a batch may be shared out among ``threads``; no result depends
    on how many.
    """
    done = run_all([task], states, readings, threads)
    return None if done is None else done[0]


def run_all(
    tasks: Sequence[Task], states: bool = True, readings: bool = True, threads: int = 1
) -> list[tuple[np.ndarray, ...]] | None:
    """The same for several tasks of one model, side by side."""
    made = functions(tasks[0].model, tasks[0].columns > 0)
    own = library(made)
    general = driver() if own else None
    if own is None or general is None:
        return None
    code = [ctypes.cast(function, c_void_p) for function in (own.field, own.reading)]
    ends_of_rows = np.cumsum([len(task.p) for task in tasks])
    constants = np.split(made.constants_of(np.concatenate([task.p for task in tasks])), ends_of_rows[:-1])
    prepared = [
        _prepared(task, made, code, constant, states, readings) for task, constant in zip(tasks, constants, strict=True)
    ]
    runs = [r for r, _, _ in prepared]
    if threads == 1:
        ends = [general.run(ctypes.byref(r)) for r in runs]
    else:  # ctypes lets other threads run during a call
        pieces = -(-SHARES * threads // len(tasks))
        shares = [share for r in runs for share in _shares(r, pieces)]
        with ThreadPoolExecutor(threads) as pool:
            ends = list(pool.map(lambda share: general.run(ctypes.byref(share)), shares))
    if any(ends):
        raise MemoryError("the integrator found no memory")
    return [results for _, _, results in prepared]


def _prepared(
    task: Task, made: Functions, code: Sequence[c_void_p], constant: np.ndarray, states: bool, readings: bool
) -> tuple[_Run, list[np.ndarray], tuple[np.ndarray, ...]]:
    """The driver's view of a task, the arrays it points to, which must live until it has run, and those it fills."""
    model, b, t, s = task.model, len(task.p), len(task.time), task.columns
    x, y = len(model.states), len(model.sensors)
    state = np.full((b, t, x) if states else (0,), np.nan)
    out = np.full((b, t, y) if readings else (0,), np.nan)
    slope = np.full((b, t, y, s), np.nan)
    failed = np.full((b, 2), -1, dtype=np.int64)
    r = _Run(
        *code, 0, b, t, x, model.n, len(model.inputs), y, s, task.group_delay.shape[1], constant.shape[1],
        len(model.parameters), max(made.field.sz_iw(), made.reading.sz_iw()),
        max(made.field.sz_w(), made.reading.sz_w()), task.steps_per_second,
    )  # fmt: skip
    reals = {
        "time": task.time, "input": task.inputs, "constant": constant, "start": task.start,
        "input_delay": task.input_delay, "group_delay": task.group_delay, "start_slope": task.start_slope,
        "input_delay_slope": task.input_delay_slope, "sensor_delay_slope": task.sensor_delay_slope,
    }  # fmt: skip
    arrays = {name: np.ascontiguousarray(array, dtype=float) for name, array in reals.items()}
    arrays |= {"group": task.group, "selected": task.selected, "failed": failed, "slope": slope}
    arrays |= {"state": state} if states else {}
    arrays |= {"out": out} if readings else {}
    for name, array in arrays.items():
        setattr(r, name, array.ctypes.data)
    kept = list(arrays.values())
    if s:
        outputs = [made.field.sparsity_out(i) for i in (1, 2, 3)] + [made.reading.sparsity_out(i) for i in (1, 2, 3)]
        for name, sparsity in zip(_PATTERNS, outputs, strict=True):
            start, row = (np.array(part, dtype=np.int64) for part in (sparsity.colind(), sparsity.row()))
            kept += [start, row]
            setattr(r, name, _Pattern(start.ctypes.data, row.ctypes.data))
    return r, kept, (state, out, failed, slope)


def _shares(r: _Run, pieces: int) -> list[_Run]:
    """The same run in pieces, each for some rows of the batch only."""
    out = []
    for first, last in pairwise(np.linspace(0, r.batch, min(pieces, r.batch) + 1).astype(int)):
        share = _Run.from_buffer_copy(r)
        share.first, share.batch = int(first), int(last)
        out.append(share)
    return out
