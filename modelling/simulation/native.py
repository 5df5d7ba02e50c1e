"""The compiled integrator, called through ctypes."""

from __future__ import annotations

import ctypes
from concurrent.futures import ThreadPoolExecutor
from ctypes import POINTER, c_double, c_longlong
from itertools import pairwise

import numpy as np

from modelling.simulation.build import driver, library
from modelling.simulation.functions import functions
from modelling.simulation.task import Task

_REAL, _WHOLE = POINTER(c_double), POINTER(c_longlong)
_COUNTS = [
    "first", "batch", "samples", "states", "coordinates", "inputs", "sensors", "columns", "groups", "constants",
    "parameters", "sz_iw", "sz_w",
]  # fmt: skip
_ARRAYS = ["time", "input", "constant", "start", "input_delay", "group_delay"]
_PATTERNS = tuple("ABPCDQ")


class _Pattern(ctypes.Structure):
    _fields_ = [("start", _WHOLE), ("row", _WHOLE)]


class _Run(ctypes.Structure):
    """The driver's ``Run``, field by field."""

    _fields_ = [
        *((name, ctypes.c_void_p) for name in ("field", "reading")),
        *((name, c_longlong) for name in _COUNTS),
        ("steps_per_second", c_double),
        *((name, _REAL) for name in _ARRAYS),
        ("group", _WHOLE), ("state", _REAL), ("out", _REAL), ("failed", _WHOLE), ("selected", _WHOLE),
        *((name, _REAL) for name in ("start_slope", "input_delay_slope", "sensor_delay_slope")),
        *((name, _Pattern) for name in _PATTERNS),
        ("slope", _REAL),
    ]  # fmt: skip


def run(task: Task, states: bool = True, readings: bool = True, threads: int = 1) -> tuple[np.ndarray, ...] | None:
    """States (b, t, x), readings (b, t, y), failures (b, 2) and derivatives (b, t, y, s); None without a compiler.

    What is not asked for comes back empty. The rows of a batch may be shared out among ``threads``; no result depends
    on how many.
    """
    made = functions(task.model, task.columns > 0)
    own = library(made)
    general = driver() if own else None
    if own is None or general is None:
        return None
    model, b, t, s = task.model, len(task.p), len(task.time), task.columns
    x, y = len(model.states), len(model.sensors)
    state = np.full((b, t, x) if states else (0,), np.nan)
    out = np.full((b, t, y) if readings else (0,), np.nan)
    slope = np.full((b, t, y, s), np.nan)
    failed = np.full((b, 2), -1, dtype=np.int64)
    constant = made.constants_of(task.p)
    counts = {
        "first": 0, "batch": b, "samples": t, "states": x, "coordinates": model.n, "inputs": len(model.inputs),
        "sensors": y, "columns": s, "groups": task.group_delay.shape[1], "constants": constant.shape[1],
        "parameters": len(model.parameters),
        "sz_iw": max(made.field.sz_iw(), made.reading.sz_iw()), "sz_w": max(made.field.sz_w(), made.reading.sz_w()),
    }  # fmt: skip
    r = _Run(**counts, steps_per_second=task.steps_per_second)
    r.field, r.reading = (ctypes.cast(function, ctypes.c_void_p) for function in (own.field, own.reading))
    kept = []  # what ctypes points to must live until the call returns
    reals = {
        "time": task.time, "input": task.inputs, "constant": constant, "start": task.start,
        "input_delay": task.input_delay, "group_delay": task.group_delay, "start_slope": task.start_slope,
        "input_delay_slope": task.input_delay_slope, "sensor_delay_slope": task.sensor_delay_slope,
    }  # fmt: skip
    for name, array in reals.items():
        kept.append(np.ascontiguousarray(array, dtype=float))
        setattr(r, name, kept[-1].ctypes.data_as(_REAL))
    r.group, r.selected = task.group.ctypes.data_as(_WHOLE), task.selected.ctypes.data_as(_WHOLE)
    r.failed, r.slope = failed.ctypes.data_as(_WHOLE), slope.ctypes.data_as(_REAL)
    r.state = state.ctypes.data_as(_REAL) if states else None
    r.out = out.ctypes.data_as(_REAL) if readings else None
    if s:
        outputs = [made.field.sparsity_out(i) for i in (1, 2, 3)] + [made.reading.sparsity_out(i) for i in (1, 2, 3)]
        for name, sparsity in zip(_PATTERNS, outputs, strict=True):
            start, row = (np.array(part, dtype=np.int64) for part in (sparsity.colind(), sparsity.row()))
            kept += [start, row]
            setattr(r, name, _Pattern(start.ctypes.data_as(_WHOLE), row.ctypes.data_as(_WHOLE)))
    edges = np.linspace(0, b, max(1, min(threads, b)) + 1).astype(int)
    shares = [_rows(r, int(first), int(last)) for first, last in pairwise(edges)]
    if len(shares) == 1:
        ends = [general.run(ctypes.byref(r))]
    else:  # ctypes lets other threads run during a call
        with ThreadPoolExecutor(len(shares)) as pool:
            ends = list(pool.map(lambda share: general.run(ctypes.byref(share)), shares))
    if any(ends):
        raise MemoryError("the integrator found no memory")
    return state, out, failed, slope


def _rows(r: _Run, first: int, last: int) -> _Run:
    """The same run for some rows of the batch only."""
    share = _Run.from_buffer_copy(r)
    share.first, share.batch = first, last
    return share
