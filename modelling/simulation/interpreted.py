"""The integration of :mod:`modelling.simulation.compiled` without a compiler, in CasADi's virtual machine.

Steps, readings and errors are CasADi functions; sensitivities are their forward derivatives.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, fields

import casadi as ca
import numpy as np

from modelling.simulation.task import (
    ALPHA,
    GAMMA,
    GAMMA_SUM,
    A,
    C,
    Functions,
    IntegrationTask,
    Trajectories,
    functions,
)

CHUNK = 256  # steps a call
EXPLICIT_STAGES = np.array([0.0, 0.5, 1.0])  # where in a step classical Runge-Kutta takes its rates


@dataclass(frozen=True)
class _Row:
    """One row of a batch with its constants (c,), and their derivatives (c, s) by the columns."""

    task: IntegrationTask
    made: Functions
    b: int
    constants: np.ndarray
    by_columns: np.ndarray

    def inputs(self, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Inputs and their time derivatives (u, k) at times (k,): linear between samples, held outside."""
        time, values, delay = self.task.time, self.task.inputs, self.task.input_delay[self.b]
        u, du = np.empty((2, values.shape[1], len(at)))
        for i in range(len(u)):
            when = at - delay[i]
            u[i] = np.interp(when, time, values[:, i])
            inside = (when > time[0]) & (when < time[-1])
            j = np.clip(np.searchsorted(time, when, side="left") - 1, 0, len(time) - 2)
            du[i] = np.where(inside, (values[j + 1, i] - values[j, i]) / (time[j + 1] - time[j]), 0.0)
        return u, du

    def inputs_by_columns(self, du: np.ndarray, further: np.ndarray | float = 0.0) -> np.ndarray:
        """Derivatives (u, k, s) of inputs with slopes (u, k): a longer delay takes them earlier."""
        return -du[:, :, None] * (self.task.input_delay_derivative + further)[:, None]


def run(task: IntegrationTask, states: bool = True, readings: bool = True, errors: bool = False) -> Trajectories:
    """As :func:`modelling.simulation.compiled.run_compiled`, same result to rounding."""
    made = functions(task.model, implicit=task.implicit)
    selection = np.zeros((len(task.model.parameters), task.columns))
    for column in np.flatnonzero(task.selected >= 0):
        selection[task.selected[column], column] = 1.0
    rows = []
    for b, (p, constants) in enumerate(zip(task.p, made.constants_of(task.p), strict=True)):
        _, (by_columns,) = _evaluated(made.constants, [p[:, None]], [selection[:, None]])
        rows.append(_run_row(_Row(task, made, b, constants, by_columns[:, 0]), states, readings, errors))
    return Trajectories(*(np.stack([getattr(row, part.name) for row in rows]) for part in fields(Trajectories)))


def _run_row(row: _Row, states: bool, readings: bool, errors: bool) -> Trajectories:
    task, x = row.task, len(row.task.model.states)
    first, time = mesh(task.time, task.steps)
    with np.errstate(over="ignore", invalid="ignore"):  # a motion that runs away is told by `failed`
        X, local = _nodes(row, time)
        samples = X[:, first]
        y, derivatives = _readings(row, time, X) if readings else (np.empty(0), np.empty((len(first), 0, task.columns)))
    at = samples[:, :, 0]
    bad = np.argwhere(~np.vstack([np.isfinite(at), np.isfinite(samples).all(axis=2)]).T)
    failed = np.full(2, -1, dtype=np.int64)
    if len(bad):
        failed[:] = bad[0][0], bad[0][1] % x  # the state, or that of a sensitivity
        at[:, bad[0][0] :] = np.nan
        y[bad[0][0] :] = np.nan
    by_interval = _errors(row, at, np.add.reduceat(local, first[:-1], axis=1)) if errors else np.empty(0)
    return Trajectories(at.T.copy() if states else np.empty(0), y, failed, derivatives, by_interval)


