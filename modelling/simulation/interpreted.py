"""The same integration without a compiler, in CasADi's virtual machine: what :mod:`native` does, step by step."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass, fields

import casadi as ca
import numpy as np
from scipy.linalg import lapack

from modelling.simulation.task import (
    ALPHA,
    GAMMA,
    GAMMA_SUM,
    STAGES,
    A,
    C,
    Functions,
    IntegrationTask,
    Trajectories,
    functions,
)

# --- Implicit steps without a compiler: the method of :mod:`rosenbrock` in NumPy around CasADi's virtual machine.

InputsAt = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


class _Evaluator:
    """A CasADi function called through its buffers, ten times faster than with conversions; results are dense."""

    def __init__(self, function: ca.Function, *arguments: np.ndarray):
        self._buffer, self._trigger = function.buffer()
        for i, argument in enumerate(arguments):
            self._buffer.set_arg(i, memoryview(argument))  # type: ignore[call-arg, arg-type]
        self.results = []
        for i in range(function.n_out()):
            self.results.append(np.zeros(function.size_out(i)[::-1]))  # CasADi's columns are NumPy's rows
            self._buffer.set_res(i, memoryview(self.results[-1]))  # type: ignore[call-arg, arg-type]

    def __call__(self) -> list[np.ndarray]:
        self._trigger()
        return self.results


def nodes(
    made: Functions, constants: np.ndarray, start: np.ndarray, time: np.ndarray, inputs_at: InputsAt
) -> tuple[np.ndarray, np.ndarray]:
    """States (x, k) at the ends of all steps, and the embedded errors (x, k-1) of the steps.

    Parameters
    ----------
    constants, start : ndarray (c,), (x,)
    time : ndarray (k,)
        s, of the nodes.
    inputs_at : callable
        Times → inputs and their time derivatives (·, u).
    """
    assert made.jacobian is not None
    x, u = start.copy(), np.zeros(made.field.size1_in(1))
    constants = np.ascontiguousarray(constants, float)
    rate = _Evaluator(made.field, x, u, constants)
    A_, B_ = (ca.densify(part) for part in made.jacobian(*(made.field.sx_in())))
    jacobian = _Evaluator(ca.Function("dense", made.field.sx_in(), [A_, B_]), x, u, constants)
    h = np.diff(time)
    inputs = np.stack([inputs_at(time[:-1] + alpha * h)[0] for alpha in ALPHA[:-1]] + [inputs_at(time[1:])[0]])
    drive = inputs_at(time[:-1] + h / 2)[1]
    out = np.full((len(start), len(time)), np.nan)
    errors = np.full((len(start), len(h)), np.nan)
    out[:, 0] = start
    eye = np.eye(len(start))
    known, known_h, factors, pivots = np.full(eye.shape, np.nan), math.nan, eye, np.zeros(len(start), np.int32)
    for k in range(len(h)):
        x[:], u[:] = out[:, k], inputs[0, k]
        J, by_input = jacobian()
        if not (abs(h[k] - known_h) <= 1e-9 * h[k] and np.array_equal(J, known)):
            known, known_h = J.copy(), h[k]
            factors, pivots, _ = lapack.dgetrf(eye / (GAMMA * h[k]) - J.T)
        forced = h[k] * drive[k] @ by_input
        U = np.zeros((STAGES, len(start)))
        for i in range(STAGES):
            x[:], u[:] = out[:, k] + A[i, :i] @ U[:i], inputs[i, k]
            right = rate()[0][0] + C[i, :i] @ U[:i] / h[k] + GAMMA_SUM[i] * forced
            U[i] = lapack.dgetrs(factors, pivots, right)[0]
        out[:, k + 1], errors[:, k] = x + U[-1], U[-1]
        if not np.isfinite(out[:, k + 1]).all():
            break
    return out, errors


# --- Virtual

CHUNK = 256  # steps a call


@dataclass(frozen=True)
class _Row:
    """One row of a batch: its constants (c,), and the columns' parameters as a matrix (p, s)."""

    task: IntegrationTask
    made: Functions
    b: int
    constants: np.ndarray
    selection: np.ndarray


