"""The same integration without a compiler, in CasADi's virtual machine."""

from __future__ import annotations

import functools

import casadi as ca
import numpy as np

from modelling.simulation.integrator.functions import Functions, functions
from modelling.simulation.integrator.task import Task

CHUNK = 256  # steps a call


def run(task: Task, states: bool = True, readings: bool = True) -> tuple[np.ndarray, ...]:
    """As :func:`modelling.simulation.integrator.native.run`, same result to rounding."""
    made = functions(task.model, task.columns > 0)
    rows = [_row(task, made, made.constants_of(task.p[b : b + 1])[0], b, states, readings) for b in range(len(task.p))]
    return tuple(np.stack(part) for part in zip(*rows, strict=True))


def _row(task: Task, made: Functions, c: np.ndarray, b: int, states: bool, readings: bool) -> tuple[np.ndarray, ...]:
    s, model = task.columns, task.model
    x, t = len(model.states), len(task.time)
    first, nodes = mesh(task.time, task.steps_per_second)
    h = np.diff(nodes)
    middle = nodes[:-1] + h / 2
    selection = np.zeros((len(model.parameters), s))
    for column, j in enumerate(task.selected):
        if j >= 0:
            selection[j, column] = 1.0
    looked = [_look(task, b, at) for at in (nodes[:-1], middle, nodes[1:])]
    steps = len(h)
    drive = np.zeros((1 + 6 * len(model.inputs), -(-steps // CHUNK) * CHUNK))  # idle steps at the end: h = 0
    drive[:, :steps] = np.vstack([h, *(part.T for pair in looked for part in pair)])
    fixed = np.concatenate([c, selection.ravel(order="F"), task.input_delay_slope.ravel(order="F")])
    X = np.empty((x * (1 + s), drive.shape[1] + 1))
    X[:, 0] = np.concatenate([task.start[b], task.start_slope.ravel(order="F")])
    chunk = _chunk(made, s)
    for begin in range(0, drive.shape[1], CHUNK):
        X[:, begin + 1 : begin + CHUNK + 1] = chunk(X[:, begin], drive[:, begin : begin + CHUNK], fixed).full()
    X = X[:, : steps + 1]
    samples = X[:, first]
    bad = np.argwhere(~np.isfinite(samples.T))
    failed = np.full(2, -1, dtype=np.int64)
    if len(bad):
        failed[:] = bad[0][0], bad[0][1] if bad[0][1] < x else (bad[0][1] - x) % x
    y, slope = _readings(task, made, c, b, selection, nodes, X) if readings else (np.empty(0), np.empty((t, 0, s)))
    if len(bad):
        samples = samples.copy()
        samples[:, bad[0][0] :] = np.nan
        y[bad[0][0] :] = np.nan
    return (samples[:x].T.copy() if states else np.empty(0)), y, failed, slope


def mesh(time: np.ndarray, steps_per_second: float) -> tuple[np.ndarray, np.ndarray]:
    """Which node every sample is (t,), and the times of all nodes."""
    span = np.diff(time)
    count = np.maximum(1, np.ceil(span * steps_per_second - 1e-9)).astype(np.int64)
    first = np.concatenate([[0], np.cumsum(count)])
    inner = np.arange(first[-1]) - np.repeat(first[:-1], count)
    nodes = np.append(np.repeat(time[:-1], count) + inner * np.repeat(span / count, count), time[-1])
    return first, nodes


def _look(task: Task, b: int, at: np.ndarray, delay: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Inputs and their slopes (·, u) at times: linear between samples, held outside the recording."""
    time, values = task.time, task.inputs
    u, du = np.empty((len(at), values.shape[1])), np.zeros((len(at), values.shape[1]))
    for i in range(values.shape[1]):
        when = at - delay - task.input_delay[b, i]
        u[:, i] = np.interp(when, time, values[:, i])
        inside = (when > time[0]) & (when < time[-1])
        j = np.clip(np.searchsorted(time, when, side="left") - 1, 0, len(time) - 2)
        du[:, i] = np.where(inside, (values[j + 1, i] - values[j, i]) / (time[j + 1] - time[j]), 0.0)
    return u, du


def _flow(made: Functions, X: ca.SX, u: ca.SX, du: ca.SX, c: ca.SX, selection: ca.SX, later: ca.SX) -> ca.SX:
    """Ẋ of X = [x, S by columns]."""
    x, s = made.field.size1_in(0), selection.shape[1]
    if not s:
        return made.field(X, u, c)
    xdot, A, B, P = made.field(X[:x], u, c)
    S = ca.reshape(X[x:], x, s)
    return ca.vertcat(xdot, ca.vec(A @ S + P @ selection - B @ (ca.repmat(du, 1, s) * later)))


@functools.lru_cache(maxsize=128)
def _chunk(made: Functions, s: int) -> ca.Function:
    """(X, drive, fixed) → X after each of ``CHUNK`` steps.

    A column of ``drive`` is h and, at the beginning, the middle and the end of the step, the inputs and their slopes;
    ``fixed`` is c, selection and input_delay_slope.
    """
    x, n, k = made.field.size1_in(0), made.field.size1_in(1), made.field.size1_in(2)
    p = made.constants.size1_in(0)
    X, drive, fixed = ca.SX.sym("X", x * (1 + s)), ca.SX.sym("drive", 1 + 6 * n), ca.SX.sym("fixed", k + p * s + n * s)
    h, *u = ca.vertsplit(drive, [0, *range(1, 1 + 6 * n, n), 1 + 6 * n]) if n else (drive, *([ca.SX(0, 1)] * 6))
    c, selection, later = ca.vertsplit(fixed, [0, k, k + p * s, k + p * s + n * s])
    selection, later = ca.reshape(selection, p, s), ca.reshape(later, n, s)

    def flow(at: ca.SX, stage: int) -> ca.SX:
        return _flow(made, at, u[2 * stage], u[2 * stage + 1], c, selection, later)

    k1 = flow(X, 0)
    k2 = flow(X + h / 2 * k1, 1)
    k3 = flow(X + h / 2 * k2, 1)
    k4 = flow(X + h * k3, 2)
    step = ca.Function("step", [X, drive, fixed], [ca.cse(X + h / 6 * (k1 + 2 * (k2 + k3) + k4))])
    begin, driven, same = (
        ca.MX.sym("X", X.shape[0]),
        ca.MX.sym("drive", 1 + 6 * n, CHUNK),
        ca.MX.sym("f", fixed.shape[0]),
    )
    moved = step.mapaccum("steps", CHUNK)(begin, driven, ca.repmat(same, 1, CHUNK))
    return ca.Function("chunk", [begin, driven, same], [moved])


@functools.lru_cache(maxsize=128)
def _reader(made: Functions, s: int) -> ca.Function:
    """(X, Ẋ, u, du, c, t, selection, input_delay_slope) → y, its derivatives (y·s), its time derivative."""
    x, n, k = made.field.size1_in(0), made.field.size1_in(1), made.field.size1_in(2)
    X, dX, u, du = (
        ca.SX.sym(name, size) for name, size in (("X", x * (1 + s)), ("dX", x * (1 + s)), ("u", n), ("du", n))
    )
    c, t, p = ca.SX.sym("c", k), ca.SX.sym("t"), made.constants.size1_in(0)
    selection, later = ca.SX.sym("selection", p, s), ca.SX.sym("later", n, s)
    outputs = made.reading(X[:x], u, c, t)
    if s:
        y, C, D, Q = outputs
        slope = C @ ca.reshape(X[x:], x, s) + Q @ selection - D @ (ca.repmat(du, 1, s) * later)
        rate = C @ dX[:x] + D @ du
    else:
        y, slope, rate = outputs, ca.SX(made.reading.size1_out(0), 0), ca.SX(made.reading.size1_out(0), 1)
    return ca.Function(
        "reader", [X, dX, u, du, c, t, selection, later], [y, ca.vec(ca.densify(slope)), ca.densify(rate)]
    )


@functools.lru_cache(maxsize=128)
def _flows(made: Functions, s: int) -> ca.Function:
    x, n, k = made.field.size1_in(0), made.field.size1_in(1), made.field.size1_in(2)
    p = made.constants.size1_in(0)
    X, u, du, c = (ca.SX.sym(name, size) for name, size in (("X", x * (1 + s)), ("u", n), ("du", n), ("c", k)))
    selection, later = ca.SX.sym("selection", p, s), ca.SX.sym("later", n, s)
    return ca.Function("flow", [X, u, du, c, selection, later], [_flow(made, X, u, du, c, selection, later)])


def _readings(
    task: Task, made: Functions, c: np.ndarray, b: int, selection: np.ndarray, nodes: np.ndarray, X: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    s, t, m = task.columns, len(task.time), len(task.model.sensors)
    y, slope = np.empty((t, m)), np.empty((t, m, s))
    for g, delay in enumerate(task.group_delay[b]):
        mine = task.group == g
        if not mine.any():
            continue
        at = task.time - delay
        Z, dZ = _state_at(task, made, c, b, selection, nodes, X, at)
        u, du = _look(task, b, at)
        parts = _reader(made, s)(
            Z, dZ, u.T, du.T, c, task.time[None], np.tile(selection, (1, t)), np.tile(task.input_delay_slope, (1, t))
        )
        values, slopes, rates = (np.array(part) for part in parts)
        y[:, mine] = values.T[:, mine]
        slopes = slopes.reshape(s, m, t).transpose(2, 1, 0)
        if g:
            slopes = slopes - rates.T[:, :, None] * task.sensor_delay_slope
        slope[:, mine] = slopes[:, mine]
    return y, slope


def _state_at(
    task: Task,
    made: Functions,
    c: np.ndarray,
    b: int,
    selection: np.ndarray,
    nodes: np.ndarray,
    X: np.ndarray,
    at: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """X and Ẋ at times: nodes exactly, cubic Hermite between them, moving on as at the start before it."""
    s, n, x = task.columns, task.model.n, len(task.model.states)
    j = np.clip(np.searchsorted(nodes, at, side="left") - 1, 0, len(nodes) - 2)
    h = nodes[j + 1] - nodes[j]
    z = (at - nodes[j]) / h
    if np.array_equal(nodes[j[1:] + 1], at[1:]) and at[0] == nodes[0]:  # no delay
        first = np.append(0, j[1:] + 1)
        return X[:, first], np.zeros((len(X), len(at)))

    def flow(node: np.ndarray) -> np.ndarray:
        u, du = _look(task, b, nodes[node])
        count = len(node)
        fixed = (c, np.tile(selection, (1, count)), np.tile(task.input_delay_slope, (1, count)))
        return np.array(_flows(made, s)(X[:, node], u.T, du.T, *fixed))

    low, high, dlow, dhigh = X[:, j], X[:, j + 1], flow(j), flow(j + 1)
    Z = (
        (1 + 2 * z) * (1 - z) ** 2 * low
        + h * z * (1 - z) ** 2 * dlow
        + z**2 * (3 - 2 * z) * high
        + h * z**2 * (z - 1) * dhigh
    )
    dZ = 6 * z * (z - 1) / h * (low - high) + (1 - z) * (1 - 3 * z) * dlow + z * (3 * z - 2) * dhigh
    early = np.flatnonzero(at <= nodes[0])
    Z[:, early], dZ[:, early] = X[:, :1], 0.0
    for block in range(1 + s):
        q, v = slice(block * x, block * x + n), slice(block * x + n, block * x + 2 * n)
        Z[q, early] -= (nodes[0] - at[early]) * X[v, :1]
    dZ[:n, early] = X[n : 2 * n, :1]
    return Z, dZ
