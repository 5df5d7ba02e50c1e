"""One job for an integrator, everything in arrays, and what it returns."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.csgraph import reverse_cuthill_mckee

from modelling.equations.casadi_code import Model
from modelling.equations.shaft_law import CONTACT_TIME
from modelling.errors import InputError, unknown

# --- The functions that the integrators step, with what depends on parameters alone computed once.

READING_CONTACT_SHARE = 0.2  # of a step: over which the damping of a closing lash sets in for a sensor


@dataclass(frozen=True)
class Functions:
    """CasADi functions of one model, c standing for all that they need of the parameters.

    Attributes
    ----------
    constants : Function
        p → c.
    field : Function
        (x, u, c) → ẋ; with ``parametric`` also its derivatives A, B, P by x, u, p.
    reading : Function
        (x, u, c, t) → y; with ``parametric`` also C, D, Q by x, u, p.
    jacobian : Function or None
        (x, u, c) → A, B, for implicit steps.
    parametric : bool
        Whether forward sensitivities can be integrated along.
    """

    constants: ca.Function
    field: ca.Function
    reading: ca.Function
    jacobian: ca.Function | None
    parametric: bool

    def constants_of(self, p: np.ndarray) -> np.ndarray:
        """(b, p) → (b, c)."""
        return np.ascontiguousarray(np.array(self.constants(p.T)).T)

    @property
    def all(self) -> tuple[ca.Function, ...]:
        """Those that a step calls."""
        return (self.field, self.reading) if self.jacobian is None else (self.field, self.reading, self.jacobian)


def functions(model: Model, parametric: bool = False, implicit: bool = False) -> Functions:
    """The functions of a model, kept for models of one structure.

    Parameters
    ----------
    parametric, implicit : bool
        For sensitivities by the parameters; for implicit steps.
    """
    contact = model.parameters.index(CONTACT_TIME) if CONTACT_TIME in model.parameters else None
    return _functions(model.rates, model.readings, contact, parametric, implicit)


@functools.lru_cache(maxsize=512)
def _functions(
    rates: ca.Function, readings: ca.Function, contact: int | None, parametric: bool, implicit: bool
) -> Functions:
    x, u, p, t = (ca.SX.sym(name, readings.size1_in(i)) for i, name in enumerate("xupt"))
    for_readings = ca.SX(p)
    if contact is not None:
        for_readings[contact] = READING_CONTACT_SHARE * p[contact]
    xdot, y = rates(x, u, p), readings(x, u, for_readings, t)
    groups = [
        [xdot, *(ca.jacobian(xdot, by) for by in (x, u, p) if parametric)],
        [y, *(ca.jacobian(y, by) for by in (x, u, p) if parametric)],
        [ca.jacobian(xdot, by) for by in (x, u) if implicit],
    ]
    outputs = ca.cse([output for group in groups for output in group])
    outputs, symbols, parts = ca.extract_parametric(outputs, p, {"extract_trivial": True})
    c = ca.vertcat(*symbols) if symbols else ca.SX(0, 1)
    constants = ca.Function("constants", [p], [ca.vertcat(*parts) if parts else ca.SX(0, 1)])
    first, second = len(groups[0]), len(groups[0]) + len(groups[1])
    field = ca.Function("field", [x, u, c], ca.cse(outputs[:first]))
    reading = ca.Function("reading", [x, u, c, t], ca.cse(outputs[first:second]))
    jacobian = ca.Function("jacobian", [x, u, c], ca.cse(outputs[second:])) if implicit else None
    return Functions(constants, field, reading, jacobian, parametric)


# --- The implicit method for stiff models: RODASP, a Rosenbrock method of order four, L-stable and stiffly accurate.
#
# W·Uᵢ = f(t + αᵢ·h, x + Σⱼ aᵢⱼ·Uⱼ) + Σⱼ cᵢⱼ/h·Uⱼ + h·γᵢ·∂f/∂t with W = 1/(γ·h) − ∂f/∂x, and x + Σ aₛⱼ·Uⱼ + Uₛ is the
# next state: one linear system a stage, no iteration (Hairer and Wanner, Solving Ordinary Differential Equations II,
# 1996, section IV.7). Coefficients: G. Steinebach, Order-reduction of ROW-methods for DAEs and method of lines
# applications, TH Darmstadt, preprint 1741, 1995; also in Hairer's program RODAS. Its order does not fall off where
# fast decaying parts follow an input.

STAGES = 6
GAMMA = 0.25
ALPHA = np.array([0.0, 0.75, 0.21, 0.63, 1.0, 1.0])  # where in the step a stage stands
GAMMA_SUM = np.array([0.25, -0.5, -0.023504, -0.0362, 0.0, 0.0])  # γᵢ, of the time derivative

_LAST = [-7.170454962423024, -4.741636671481785, -16.31002631330971, -1.062004044111401]
_A = [
    [],
    [3.0],
    [1.831036793486759, 0.4955183967433795],
    [2.304376582692669, -0.05249275245743001, -1.176798761832782],
    _LAST,
    [*_LAST, 1.0],
]
_C = [
    [],
    [-12.0],
    [-8.791795173947035, -2.207865586973518],
    [10.81793056857153, 6.780270611428266, 19.53485944642410],
    [34.19095006749676, 15.49671153725963, 54.74760875964130, 14.16005392148534],
    [34.62605830930532, 15.30084976114473, 56.99955578662667, 18.40807009793095, -5.714285714285717],
]


def _square(rows: list[list[float]]) -> np.ndarray:
    return np.array([row + [0.0] * (STAGES - len(row)) for row in rows])


A, C = _square(_A), _square(_C)


# --- Task


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
    laws = [effect.law for effect in model.system.effects]
    ahead = any(law.is_clock or law.imposes_motion or law.looks_ahead for law in laws)
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
