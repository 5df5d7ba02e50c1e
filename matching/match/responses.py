"""The compared responses of vehicle, rig without control and matched rig, and how far they are apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from matching.match.case import Case, Move
from matching.match.loop import (
    Body,
    LinearBed,
    SampledController,
    bed_set,
    body,
    can_be_unmeasured,
    controller_on,
    frequency_response,
    linear_bed,
    vehicle_response,
)
from matching.match.loop import responses as controlled
from modelling.bed.specimen import KNOWN
from modelling.bed.vehicle import cut, parts_left_out, without_part
from modelling.linear.band import BandNodes, antiresonances, converged_nodes, resonances
from modelling.system import System, mirror_image


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
    exp(jωt) makes every sampled signal U·exp(jωkT); the held command has the same frequency and its images at
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
        """Which of the compared functions (h,) begin at a torque that the controller's model takes as measured; none
        where the specimen is unknown, which each of them passes: they are one response error, as in a match."""
        known = self.case.loop.specimen == KNOWN
        return np.array([known and source in self.bed.measured for source, _ in self.pairs])

    def at(self, frequencies: np.ndarray) -> Responses:
        """Responses at frequencies (f,), Hz, above 0 and below half the loop's sampling frequency."""
        f = np.asarray(frequencies, float)
        beds, acting = bed_set(self.case, [{}], f), frequency_response(self.controller, f)
        matched, unmeasured = (controlled(beds, acting, known)[0] for known in (self.case.loop.measured, ()))
        return Responses(f, self.pairs, self.of(self.vehicle, f), self.of(self.bed.free, f), matched, unmeasured)

    def of(self, system: Body, frequencies: np.ndarray) -> np.ndarray:
        """The compared functions (f, h) of a system without control; NaN where there is no such input."""
        values, space = system.response(2j * np.pi * frequencies), system.space
        picked = np.full((len(values), len(self.pairs)), np.nan, complex)
        for h, (source, sensor) in enumerate(self.pairs):
            if source in space.inputs:
                picked[:, h] = values[:, space.outputs.index(sensor), space.inputs.index(source)]
        return picked


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


@dataclass(frozen=True)
class ResponseError:
    """Response errors of a tuned bed, over the band and the compared functions together and by function.

    Attributes
    ----------
    band : tuple of float
        Hz.
    before : float or None
        The rig without control over the functions that have a path there; None where none has.
    after, unmeasured : float
        The matched rig over all compared functions, and the same with no torque of the rig measured over those that
        begin at such a torque: what acts inside the residual vehicle is always known.
    after_same_functions : float or None
        The matched rig over the functions of ``before``.
    functions : tuple of FunctionError
        Of every compared function.
    bound, bound_unsampled : float
        Lower bound that the dead time sets at the loop's sample time, and the same without sampling: their difference
        is the cost of sampling (:func:`matching.match.bounds.lower_bound`). NaN where it was not worked out.
    unmeasured_bound : float or None
        What the optimal estimator leaves of unmeasured torques (:func:`matching.match.bounds.estimator_bound`).
    specimen_known : tuple of float, or None
        Of a controller of an unknown specimen: ``after`` and ``unmeasured`` of the controller that is tuned alike with
        the specimen's model.
    """

    band: tuple[float, float]
    before: float | None
    after: float
    after_same_functions: float | None
    unmeasured: float
    functions: tuple[FunctionError, ...]
    bound: float = np.nan
    bound_unsampled: float = np.nan
    unmeasured_bound: float | None = None
    specimen_known: tuple[float, float] | None = None

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        keys = ("before", "after", "after_same_functions", "bound", "bound_unsampled", "unmeasured_bound")
        return {
            "band": list(self.band),
            **{key: getattr(self, key) for key in keys},
            "unmeasured_before": self.before,
            "unmeasured_after": self.unmeasured,
            **({} if self.specimen_known is None else {"specimen_known": list(self.specimen_known)}),
            "functions": [dict(vars(function)) for function in self.functions],
        }


def _squares(bed: ComparedBed, frequencies: np.ndarray) -> np.ndarray:
    """|log(H/H_vehicle)|² (3, f, h) without control, matched, and matched with no torque of the rig measured."""
    compared = bed.at(frequencies)
    every = (compared.rig, compared.matched, compared.unmeasured)
    return np.stack([log_squares(controlled, compared.vehicle) for controlled in every])