def mesh(time: np.ndarray, count: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which node every sample is (t,), and the times of all nodes, of so many steps between the samples (t-1,)."""
    span = np.diff(time)
    first = np.concatenate([[0], np.cumsum(count)])
    inner = np.arange(first[-1]) - np.repeat(first[:-1], count)
    nodes = np.append(np.repeat(time[:-1], count) + inner * np.repeat(span / count, count), time[-1])
    return first, nodes


def _evaluated(
    function: ca.Function, arguments: Sequence[np.ndarray], by_columns: Sequence[np.ndarray]
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Results (r, k) of a function of arguments (a, k), and their derivatives (r, k, s) from those of the arguments."""
    results = function.call([*arguments])
    s = by_columns[0].shape[2]
    if not s:
        return [part.full() for part in results], [np.empty((*part.shape, 0)) for part in results]
    seeds = [part.transpose(0, 2, 1).reshape(len(part), s * part.shape[1]) for part in by_columns]
    derivatives = _forward(function, s).call([*arguments, *results, *seeds])
    shaped = [part.full().reshape(part.shape[0], s, part.shape[1] // s).transpose(0, 2, 1) for part in derivatives]
    return [part.full() for part in results], shaped


@functools.lru_cache(maxsize=128)
def _forward(function: ca.Function, s: int) -> ca.Function:
    """Forward derivatives in s directions at once; CasADi itself forgets them with their last use."""
    return function.forward(s)


@functools.lru_cache(maxsize=128)
def _at_samples(function: ca.Function, samples: int, common: int) -> ca.Function:
    """A function at so many samples, with the same argument number ``common`` at all."""
    return function.map("at_samples", "serial", samples, [common], [])


def _explicit_step(made: Functions) -> ca.Function:
    """(x, drive, c) → x after a step of classical Runge-Kutta, and the rate before it.

    ``drive`` is the step h and the inputs at its begin, middle and end.
    """
    x, n, k = (made.field.size1_in(i) for i in range(3))
    X, drive, c = ca.SX.sym("X", x), ca.SX.sym("drive", 1 + 3 * n), ca.SX.sym("c", k)
    h, begin, middle, end = ca.vertsplit(drive, [0, 1, 1 + n, 1 + 2 * n, 1 + 3 * n])
    k1 = made.field(X, begin, c)
    k2 = made.field(X + h / 2 * k1, middle, c)
    k3 = made.field(X + h / 2 * k2, middle, c)
    k4 = made.field(X + h * k3, end, c)
    after = X + h / 6 * (k1 + 2 * (k2 + k3) + k4)
    return ca.Function("step", [X, drive, c], ca.cse([ca.densify(after), ca.densify(k1)]))


def _implicit_step(made: Functions) -> ca.Function:
    """(x, drive, c) → x after a Rosenbrock step, and its embedded error.

    ``drive`` is the step h, the inputs at five stages (the sixth is at the time of the fifth), and their slopes.
    """
    x, n, k = (made.field.size1_in(i) for i in range(3))
    X, drive, c = ca.MX.sym("X", x), ca.MX.sym("drive", 1 + 6 * n), ca.MX.sym("c", k)
    h, *u, slopes = ca.vertsplit(drive, [0, *(1 + n * i for i in range(7))])
    by_state, by_input = made.jacobian(X, u[0], c)  # type: ignore[misc]
    # by QR, which takes a matrix that is singular or not finite: a motion that runs away is told by `failed`
    inverse = ca.inv(ca.MX.eye(x) / (GAMMA * h) - by_state, "lapackqr")
    forced, stages = h * (by_input @ slopes), ca.MX(x, 0)
    for i, at in enumerate([*u, u[-1]]):
        Y = X + stages @ ca.DM(A[i, :i])
        rate = made.field(Y, at, c) + stages @ ca.DM(C[i, :i]) / h + GAMMA_SUM[i] * forced  # type: ignore[arg-type]
        stages = ca.horzcat(stages, inverse @ rate)
    return ca.Function("step", [X, drive, c], [Y + stages[:, -1], stages[:, -1]])


@functools.lru_cache(maxsize=128)
def _steps(made: Functions) -> ca.Function:
    """(x, drive, c) → what ``CHUNK`` steps one after the other give; ``drive`` by columns."""
    step = _explicit_step(made) if made.jacobian is None else _implicit_step(made)
    first, drive, c = (ca.MX.sym(name, step.size1_in(i)) for i, name in enumerate(["X", "drive", "c"]))
    drive = ca.MX.sym("drive", drive.shape[0], CHUNK)
    after = step.mapaccum("steps", CHUNK, 1)(first, drive, ca.repmat(c, 1, CHUNK))
    return ca.Function("chunk", [first, drive, c], [*after])


def _nodes(row: _Row, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """States and their derivatives (x, k, 1+s) at the ends of all steps, at times (k,), and local errors (x, k-1).

    The errors of explicit steps are right in pairs only (see ``c/errors.c``).
    """
    task, made, s = row.task, row.made, row.task.columns
    end = np.append(time[1:], 2 * time[-1] - time[-2])  # one step more, for the rate at the last node
    h = end - time
    drive, seeds = [h[None]], [np.zeros((1, len(h), s))]
    for stage in ALPHA[:-1] if task.implicit else EXPLICIT_STAGES:
        u, du = row.inputs(time + stage * h if stage < 1 else end)
        drive.append(u)
        seeds.append(row.inputs_by_columns(du))
    if task.implicit:  # slopes, in the middle: at a node an input may have a kink
        drive.append(row.inputs(time + h / 2)[1])
    idle = ((0, 0), (0, -len(h) % CHUNK))
    driven, by_columns = np.pad(np.vstack(drive), idle, "edge"), np.pad(np.vstack(seeds), (*idle, (0, 0)))
    X, beside = np.empty((len(task.model.states), driven.shape[1] + 1, 1 + s)), []
    X[:, 0] = np.hstack([task.start[row.b][:, None], task.start_derivative])
    for begin in range(0, driven.shape[1], CHUNK):
        now, after = slice(begin, begin + CHUNK), slice(begin + 1, begin + CHUNK + 1)
        (X[:, after, 0], second), (X[:, after, 1:], _) = _evaluated(
            _steps(made),
            [X[:, begin, :1], driven[:, now], row.constants[:, None]],
            [X[:, begin : begin + 1, 1:], by_columns[:, now], row.by_columns[:, None]],
        )
        beside.append(second)
    X, errors, h = X[:, : len(time)], np.hstack(beside)[:, : len(time)], h[:-1]
    if task.implicit:
        return X, errors[:, :-1]
    at, rate = X[:, :, 0], errors
    even = (np.arange(len(h)) - np.repeat(np.cumsum(task.steps) - task.steps, task.steps)) % 2 == 0
    begun = -at[:, :-1] - h / 3 * (rate[:, :-1] + 4 * rate[:, 1:])
    return X, np.where(even, begun, at[:, 1:] - h / 3 * rate[:, 1:])


def _errors(row: _Row, states: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Errors (t-1, y + x-n) of readings and states behind the angles, from states (x, t) and their errors (x, t-1)."""
    time = row.task.time[1:]
    reading = _at_samples(row.made.reading, len(time), 2)
    further = row.inputs(time)[0], row.constants, time[None]
    of_readings = reading(states[:, 1:], *further) - reading(states[:, 1:] - errors, *further)
    return np.vstack([of_readings.full().reshape(-1, len(time)), errors[row.task.model.n :]]).T


def _readings(row: _Row, time: np.ndarray, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Readings (t, y) and their derivatives (t, y, s), from X (x, k, 1+s) at nodes at ``time`` (k,)."""
    task, made = row.task, row.made
    t, m, s = len(task.time), len(task.model.sensors), task.columns
    y, derivatives = np.empty((t, m)), np.empty((t, m, s))
    common, of_common = [row.constants[:, None], task.time[None]], [row.by_columns[:, None], np.zeros((1, t, s))]
    for g, delay in enumerate(task.group_delay[row.b]):
        members = task.group == g
        if not members.any():
            continue
        if g == 0:
            there = X[:, np.searchsorted(time, task.time)]
            u, du = row.inputs(task.time)
            function, arguments, seeds = made.reading, [there[:, :, 0], u], [there[:, :, 1:], row.inputs_by_columns(du)]
        else:
            function = _between(made, task.model.n)
            arguments, seeds = _around(row, time, X, task.time - delay, task.sensor_delay_derivative[members])
        (values,), (by_columns,) = _evaluated(
            _at_samples(function, t, len(arguments)), [*arguments, *common], [*seeds, *of_common]
        )
        y[:, members], derivatives[:, members] = values.T[:, members], by_columns.transpose(1, 0, 2)[:, members]
    return y, derivatives


def _around(
    row: _Row, time: np.ndarray, X: np.ndarray, at: np.ndarray, by_delay: np.ndarray
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """What :func:`_between` needs to read at times (t,), and its derivatives; ``by_delay`` (1, s) are the delay's."""
    j = np.clip(np.searchsorted(time, at, side="left") - 1, 0, len(time) - 2)
    h, inside = time[j + 1] - time[j], (at > time[0]) & (at <= time[-1])
    z = np.clip((at - time[j]) / h, 0.0, 1.0)
    place = np.stack([h, z, np.where(inside, 0.0, at - np.clip(at, time[0], time[-1]))])
    of_place = -np.stack([0 * h, inside / h, ~inside])[:, :, None] * by_delay
    ends, seeds = [], []
    for node in (j, j + 1):
        u, du = row.inputs(time[node])
        ends += [X[:, node, 0], u]
        seeds += [X[:, node, 1:], row.inputs_by_columns(du)]
    u, du = row.inputs(at)
    return [*ends, u, place], [*seeds, row.inputs_by_columns(du, by_delay), of_place]


@functools.lru_cache(maxsize=128)
def _between(made: Functions, n: int) -> ca.Function:
    """(x and u at two nodes, u, place, c, t) → y between them, by cubic Hermite interpolation.

    ``place`` is the time h between the nodes, the fraction of it that has passed, and the time outside all nodes,
    where the n angles run on with their speeds.
    """
    x, u = made.field.size1_in(0), made.field.size1_in(1)
    X, dX, Y, dY = (ca.SX.sym(name, size) for name, size in (("X", x), ("u", u), ("Y", x), ("v", u)))
    now, place, c, t = (
        ca.SX.sym("now", u),
        ca.SX.sym("place", 3),
        ca.SX.sym("c", made.field.size1_in(2)),
        ca.SX.sym("t"),
    )
    h, z, outside = ca.vertsplit(place)
    Z = (1 + 2 * z) * (1 - z) ** 2 * X + z**2 * (3 - 2 * z) * Y
    Z += h * z * (1 - z) ** 2 * made.field(X, dX, c) + h * z**2 * (z - 1) * made.field(Y, dY, c)
    Z[:n] += outside * Z[n : 2 * n]
    return ca.Function("between", [X, dX, Y, dY, now, place, c, t], [made.reading(Z, now, c, t)])
