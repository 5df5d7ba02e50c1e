"""One job for an integrator: everything in arrays, nothing left to look up."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from modelling.common.errors import InputError, unknown
from modelling.equations.compiled import Model
from modelling.equations.shaft_law import CONTACT_TIME


@dataclass(frozen=True)
class Task:
    """Inputs (t, u) on a time grid (t,) for parameters (b, p) from start states (b, x).

    ``input_delay`` (b, u) and ``group_delay`` (b, g) in s: a delayed sensor has its own group, all others are
    group 0; ``group`` (y,) says which. For sensitivities: ``selected`` (s,) parameter of a column or −1,
    ``start_slope`` (x, s), ``input_delay_slope`` (u, s), ``sensor_delay_slope`` (y, s); s = 0 otherwise.
    """

    model: Model
    time: np.ndarray
    inputs: np.ndarray
    p: np.ndarray
    start: np.ndarray
    steps_per_second: float
    input_delay: np.ndarray
    group_delay: np.ndarray
    group: np.ndarray
    selected: np.ndarray
    start_slope: np.ndarray
    input_delay_slope: np.ndarray
    sensor_delay_slope: np.ndarray

    @property
    def columns(self) -> int:
        """Number of sensitivities s."""
        return len(self.selected)


def make_task(
    model: Model,
    time: np.ndarray,
    inputs: np.ndarray,
    p: np.ndarray,
    start: np.ndarray,
    steps_per_second: float,
    names: list[str] | None = None,
) -> Task:
    """Collect a task; ``names`` are the parameters and start states to differentiate by. Contact takes one step.

    Raises
    ------
    InputError
        If a name is unknown or a delay negative.
    """
    names = names or []
    if CONTACT_TIME in model.parameters:
        span = float(np.median(np.diff(time)))
        p = p.copy()
        p[:, model.parameters.index(CONTACT_TIME)] = span / max(1.0, np.ceil(span * steps_per_second - 1e-9))
    selected, start_slope = _selection(model, names)
    inputs_by, sensors_by = model.equations.assembly.inputs.values(), model.equations.assembly.sensors.values()
    delayed = [j for j, path in enumerate(sensors_by) if path.delay != 0]
    delays = [np.zeros((len(p), len(inputs_by))), np.zeros((len(p), len(sensors_by)))]
    if delayed or any(path.delay != 0 for path in inputs_by):
        delays = [np.array(part).T for part in model.delays(p.T)]
    lowest = min((float(part.min()) for part in delays if part.size), default=0.0)
    if lowest < 0:
        raise InputError("simulation", f"a delay of {lowest:g} s is not possible", "delays are 0 or more")
    group = np.zeros(len(model.sensors), dtype=np.int64)
    group[delayed] = np.arange(1, len(delayed) + 1)
    slopes = [np.zeros((part.shape[1], len(names))) for part in delays]
    for slope, jacobian in zip(slopes, _delay_slopes(model) if names else (), strict=bool(names)):
        for column, j in enumerate(selected):
            if j >= 0 and slope.size:
                slope[:, column] = jacobian[:, j]
    return Task(
        model, time, inputs, p, start, float(steps_per_second), _c(delays[0]),
        _c(np.hstack([np.zeros((len(p), 1)), delays[1][:, delayed]])), group,
        selected, start_slope, _c(slopes[0]), _c(slopes[1]),
    )  # fmt: skip


def _c(array: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(array, dtype=float)


def _delay_slopes(model: Model) -> list[np.ndarray]:
    """Derivatives (u, p) and (y, p) of the delays, which are sums of parameters."""
    p = ca.SX.sym("p", len(model.parameters))
    values = model.delays(p)
    jacobian = ca.Function("slopes", [p], [ca.jacobian(value, p) for value in values])
    return [np.array(ca.DM(part).full()) for part in jacobian(model.p0)]


def _selection(model: Model, names: list[str]) -> tuple[np.ndarray, np.ndarray]:
    selected = np.full(len(names), -1, dtype=np.int64)
    start_slope = np.zeros((len(model.states), len(names)))
    parameter = {name: i for i, name in enumerate(model.parameters)}
    state = {name: i for i, name in enumerate(model.states)}
    for column, name in enumerate(names):
        if name in parameter:
            selected[column] = parameter[name]
        elif name in state:
            start_slope[state[name], column] = 1.0
        else:
            raise unknown(name, [*model.parameters, *model.states], "sensitivities")
    return selected, start_slope