def log_squares(rig: np.ndarray, vehicle: np.ndarray) -> np.ndarray:
    """|log(H_rig/H_vehicle)|², complex logarithm, principal value; arrays of one shape, such as (f, h)."""
    with np.errstate(invalid="ignore"):  # NaN where a torque has no path
        return np.abs(np.log(rig / vehicle)) ** 2


def error_figures(case: Case, bed: LinearBed | None = None) -> ResponseError:
    """Response errors over the band of a tuned case; arguments as for :class:`ComparedBed`."""
    return figures_of(ComparedBed(case, bed))


def figures_of(bed: ComparedBed) -> ResponseError:
    """Response errors over the band of a bed's case."""
    nodes = nodes_of(bed)
    before, after, unmeasured = (nodes.root_mean(squares) for squares in _squares(bed, nodes.frequencies))
    path = ~np.isnan(before)
    functions = tuple(
        FunctionError(
            source, sensor, float(before[h]) if path[h] else None, float(after[h]), float(unmeasured[h])
        )
        for h, (source, sensor) in enumerate(bed.pairs)
    )  # fmt: skip
    return ResponseError(
        band=bed.case.band,
        before=pooled(before[path]) if path.any() else None,
        after=pooled(after),
        after_same_functions=pooled(after[path]) if path.any() else None,
        unmeasured=pooled(unmeasured[can_be_unmeasured(bed.case)]),
        functions=functions,
    )


def pooled(errors: Sequence[float] | np.ndarray) -> float:
    """Root mean square of the errors (h,) of several functions."""
    return float(np.sqrt(np.mean(np.square(errors))))


def nodes_of(bed: ComparedBed) -> BandNodes:
    """Nodes over the band of a bed's case at which the errors of every compared function have converged."""

    def squares(frequencies: np.ndarray) -> np.ndarray:
        together = np.hstack(list(_squares(bed, frequencies)))
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
ALIKE = 0.02  # relative: parts that cost so nearly the same are named together
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
    without_equals : float or None
        The same of a vehicle without all the parts that cost alike and most, as mirror images do; None without such.
    """

    as_written: float
    fitted: float
    values: dict[str, tuple[float, float]]
    left_out: tuple[tuple[str, float], ...]
    without_equals: float | None = None

    @property
    def most_costly(self) -> list[str]:
        """Parts that cost alike and most."""
        return [place for place, error in self.left_out if error <= (1 + ALIKE) * self.left_out[0][1]]

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
        parts = [place.removeprefix("effects.") for place in self.most_costly]
        if len(parts) > 1 and self.without_equals is not None:
            return (
                f"{near}; of what it leaves out {' and '.join(parts)} cost alike and most: a vehicle without them "
                f"would be met within {self.without_equals:.3g}"
            )
        error = self.left_out[0][1]
        return (
            f"{near}; of what it leaves out {parts[0]} costs most: a vehicle without it would be met within {error:.3g}"
        )


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
    lacking.sort(key=lambda row: row[1])
    equal = [place for place, error in lacking if error <= (1 + ALIKE) * lacking[0][1]]
    together = None
    if len(equal) > 1:
        vehicle = case.vehicle
        for place in equal:
            vehicle = without_part(vehicle, place)
        other = responses(vehicle, case, frequencies)
        nearest, _ = _fitted(fitted, case, frequencies, other)
        together = error_of(nearest, case, frequencies, other)
    nearness = SimpleVehicle(
        error_of(simple, case, frequencies, wanted),
        error_of(fitted, case, frequencies, wanted),
        {name: (simple.parameters[name].value, fitted.parameters[name].value) for name in names},
        tuple(lacking),
        together,
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
    return vehicle_response(replace(case, vehicle=system), {}, frequencies)


def error_of(system: System, case: Case, frequencies: np.ndarray, wanted: np.ndarray) -> float:
    """Response error of a vehicle against responses (f, h) at frequencies (f,), Hz."""
    return float(np.sqrt(np.mean(np.abs(np.log(responses(system, case, frequencies) / wanted)) ** 2)))
