"""The compared responses of vehicle, rig without control and matched rig, and how far they are apart."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from scipy.linalg import eigvals
from scipy.optimize import least_squares

from matching.match.case import Case, Move
from matching.match.loop import (
    Body,
    LinearBed,
    SampledController,
    bed_set,
    body,
    controller_on,
    frequency_response,
    linear_bed,
)
from matching.match.loop import responses as controlled
from modelling.bed.vehicle import cut, parts_left_out, without_part
from modelling.linear.state_space import StateSpace, state_space
from modelling.system import System, mirror_image

# --- Means over the frequency band on a logarithmic scale, by quadrature on panels that are halved until it converges.

CONVERGED = 0.01  # relative: largest estimated error of a mean square, so half of it in its root
FIRST_PANELS = 8  # of the band before any is halved, beside those that resonances begin
MOST_HALVINGS = 400  # reached only where a response has a pole or zero on the frequency axis itself
NARROWEST = 2e-3  # relative width of a first panel: resonances closer together begin one
GAUSS_NODES, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(7)  # of the Gauss-Kronrod pair 7, 15
NEGLIGIBLE = 1e-12  # mean square, below which nothing has to converge: a response error of 1e-6


@dataclass(frozen=True)
class BandNodes:
    """Frequencies (f,) in Hz and weights (f,), sum 1: Σ weight·value is the mean over the logarithm of frequency."""

    frequencies: np.ndarray
    weights: np.ndarray

    def root_mean(self, squares: np.ndarray) -> np.ndarray:
        """Root of the mean over the band of squares (f, …)."""
        return np.sqrt(np.tensordot(self.weights, squares, 1))


def converged_nodes(
    band: tuple[float, float], squares: Callable[[np.ndarray], np.ndarray], breaks: Iterable[float] = ()
) -> BandNodes:
    """Nodes at which the mean of every column of ``squares`` has converged to :data:`CONVERGED`.

    Parameters
    ----------
    band : tuple of float
        Hz.
    squares : callable
        Frequencies (f,), Hz, → values (f, c), finite and not negative.
    breaks : iterable of float
        Hz, where values may change fast, such as resonances; those outside the band are left out.
    """
    low, high = np.log(band)
    inner = np.linspace(low, high, FIRST_PANELS + 1)[1:-1]
    marked = np.log([f for f in breaks if band[0] < f < band[1]])
    points = np.unique(np.concatenate([inner, marked]))
    points = points[np.diff(points, prepend=low) > NARROWEST]
    panels = scipy.integrate.cubature(
        lambda x: squares(np.exp(x[:, 0])), [low], [high], rule="gk15", rtol=CONVERGED,
        atol=NEGLIGIBLE * (high - low), max_subdivisions=MOST_HALVINGS, points=[np.array([point]) for point in points],
    ).regions  # fmt: skip
    middle = np.array([(panel.a[0] + panel.b[0]) / 2 for panel in panels])
    half = np.array([(panel.b[0] - panel.a[0]) / 2 for panel in panels])
    order = np.argsort(middle)
    nodes = middle[order, None] + half[order, None] * GAUSS_NODES
    weights = half[order, None] * GAUSS_WEIGHTS / (high - low)
    return BandNodes(np.exp(nodes.ravel()), weights.ravel())


def resonances(space: StateSpace) -> np.ndarray:
    """Natural frequencies (m,) of a system in Hz, without motions that do not swing."""
    return _swinging(np.linalg.eigvals(space.A))


def antiresonances(space: StateSpace, source: str, output: str) -> np.ndarray:
    """Frequencies (m,) in Hz of the zeros of one transfer function: eigenvalues of the Rosenbrock pencil."""
    n = len(space.A)
    through = space.D[space.outputs.index(output), space.inputs.index(source)]
    system = np.block([[space.A, space.input(source)[:, None]], [space.output(output)[None], np.array([[through]])]])
    zeros = eigvals(system, np.diag([1.0] * n + [0.0]))
    return _swinging(zeros[np.isfinite(zeros)])


def _swinging(values: np.ndarray) -> np.ndarray:
    """|s|/2π (m,) of the values with a positive imaginary part."""
    return np.abs(values[values.imag > 1e-9]) / (2 * np.pi)


# --- Responses


@dataclass(frozen=True)
class Responses:
    """Responses (f, h) of the compared functions at frequencies (f,), Hz; SI unit of the sensor per N·m.

    Attributes
    ----------
    pairs : tuple of (str, str)
        Input and sensor of every function, h of them.
    vehicle : ndarray (f, h)
    rig : ndarray (f, h)
        The rig without control, dynamometers torqueless; NaN where a torque has no path, as one on a road has none.
    matched : ndarray (f, h)
        The tuned rig with its sampled controller, which knows the rig's torques as the case says.
    unmeasured : ndarray (f, h)
        The same where it knows none of the rig's torques; those inside the residual vehicle are always known.
    """

    frequencies: np.ndarray
    pairs: tuple[tuple[str, str], ...]
    vehicle: np.ndarray
    rig: np.ndarray
    matched: np.ndarray
    unmeasured: np.ndarray


class ComparedBed:
    """A tuned bed and the vehicle that it is compared with, at any frequencies.

    The controller samples the sensors and the measured torques, and holds each command for one sample. A torque
    exp(jωt) makes every sampled signal U·exp(jωkT); the held command has the same frequency beside its images at
    ω ± 2πn/T. Inside the loop all of them count, as the rig is discretised exactly; of what the rig shows, the part at
    ω is its response (Chen and Francis, Optimal Sampled-Data Control Systems, 1995, chapter 3).

    Parameters
    ----------
    case : Case
        Tuned.
    bed : LinearBed, optional
        The case's own, with the untuned rig for comparison; else the tuned one is that.
    controller : SampledController, optional
        The case's own if given already.
    """

    def __init__(self, case: Case, bed: LinearBed | None = None, controller: SampledController | None = None):
        self.bed = linear_bed(case) if bed is None else bed
        self.case, self.vehicle = case, body(case.vehicle)
        self.controller = controller_on(self.bed) if controller is None else controller
        self.pairs = tuple((pair.input, pair.sensor) for pair in case.compared)

    @property
    def measured(self) -> np.ndarray:
        """Which of the compared functions (h,) begin at a torque that the controller's model takes as measured."""
        return np.array([source in self.bed.measured for source, _ in self.pairs])

    def at(self, frequencies: np.ndarray) -> Responses:
        """Responses at frequencies (f,), Hz, above 0 and below half the loop's sampling frequency."""
        f = np.asarray(frequencies, float)
        rig = self.bed.free
        free = self._picked(_response(rig, f), rig.space.outputs, rig.space.inputs)
        beds, acting = bed_set(self.case, [{}], f), frequency_response(self.controller, f)
        matched, unmeasured = (controlled(beds, acting, known)[0] for known in (self.case.loop.measured, ()))
        return Responses(f, self.pairs, self.of_vehicle(f), free, matched, unmeasured)

    def of_vehicle(self, frequencies: np.ndarray) -> np.ndarray:
        """Responses (f, h) of the vehicle."""
        return self._picked(_response(self.vehicle, frequencies), self.vehicle.space.outputs, self.vehicle.space.inputs)

    def _picked(self, values: np.ndarray, outputs: Sequence[str], inputs: Sequence[str]) -> np.ndarray:
        """The compared functions (f, h) of responses (f, y, u); NaN where there is no such input."""
        picked = np.full((len(values), len(self.pairs)), np.nan, complex)
        for h, (source, sensor) in enumerate(self.pairs):
            if source in inputs:
                picked[:, h] = values[:, outputs.index(sensor), inputs.index(source)]
        return picked