@dataclass(frozen=True)
class _Nodes:
    """The ends of all steps: times (k,), augmented states (x·(1 + s), k) with the sensitivities by columns.

    ``errors`` (x, k-1) are the local errors of the steps; explicit ones are right in pairs only (see ``c/errors.c``).
    """

    time: np.ndarray
    states: np.ndarray
    errors: np.ndarray


def run(task: IntegrationTask, states: bool = True, readings: bool = True, errors: bool = False) -> Trajectories:
    """As :func:`modelling.simulation.compiled.run`, same result to rounding."""
    made = functions(task.model, task.columns > 0, task.implicit)
    selection = np.zeros((len(task.model.parameters), task.columns))
    for column, j in enumerate(task.selected):
        if j >= 0:
            selection[j, column] = 1.0
    constants = made.constants_of(task.p)
    rows = [
        _run_row(_Row(task, made, b, constants[b], selection), states, readings, errors) for b in range(len(task.p))
    ]
    return Trajectories(*(np.stack([getattr(row, part.name) for row in rows]) for part in fields(Trajectories)))


def _run_row(row: _Row, states: bool, readings: bool, errors: bool) -> Trajectories:
    task = row.task
    x, t, s = len(task.model.states), len(task.time), task.columns
    first, node_times = mesh(task.time, task.steps)
    with np.errstate(over="ignore", invalid="ignore"):  # a motion that runs away is told by `failed`
        nodes = _implicit_nodes(row, node_times) if task.implicit else _explicit_nodes(row, node_times)
        y, derivatives = _readings(row, nodes) if readings else (np.empty(0), np.empty((t, 0, s)))
    samples = nodes.states[:, first]
    bad = np.argwhere(~np.isfinite(samples.T))
    failed = np.full(2, -1, dtype=np.int64)
    if len(bad):
        failed[:] = bad[0][0], bad[0][1] % x  # the state, or that of a sensitivity
        samples = samples.copy()
        samples[:, bad[0][0] :] = np.nan
        y[bad[0][0] :] = np.nan
    by_interval = np.empty(0)
    if errors:
        undelayed = readings and task.group_delay.shape[1] == 1
        by_interval = _errors(
            row, samples[:x], np.add.reduceat(nodes.errors, first[:-1], axis=1), y if undelayed else None
        )
    return Trajectories(samples[:x].T.copy() if states else np.empty(0), y, failed, derivatives, by_interval)


def _errors(row: _Row, states: np.ndarray, errors: np.ndarray, known: np.ndarray | None) -> np.ndarray:
    """Errors (t-1, y + x-n) of readings and states behind the angles, from states (x, t) and their errors (x, t-1).

    ``known`` (t, y) are the readings of the states, if at hand.
    """
    task, time = row.task, row.task.time[1:]
    u = _inputs_at(task, row.b, time)[0].T
    reading = _reading_of_many(row.made.reading, len(time))

    def readings(at: np.ndarray) -> np.ndarray:
        outputs = reading(at, u, row.constants, time[None])
        return (outputs[0] if row.made.parametric else outputs).full()

    of_readings = (readings(states[:, 1:]) if known is None else known[1:].T) - readings(states[:, 1:] - errors)
    return np.vstack([of_readings.reshape(-1, len(time)), errors[task.model.n :]]).T


@functools.lru_cache(maxsize=16)
def _reading_of_many(reading: ca.Function, points: int) -> ca.Function:
    """(x, u, c, t) → y at so many points, with the same c."""
    return reading.map("reading_of_many", "serial", points, [2], [])


