"""One job for an integrator, everything in arrays, and what it returns."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from modelling.common.errors import InputError, unknown
from modelling.equations.compiled import Model
from modelling.equations.shaft_law import CONTACT_TIME


@dataclass(frozen=True)
class IntegrationTask:
    """A batch of simulations of one model on one recording.

    Attributes
    ----------
    model : Model
    time, inputs : ndarray (t,), (t, u)
        s, N·m.
    p, start : ndarray (b, p), (b, x)
    steps : ndarray of int (t-1,)
        Equal steps from each sample to the next.
    implicit : bool
        Rosenbrock steps instead of explicit Runge-Kutta ones.
    input_delay, group_delay : ndarray (b, u), (b, g)
        s. A delayed sensor has its own group, all others are group 0.
    group : ndarray of int (y,)
        Which group a sensor belongs to.
    selected : ndarray of int (s,)
        For sensitivities: the parameter of each column, −1 for a start state.
    start_derivative, input_delay_derivative, sensor_delay_derivative : ndarray (x, s), (u, s), (y, s)
    """

    model: Model
    time: np.ndarray
    inputs: np.ndarray
    p: np.ndarray
    start: np.ndarray
    steps: np.ndarray
    implicit: bool
    input_delay: np.ndarray
    group_delay: np.ndarray
    group: np.ndarray
    selected: np.ndarray
    start_derivative: np.ndarray
    input_delay_derivative: np.ndarray
    sensor_delay_derivative: np.ndarray

    @property
    def columns(self) -> int:
        """Number of sensitivities s."""
        return len(self.selected)

    @property
    def step_count(self) -> float:
        """Steps of all rows together."""
        return len(self.p) * float(self.steps.sum())


@dataclass(frozen=True)
class Trajectories:
    """What an integrator returns; what was not asked for is empty.

    Attributes
    ----------
    states, readings : ndarray (b, t, x), (b, t, y)
        NaN from the first sample on at which a state is not finite.
    failed : ndarray of int (b, 2)
        That sample and state, −1 where all is finite.
    derivatives : ndarray (b, t, y, s)
        Of the readings by the columns.
    errors : ndarray (b, t-1, y + x-n)
        Of the readings, then of the states behind the angles: local errors summed from each sample to the next (see
        ``c/errors.c``; explicit steps have to be even in number).
    """

    states: np.ndarray = field(repr=False)
    readings: np.ndarray = field(repr=False)
    failed: np.ndarray
    derivatives: np.ndarray = field(repr=False)
    errors: np.ndarray = field(repr=False)


def make_task(
    model: Model,
    time: np.ndarray,
    inputs: np.ndarray,
    p: np.ndarray,
    start: np.ndarray,
    steps_per_second: float,
    names: list[str] | None = None,
    implicit: bool = False,
    refinement: int | np.ndarray = 1,
) -> IntegrationTask:  # all that defines a simulation
    """Collect a task; a closing lash gets its damping over one step, the shortest.

    Parameters
    ----------
    time, inputs, p, start : ndarray (t,), (t, u), (b, p), (b, x)
        SI.
    names : list of str, optional
        Parameters and start states to differentiate by; explicit steps only.
    refinement : int or ndarray (t-1,)
        Every interval between samples is cut into this times the fewest equal steps that are none longer than
        ``1/steps_per_second``.

    Raises
    ------
    InputError
        If a name is unknown, or a delay negative that is not that of an early clock or an imposed motion.
    """
    names = names or []
    if CONTACT_TIME in model.parameters:
        span = float(np.median(np.diff(time)))
        p = p.copy()
        p[:, model.parameters.index(CONTACT_TIME)] = span / (np.max(refinement) * fewest_steps(span, steps_per_second))
    steps = np.ascontiguousarray(refinement * fewest_steps(np.diff(time), steps_per_second), dtype=np.int64)
    selected, start_derivative = _selection(model, names)
    input_paths, sensor_paths = model.equations.assembly.inputs.values(), model.equations.assembly.sensors.values()
    delayed = [j for j, path in enumerate(sensor_paths) if path.delay != 0]
    delays = [np.zeros((len(p), len(input_paths))), np.zeros((len(p), len(sensor_paths)))]
    if delayed or any(path.delay != 0 for path in input_paths):
        delays = [np.array(part).T for part in model.delays(p.T)]
    lowest = min((float(part.min()) for part in delays if part.size), default=0.0)
    ahead = any(effect.law.is_clock or effect.law.imposes_motion for effect in model.system.effects)
    if lowest < 0 and not ahead:
        raise InputError("simulation", f"a delay of {lowest:g} s is not possible", "delays are 0 or more")
    group = np.zeros(len(model.sensors), dtype=np.int64)
    group[delayed] = np.arange(1, len(delayed) + 1)
    by_columns = [np.zeros((part.shape[1], len(names))) for part in delays]
    if names:
        for columns, jacobian in zip(by_columns, _delay_jacobians(model), strict=True):
            columns[:, selected >= 0] = jacobian[:, selected[selected >= 0]]
    return IntegrationTask(
        model, time, inputs, p, start, steps, implicit, _contiguous(delays[0]),
        _contiguous(np.hstack([np.zeros((len(p), 1)), delays[1][:, delayed]])), group,
        selected, start_derivative, _contiguous(by_columns[0]), _contiguous(by_columns[1]),
    )  # fmt: skip


def fewest_steps(span: np.ndarray | float, steps_per_second: float) -> np.ndarray:
    """The fewest equal steps in spans (s) of which none is longer than ``1/steps_per_second``."""
    return np.maximum(1.0, np.ceil(np.asarray(span) * steps_per_second - 1e-9))


def _contiguous(array: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(array, dtype=float)


def _delay_jacobians(model: Model) -> list[np.ndarray]:
    """Derivatives (u, p) and (y, p) of the delays, which are sums of parameters."""
    p = ca.SX.sym("p", len(model.parameters))
    jacobian = ca.Function("delay_jacobians", [p], [ca.jacobian(delay, p) for delay in model.delays(p)])
    return [np.array(ca.DM(part).full()) for part in jacobian(model.p0)]


def _selection(model: Model, names: list[str]) -> tuple[np.ndarray, np.ndarray]:
    selected = np.full(len(names), -1, dtype=np.int64)
    start_derivative = np.zeros((len(model.states), len(names)))
    parameter = {name: i for i, name in enumerate(model.parameters)}
    state = {name: i for i, name in enumerate(model.states)}
    for column, name in enumerate(names):
        if name in parameter:
            selected[column] = parameter[name]
        elif name in state:
            start_derivative[state[name], column] = 1.0
        else:
            raise unknown(name, [*model.parameters, *model.states], "sensitivities")
    return selected, start_derivative


@dataclass(frozen=True)
class BandOrder:
    """An order of the states in which the matrix of an implicit step is a narrow band.

    ``place`` (x,) is the row of each state, ``lower`` and ``upper`` are the bandwidths.
    """

    place: np.ndarray
    lower: int
    upper: int


@functools.lru_cache(maxsize=512)
def band_order(jacobian: ca.Function) -> BandOrder:
    """Reverse Cuthill-McKee order of the pattern of A, the first result of ``jacobian``."""
    sparsity = jacobian.sparsity_out(0)
    size = sparsity.size1()
    pattern = csc_array((np.ones(sparsity.nnz()), sparsity.row(), sparsity.colind()), shape=(size, size))
    order = reverse_cuthill_mckee((pattern + pattern.T).tocsr(), symmetric_mode=True)
    place = np.empty(size, dtype=np.int64)
    place[order] = np.arange(size)
    rows, columns = place[pattern.tocoo().row], place[pattern.tocoo().col]
    below = rows - columns
    return BandOrder(place, int(below.max(initial=0)), int((-below).max(initial=0)))