def _response(system: Body, frequencies: np.ndarray) -> np.ndarray:
    return system.response(2j * np.pi * frequencies)


# --- How far the compared responses of rig and vehicle are apart: the response error and its figures.
#
# The error is the root mean square of |log(H_rig/H_vehicle)|, complex logarithm, phase by its principal value, over the
# band (logarithm of frequency) and the compared functions. H_vehicle is the continuous vehicle; torques enter the
# continuous rig, whose controller samples and holds (:mod:`matching.match.responses`).


@dataclass(frozen=True)
class FunctionError:
    """Root mean squares over the band for one compared function; None where the rig without control has no path."""

    input: str
    sensor: str
    before: float | None
    after: float
    unmeasured: float

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return {
            "input": self.input, "sensor": self.sensor, "before": self.before, "after": self.after,
            "unmeasured": self.unmeasured,
        }  # fmt: skip


@dataclass(frozen=True)
class ErrorFigures:
    """Response errors of a tuned bed, over the band and the compared functions together and by function.

    Attributes
    ----------
    before : float or None
        The rig without control over the functions that have a path there; None where none has.
    after, unmeasured : float
        The matched rig, and the same with no torque of the rig measured, over all compared functions.
    after_same_functions : float or None
        The matched rig over the functions of ``before``.
    nodes : BandNodes
        Frequencies at which these means have converged to 1 %.
    """

    band: tuple[float, float]
    before: float | None
    after: float
    after_same_functions: float | None
    unmeasured: float
    functions: tuple[FunctionError, ...]
    nodes: BandNodes