def mesh(time: np.ndarray, count: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which node every sample is (t,), and the times of all nodes, of so many steps between the samples (t-1,)."""
    span = np.diff(time)
    first = np.concatenate([[0], np.cumsum(count)])
    inner = np.arange(first[-1]) - np.repeat(first[:-1], count)
    nodes = np.append(np.repeat(time[:-1], count) + inner * np.repeat(span / count, count), time[-1])
    return first, nodes


def _inputs_at(task: IntegrationTask, b: int, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inputs and their time derivatives (·, u) at times: linear between samples, held outside the recording."""
    time, values = task.time, task.inputs
    u, du = np.empty((len(at), values.shape[1])), np.zeros((len(at), values.shape[1]))
    for i in range(values.shape[1]):
        when = at - task.input_delay[b, i]
        u[:, i] = np.interp(when, time, values[:, i])
        inside = (when > time[0]) & (when < time[-1])
        j = np.clip(np.searchsorted(time, when, side="left") - 1, 0, len(time) - 2)
        du[:, i] = np.where(inside, (values[j + 1, i] - values[j, i]) / (time[j + 1] - time[j]), 0.0)
    return u, du


def _explicit_nodes(row: _Row, node_times: np.ndarray) -> _Nodes:
    task, s = row.task, row.task.columns
    x, steps = len(task.model.states), len(node_times) - 1
    h = np.diff(node_times)
    stages = [_inputs_at(task, row.b, at) for at in (node_times[:-1] + h / 2, node_times[1:])]
    drive = np.zeros((1 + 4 * len(task.model.inputs), -(-steps // CHUNK) * CHUNK))  # idle steps at the end: h = 0
    drive[:, :steps] = np.vstack([h, *(part.T for pair in stages for part in pair)])
    matrices = (row.selection, task.input_delay_derivative)
    fixed = np.concatenate([row.constants, *(part.ravel(order="F") for part in matrices)])
    X, rates = (np.empty((drive.shape[1] + 1, x * (1 + s))) for _ in range(2))  # CasADi's columns are NumPy's rows
    X[0] = np.concatenate([task.start[row.b], task.start_derivative.ravel(order="F")])
    u, du = _inputs_at(task, row.b, node_times[:1])
    rates[0] = np.array(_rates(row.made, s)(X[0], u[0], du[0], row.constants, *matrices)).ravel()
    drive = np.ascontiguousarray(drive.T)
    buffer, evaluate = _chunk(row.made, s).buffer()  # without conversions, which take as long as the steps
    for begin in range(0, len(drive), CHUNK):
        driven, after = drive[begin : begin + CHUNK], slice(begin + 1, begin + CHUNK + 1)
        for i, array in enumerate((X[begin], rates[begin], driven, fixed)):
            buffer.set_arg(i, memoryview(array))  # type: ignore[call-arg, arg-type]
        for i, array in enumerate((X[after], rates[after])):
            buffer.set_res(i, memoryview(array))  # type: ignore[call-arg, arg-type]
        evaluate()
    at, rate = X[: steps + 1, :x].T, rates[: steps + 1, :x].T
    first = (np.arange(steps) - np.repeat(np.cumsum(task.steps) - task.steps, task.steps)) % 2 == 0
    begun = -at[:, :-1] - h / 3 * (rate[:, :-1] + 4 * rate[:, 1:])
    return _Nodes(node_times, X[: steps + 1].T, np.where(first, begun, at[:, 1:] - h / 3 * rate[:, 1:]))


def _implicit_nodes(row: _Row, node_times: np.ndarray) -> _Nodes:
    def inputs_at(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return _inputs_at(row.task, row.b, at)

    done = nodes(row.made, row.constants, row.task.start[row.b], node_times, inputs_at)
    return _Nodes(node_times, *done)


# more than six parameters: all that the augmented rate depends on
def _rate(made: Functions, X: ca.SX, u: ca.SX, du: ca.SX, c: ca.SX, selection: ca.SX, by_delay: ca.SX) -> ca.SX:
    """Ẋ of X = [x, S by columns]; ``by_delay`` (u, s) are the derivatives of the input delays by the columns."""
    x, s = made.field.size1_in(0), selection.shape[1]
    if not s:
        return made.field(X, u, c)
    xdot, A, B, P = made.field(X[:x], u, c)
    S = ca.reshape(X[x:], x, s)
    return ca.vertcat(xdot, ca.vec(A @ S + P @ selection - B @ (ca.repmat(du, 1, s) * by_delay)))


@functools.lru_cache(maxsize=128)
def _chunk(made: Functions, s: int) -> ca.Function:
    """(X, Ẋ, drive, fixed) → X and Ẋ after each of ``CHUNK`` steps.

    A column of ``drive`` is h and, in the middle and at the end of the step, the inputs and their derivatives;
    ``fixed`` is c, selection and input_delay_derivative.
    """
    x, n, k = made.field.size1_in(0), made.field.size1_in(1), made.field.size1_in(2)
    p = made.constants.size1_in(0)
    X, k1 = ca.SX.sym("X", x * (1 + s)), ca.SX.sym("dX", x * (1 + s))
    drive, fixed = ca.SX.sym("drive", 1 + 4 * n), ca.SX.sym("fixed", k + p * s + n * s)
    h, *u = ca.vertsplit(drive, [0, *range(1, 1 + 4 * n, n), 1 + 4 * n]) if n else (drive, *([ca.SX(0, 1)] * 4))
    c, selection, by_delay = ca.vertsplit(fixed, [0, k, k + p * s, k + p * s + n * s])
    selection, by_delay = ca.reshape(selection, p, s), ca.reshape(by_delay, n, s)

    def rate(at: ca.SX, stage: int) -> ca.SX:
        return _rate(made, at, u[2 * stage], u[2 * stage + 1], c, selection, by_delay)

    k2 = rate(X + h / 2 * k1, 0)
    k3 = rate(X + h / 2 * k2, 0)
    k4 = rate(X + h * k3, 1)
    moved = X + h / 6 * (k1 + 2 * (k2 + k3) + k4)
    step = ca.Function("step", [X, k1, drive, fixed], ca.cse([ca.densify(moved), ca.densify(rate(moved, 1))]))
    begin, begin_rate = (ca.MX.sym(name, X.shape[0]) for name in ("X", "dX"))
    driven, same = ca.MX.sym("drive", 1 + 4 * n, CHUNK), ca.MX.sym("f", fixed.shape[0])
    after = step.mapaccum("steps", CHUNK, 2)(begin, begin_rate, driven, ca.repmat(same, 1, CHUNK))
    return ca.Function("chunk", [begin, begin_rate, driven, same], list(after))


@functools.lru_cache(maxsize=128)
def _reader(made: Functions, s: int) -> ca.Function:
    """(X, Ẋ, u, du, c, t, selection, by_delay) → y, its derivatives (y·s), its time derivative."""
    x, n, k = made.field.size1_in(0), made.field.size1_in(1), made.field.size1_in(2)
    X, dX, u, du = (
        ca.SX.sym(name, size) for name, size in (("X", x * (1 + s)), ("dX", x * (1 + s)), ("u", n), ("du", n))
    )
    c, t, p = ca.SX.sym("c", k), ca.SX.sym("t"), made.constants.size1_in(0)
    selection, by_delay = ca.SX.sym("selection", p, s), ca.SX.sym("by_delay", n, s)
    outputs = made.reading(X[:x], u, c, t)
    if s:
        y, C, D, Q = outputs
        derivative = C @ ca.reshape(X[x:], x, s) + Q @ selection - D @ (ca.repmat(du, 1, s) * by_delay)
        rate = C @ dX[:x] + D @ du
    else:
        y, derivative, rate = outputs, ca.SX(made.reading.size1_out(0), 0), ca.SX(made.reading.size1_out(0), 1)
    return ca.Function(
        "reader", [X, dX, u, du, c, t, selection, by_delay], [y, ca.vec(ca.densify(derivative)), ca.densify(rate)]
    )


@functools.lru_cache(maxsize=128)
def _rates(made: Functions, s: int) -> ca.Function:
    """(X, u, du, c, selection, by_delay) → Ẋ."""
    x, n, k = made.field.size1_in(0), made.field.size1_in(1), made.field.size1_in(2)
    p = made.constants.size1_in(0)
    X, u, du, c = (ca.SX.sym(name, size) for name, size in (("X", x * (1 + s)), ("u", n), ("du", n), ("c", k)))
    selection, by_delay = ca.SX.sym("selection", p, s), ca.SX.sym("by_delay", n, s)
    rate = _rate(made, X, u, du, c, selection, by_delay)
    return ca.Function("rates", [X, u, du, c, selection, by_delay], [rate])


def _readings(row: _Row, nodes: _Nodes) -> tuple[np.ndarray, np.ndarray]:
    """Readings (t, y) and their derivatives (t, y, s)."""
    task, s = row.task, row.task.columns
    t, m = len(task.time), len(task.model.sensors)
    y, derivatives = np.empty((t, m)), np.empty((t, m, s))
    for g, delay in enumerate(task.group_delay[row.b]):
        members = task.group == g
        if not members.any():
            continue
        at = task.time - delay
        X, dX = _states_at(row, nodes, at)
        u, du = _inputs_at(task, row.b, at)
        values, by_columns, rates = (
            part.full()
            for part in _reader(row.made, s)(
                X, dX, u.T, du.T, row.constants, task.time[None], np.tile(row.selection, (1, t)),
                np.tile(task.input_delay_derivative, (1, t)),
            )
        )  # fmt: skip
        y[:, members] = values.T[:, members]
        by_columns = by_columns.reshape(s, m, t).transpose(2, 1, 0)
        if g:  # a longer delay reads earlier
            by_columns = by_columns - rates.T[:, :, None] * task.sensor_delay_derivative
        derivatives[:, members] = by_columns[:, members]
    return y, derivatives


def _states_at(row: _Row, nodes: _Nodes, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """X and Ẋ at times: nodes exactly, cubic Hermite between them, outside them moving as at the nearest."""
    task, s, X, time = row.task, row.task.columns, nodes.states, nodes.time
    n, x = task.model.n, len(task.model.states)
    j = np.clip(np.searchsorted(time, at, side="left") - 1, 0, len(time) - 2)
    h = time[j + 1] - time[j]
    z = (at - time[j]) / h
    if np.array_equal(time[j[1:] + 1], at[1:]) and at[0] == time[0]:  # no delay
        first = np.append(0, j[1:] + 1)
        return X[:, first], np.zeros((len(X), len(at)))

    def rate(node: np.ndarray) -> np.ndarray:
        u, du = _inputs_at(task, row.b, time[node])
        count = len(node)
        fixed = (row.constants, np.tile(row.selection, (1, count)), np.tile(task.input_delay_derivative, (1, count)))
        return np.array(_rates(row.made, s)(X[:, node], u.T, du.T, *fixed))

    low, high, dlow, dhigh = X[:, j], X[:, j + 1], rate(j), rate(j + 1)
    Z = (
        (1 + 2 * z) * (1 - z) ** 2 * low
        + h * z * (1 - z) ** 2 * dlow
        + z**2 * (3 - 2 * z) * high
        + h * z**2 * (z - 1) * dhigh
    )
    dZ = 6 * z * (z - 1) / h * (low - high) + (1 - z) * (1 - 3 * z) * dlow + z * (3 * z - 2) * dhigh
    for node, beyond in ((0, at <= time[0]), (-1, at > time[-1])):
        outside, end = np.flatnonzero(beyond), X[:, node, None]
        Z[:, outside], dZ[:, outside] = end, 0.0
        for block in range(1 + s):
            angles, speeds = slice(block * x, block * x + n), slice(block * x + n, block * x + 2 * n)
            Z[angles, outside] += (at[outside] - time[node]) * end[speeds]
        dZ[:n, outside] = end[n : 2 * n]
    return Z, dZ