@dataclass(frozen=True)
class _Squares:
    """|log(H/H_vehicle)|² (f, h) of :class:`Responses`; NaN where there is no path."""

    before: np.ndarray
    after: np.ndarray
    unmeasured: np.ndarray

    @classmethod
    def of(cls, bed: ComparedBed, frequencies: np.ndarray) -> _Squares:
        compared = bed.at(frequencies)
        return cls(
            *(
                log_squares(controlled, compared.vehicle)
                for controlled in (compared.rig, compared.matched, compared.unmeasured)
            )
        )


def log_squares(rig: np.ndarray, vehicle: np.ndarray) -> np.ndarray:
    """|log(H_rig/H_vehicle)|², complex logarithm, principal value; arrays of one shape, such as (f, h)."""
    with np.errstate(invalid="ignore"):  # NaN where a torque has no path
        return np.abs(np.log(rig / vehicle)) ** 2


def error_figures(case: Case, bed: LinearBed | None = None) -> ErrorFigures:
    """Response errors over the band of a tuned case; arguments as for :class:`ComparedBed`."""
    return figures_of(ComparedBed(case, bed))


def figures_of(bed: ComparedBed) -> ErrorFigures:
    """Response errors over the band of a bed's case."""
    nodes = nodes_of(bed)
    squares = _Squares.of(bed, nodes.frequencies)
    before, after, unmeasured = (
        nodes.root_mean(values) for values in (squares.before, squares.after, squares.unmeasured)
    )
    path = ~np.isnan(before)
    functions = tuple(
        FunctionError(
            source, sensor, float(before[h]) if path[h] else None, float(after[h]), float(unmeasured[h])
        )
        for h, (source, sensor) in enumerate(bed.pairs)
    )  # fmt: skip
    return ErrorFigures(
        band=bed.case.band,
        before=pooled(before[path]) if path.any() else None,
        after=pooled(after),
        after_same_functions=pooled(after[path]) if path.any() else None,
        unmeasured=pooled(unmeasured),
        functions=functions,
        nodes=nodes,
    )


def pooled(errors: Sequence[float] | np.ndarray) -> float:
    """Root mean square of the errors (h,) of several functions."""
    return float(np.sqrt(np.mean(np.square(errors))))


def nodes_of(bed: ComparedBed) -> BandNodes:
    """Nodes over the band of a bed's case at which the errors of every compared function have converged."""

    def squares(frequencies: np.ndarray) -> np.ndarray:
        at_nodes = _Squares.of(bed, frequencies)
        together = np.hstack([at_nodes.before, at_nodes.after, at_nodes.unmeasured])
        return together[:, ~np.isnan(together[0])]

    return converged_nodes(bed.case.band, squares, _breaks(bed))


def _breaks(bed: ComparedBed) -> np.ndarray:
    """Resonances of vehicle and rig and antiresonances of the vehicle's compared functions, Hz."""
    vehicle = bed.vehicle.space
    zeros = [antiresonances(vehicle, source, sensor) for source, sensor in dict.fromkeys(bed.pairs)]
    return np.concatenate([resonances(vehicle), resonances(bed.bed.rig.space), *zeros])


# --- How near a simple residual vehicle comes to the vehicle's own, its quantities fitted, and what it lacks most.

POINTS = 120  # of the band, midpoints of equal parts of its logarithm
SMALLEST, LARGEST = 1e-12, 1e12  # SI, of a quantity whose range is open on that side
STEP = 1e-3  # of a logarithm, of finite differences: the response has to change by more than rounding


@dataclass(frozen=True)
class SimpleVehicle:
    """The user's residual vehicle against the vehicle's own; errors are response errors of vehicle to vehicle.

    Attributes
    ----------
    as_written, fitted : float
        With the values of its file, and with those that were fitted within their ranges.
    values : dict of str to (float, float)
        What was fitted: as written and as fitted, SI.
    left_out : tuple of (str, float)
        Parts of the vehicle that it lacks, and how near it would come to a vehicle without that part: what costs most
        first.
    """

    as_written: float
    fitted: float
    values: dict[str, tuple[float, float]]
    left_out: tuple[tuple[str, float], ...]

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return {
            "error_as_written": self.as_written, "error_fitted": self.fitted,
            "values": {name: list(pair) for name, pair in self.values.items()}, "left_out": dict(self.left_out),
        }  # fmt: skip

    def sentence(self) -> str:
        """What it says, for the notes of a result."""
        near = f"the residual vehicle of the case comes within a response error of {self.fitted:.3g} of the vehicle"
        if self.values:
            near += f" ({self.as_written:.3g} as written; what was fitted is a compensation, not the car)"
        if not self.left_out:
            return near
        place, error = self.left_out[0]
        part = place.removeprefix("effects.")
        return f"{near}; of what it leaves out {part} costs most: a vehicle without it would be met within {error:.3g}"


def fitted_simple_vehicle(case: Case) -> tuple[Case, SimpleVehicle | None]:
    """The case with the ranges of its residual vehicle fitted to the vehicle's responses; as it is without one."""
    simple = case.simple_vehicle
    if simple is None:
        return case, None
    low, high = np.log(case.band)
    frequencies = np.exp(low + (high - low) * (np.arange(POINTS) + 0.5) / POINTS)
    wanted = responses(case.vehicle, case, frequencies)
    fitted, names = _fitted(simple, case, frequencies, wanted)
    lacking = []
    for place in parts_left_out(simple, cut(case.vehicle, case.rig)):
        other = responses(without_part(case.vehicle, place), case, frequencies)
        nearest, _ = _fitted(fitted, case, frequencies, other)
        lacking.append((place, error_of(nearest, case, frequencies, other)))
    nearness = SimpleVehicle(
        error_of(simple, case, frequencies, wanted),
        error_of(fitted, case, frequencies, wanted),
        {name: (simple.parameters[name].value, fitted.parameters[name].value) for name in names},
        tuple(sorted(lacking, key=lambda row: row[1])),
    )
    residual = cut(fitted, case.rig)
    moves = tuple(_from_fitted(move, simple, fitted) for move in case.moves)
    return replace(case, simple_vehicle=fitted, residual_vehicle=residual, moves=moves), nearness


def _from_fitted(move: Move, simple: System, fitted: System) -> Move:
    """A move that began at, or counted its change from, the value as written, from the fitted value on."""
    name = move.name.removeprefix("residual_vehicle.")
    if name == move.name:
        return move
    written, value = simple.parameters[name].value, fitted.parameters[name].value
    value = min(max(value, move.lower), move.upper)
    return replace(
        move, start=value if move.start == written else move.start,
        planned=value if move.planned == written else move.planned,
    )  # fmt: skip


def _fitted(
    simple: System, case: Case, frequencies: np.ndarray, wanted: np.ndarray
) -> tuple[System, list[str]]:  # fmt: skip
    """The vehicle with its ranges beyond the cut fitted to responses (f, h), and their names; mirror images alike."""
    beyond = {name for system in cut(simple, case.rig).parts for name in system.parameters}
    ranged = {name: quantity for name, quantity in simple.uncertain.items() if name in beyond and quantity.value > 0}
    order = list(ranged)
    names = [name for i, name in enumerate(order) if mirror_image(name, simple) not in order[:i]]
    if not names:
        return simple, names
    lower = np.log([max(ranged[name].lower or 0.0, SMALLEST) for name in names])
    upper = np.log([ranged[name].upper or LARGEST for name in names])

    def at(logarithms: np.ndarray) -> System:
        values = dict(zip(names, np.exp(logarithms).tolist(), strict=True))
        return simple.with_values(values | {mirror_image(name, simple): value for name, value in values.items()})

    def differences(logarithms: np.ndarray) -> np.ndarray:
        ratio = np.log(responses(at(logarithms), case, frequencies) / wanted).ravel()
        return np.concatenate([ratio.real, ratio.imag])

    start = np.clip(np.log([ranged[name].value for name in names]), lower, upper)
    return at(least_squares(differences, start, bounds=(lower, upper), diff_step=STEP).x), names


def responses(system: System, case: Case, frequencies: np.ndarray) -> np.ndarray:
    """Compared functions (f, h) of a vehicle at frequencies (f,), Hz."""
    space = state_space(system)
    s = 2j * np.pi * frequencies
    shape = (len(s), *space.B.shape)
    states = np.linalg.solve(s[:, None, None] * np.eye(len(space.A)) - space.A, np.broadcast_to(space.B, shape))
    rows = [space.outputs.index(pair.sensor) for pair in case.compared]
    return (space.C @ states + space.D)[:, rows, [space.inputs.index(pair.input) for pair in case.compared]]


def error_of(system: System, case: Case, frequencies: np.ndarray, wanted: np.ndarray) -> float:
    """Response error of a vehicle against responses (f, h) at frequencies (f,), Hz."""
    return float(np.sqrt(np.mean(np.abs(np.log(responses(system, case, frequencies) / wanted)) ** 2)))
