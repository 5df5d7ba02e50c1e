"""A match as asked for: what is matched to what, by which loop, and which quantities may move."""

from __future__ import annotations

import dataclasses
import weakref
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import wraps
from typing import Any, TypeVar

import numpy as np

from matching.match.box import Box
from matching.match.gearboxes import Gearboxes
from matching.match.movable import movable, with_sizes
from matching.match.vehicle_in_the_loop import VehicleInTheLoop
from modelling import display
from modelling.bed.bed import Loop
from modelling.bed.clutches import CLOSED
from modelling.bed.manoeuvres import Manoeuvre
from modelling.bed.specimen import KNOWN
from modelling.bed.vehicle import ResidualVehicle, TorqueCurve
from modelling.errors import InputError, unknown
from modelling.linear.steady_motion import speeds_of, torques_of
from modelling.system import System
from modelling.units import to_si

# --- Case


@dataclass(frozen=True)
class Compared:
    """A transfer function that vehicle and rig are compared by: an input and a sensor both know by name."""

    input: str
    sensor: str


@dataclass(frozen=True)
class Target:
    """A vehicle mode the rig has to show: its number, and how far frequency (relative) and damping ratio may be off."""

    mode: int
    frequency_tolerance: float = 0.01
    damping_tolerance: float = 0.02


@dataclass(frozen=True)
class Move:
    """A quantity that may move.

    Attributes
    ----------
    name : str
        ``residual_vehicle.…``, ``rig.…`` or ``loop.…``.
    together : tuple of str
        The name itself and its mirror image, which moves with it.
    start, lower, upper : float
        In SI.
    unit : str
    planned : float
        Value, SI, from which a change is counted, wherever the search starts: the model's, or as the case states it.
    catalogue : tuple of float
        Values (SI) of an adapter that can be bought, in rising order; empty where any value can be made.
    """

    name: str
    together: tuple[str, ...]
    start: float
    lower: float
    upper: float
    unit: str
    planned: float
    catalogue: tuple[float, ...] = ()


@dataclass(frozen=True)
class ErrorScales:
    """Scales by which the two response errors become one figure, in the search, in an order and in a map.

    They do not follow the tolerances of a case: these are limits, and a limit that is raised must not weigh the errors
    in another way.

    Attributes
    ----------
    measured, unmeasured : float
        Errors to measured and to unmeasured torques that count alike: the usual tolerances, so that a part of the
        tolerance used is worth the same for both.
    """

    measured: float = 0.1
    unmeasured: float = 0.3

    def both(self, measured: Any, unmeasured: Any) -> Any:
        """Root mean square of both errors over their scales, numbers or arrays alike."""
        return np.sqrt(((measured / self.measured) ** 2 + (unmeasured / self.unmeasured) ** 2) / 2)


ERROR_SCALES = ErrorScales()


@dataclass(frozen=True)
class Drive:
    """A manoeuvre that begins at a steady speed of the vehicle: ``vehicle_speed`` in m/s, 0 at standstill.

    ``torques`` are added to those of the steady motion, as those of ``[manoeuvre]``; those of clutches are what they
    carry. ``gears`` are those in which a drive that shifts begins, by gearbox.
    """

    title: str
    vehicle_speed: float
    torques: Mapping[str, Manoeuvre]
    gears: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class OperatingRange:
    """Speeds of the vehicle that one controller has to cover, m/s, and the manoeuvres that judge it.

    ``rolling_radius`` (m) is that of the tyres; ``bodies`` are the inertias whose mean speed is the vehicle's.
    """

    lowest: float
    highest: float
    rolling_radius: float
    bodies: tuple[str, ...]
    drives: tuple[Drive, ...] = ()


@dataclass(frozen=True)
class Case:
    """A match as asked for; see ``examples/road_to_rig/case.toml`` for every key with a comment.

    Vehicle, rig and the parts of the residual vehicle carry the operating point, if the case states one.

    Raises
    ------
    InputError
        If the band reaches half the sampling frequency: from there on the sampled controller has no response.
    """

    vehicle: System
    rig: System
    residual_vehicle: ResidualVehicle
    loop: Loop
    targets: tuple[Target, ...]
    band: tuple[float, float]
    compared: tuple[Compared, ...]
    manoeuvre: Mapping[str, Manoeuvre]
    limits: Mapping[str, float]
    moves: tuple[Move, ...]
    title: str = ""
    path: str = field(default="", compare=False)
    uncertainty: Box = field(default_factory=Box)
    tolerance: float = ERROR_SCALES.measured  # largest response error to measured torques that is still called matched
    unmeasured_tolerance: float = ERROR_SCALES.unmeasured  # the same to unmeasured torques
    torque_curve: TorqueCurve | None = None
    operating_range: OperatingRange | None = None
    simple_vehicle: System | None = None  # the vehicle with a residual vehicle of the user's own, if the case has one
    vehicle_in_the_loop: VehicleInTheLoop | None = None  # the vehicle as others simulate it, if the case has one
    gearboxes: Gearboxes | None = None  # with their clutches, if vehicle or rig has any
    notes: tuple[str, ...] = ()  # what was changed of the model files, as sentences

    def __post_init__(self) -> None:
        highest = 0.5 / self.loop["sample_time"]
        if self.band[1] >= highest:
            raise InputError(
                f"{self.path}: response.band".lstrip(": "),
                f"{self.band[0]:g} … {self.band[1]:g} Hz reaches half the sampling frequency, {highest:g} Hz",
                f"end it below, or sample faster (loop.sample_time = {self.loop['sample_time']:g} s)",
            )

    @property
    def error_scales(self) -> ErrorScales:
        """Scales of both errors; where the specimen is unknown, every response counts as to an unmeasured torque."""
        known = self.loop.specimen == KNOWN
        return ERROR_SCALES if known else ErrorScales(ERROR_SCALES.unmeasured, ERROR_SCALES.unmeasured)

    def limit_key(self, dynamometer: str, what: str) -> str:
        """The key of ``limits`` that holds for a dynamometer: its own, else that of all; ``torque`` or a figure of the
        loop."""
        own = own_limit(dynamometer, what)
        return own if own in self.limits else LIMITS_OF_ALL.get(what, what)

    def limits_of(self, what: str) -> np.ndarray:
        """``torque`` (N·m) or another limit of every dynamometer (k,), SI; infinite where the case states none."""
        keys = [self.limit_key(dynamometer.name, what) for dynamometer in self.loop.dynamometers]
        return np.array([self.limits.get(key, np.inf) for key in keys])

    @property
    def largest_torque(self) -> float:
        """Largest torque of the manoeuvre, N·m; 0 without one."""
        made = (self.torque_made(name, drive.torque(drive.time())) for name, drive in self.manoeuvre.items())
        return max((float(np.abs(torque).max()) for torque in made), default=0.0)

    def torque_made(self, name: str, values: np.ndarray) -> np.ndarray:
        """Torque (t,), N·m, less that of the operating point, for values (t,) of an input less its own there.

        That of a pedal is what its map has at the speed of the operating point.
        """
        for system in (self.rig, self.vehicle):
            if name in system.pedals:
                on = next(part.on for part in system.inputs if part.name == name)
                held, own = torques_of(system)[name], system.pedals[name]
                torque: np.ndarray = own.torques_at(np.full(len(values), speeds_of(system)[on]), held + values)
                return torque - own.torque(speeds_of(system)[on], held)
        return values

    @property
    def closed_clutches(self) -> dict[str, float]:
        """What clutches that the controller emulates can carry where nothing says so, N·m by input: they are closed."""
        return {} if self.gearboxes is None else dict.fromkeys(self.gearboxes.emulated_clutches, CLOSED)

    @property
    def emulated_vehicle(self) -> System:
        """The vehicle that the controller emulates: with the user's residual vehicle where the case has one."""
        return self.vehicle if self.simple_vehicle is None else self.simple_vehicle

    def with_values(self, values: Mapping[str, float | str]) -> Case:
        """The case with other values by the names of ``[move]`` and their mirror images, SI or texts with a unit.

        ``case.with_values({"loop.dead_time": "5 ms"})``. Beds are drawn about the changed values; what may move still
        may.

        Raises
        ------
        InputError
            If a name is unknown or a value impossible.
        """
        known = movable(self.rig, self.residual_vehicle, self.loop)
        changed: dict[str, float] = {}
        for name, value in values.items():
            if name not in known:
                raise unknown(name, list(known), "")
            number = to_si(value, known[name].unit, name) if isinstance(value, str) else float(value)
            changed |= dict.fromkeys(known[name].together, number)
        return apply(self, changed)

    def __repr__(self) -> str:
        name = self.title or self.path
        return f"Case({name!r}, {self.loop.structure.name}, {len(self.moves)} quantities may move)"

    def _repr_html_(self) -> str:
        return display.html(self)


def whole_loop(case: Case) -> Loop:
    """The loop of a case with the specimen known, and all that its controller then knows and reads."""
    loop, inputs = case.loop, {part.name for part in case.rig.inputs}
    return dataclasses.replace(
        loop, specimen=KNOWN, beyond=(),
        measured=(*loop.measured, *(name for name in loop.beyond if name in inputs)),
        further_sensors=(*loop.further_sensors, *(name for name in loop.beyond if name not in inputs)),
    )  # fmt: skip


# --- Limits that one dynamometer has for itself.

LIMITS_OF_ALL = {"torque": "dynamometer_torque", "command_noise": "command_noise"}  # by what a dynamometer's own limits


Made = TypeVar("Made")


def once_per_case(function: Callable[[Case], Made]) -> Callable[[Case], Made]:
    """A function of a case alone, whose answer is kept as long as that very case: a case does not change."""
    answers: dict[int, Made] = {}

    @wraps(function)
    def kept(case: Case) -> Made:
        key = id(case)
        if key not in answers:
            answers[key] = function(case)
            weakref.finalize(case, answers.pop, key, None)
        return answers[key]

    return kept


def limit_of_all(key: str) -> str:
    """The key of a limit of all dynamometers for one's own, which has the same words; any other key as it is."""
    return LIMITS_OF_ALL[key.rpartition(".")[2]] if key.startswith("dynamometers.") else key


def own_limit(dynamometer: str, what: str) -> str:
    """The key of a dynamometer's own limit."""
    return f"dynamometers.{dynamometer}.{what}"


# --- Tables and texts of a case file, checked.


def text_of(table: Mapping[str, Any], key: str, where: str) -> str:
    """A text that has to be there."""
    value = table.get(key)
    if not isinstance(value, str) or not value:
        raise InputError(f"{where}: {key}", "is missing or no text", f'write {key} = "…"')
    return value


def table_of(data: Mapping[str, Any], key: str, where: str, known: set[str] | None = None) -> dict[str, Any]:
    """A table, empty where it is left out; with ``known`` no other keys may stand in it."""
    table = data.get(key, {})
    if not isinstance(table, dict):
        raise InputError(f"{where}: {key}", "is no table", f"write [{key}]")
    for name in table:
        if known is not None and name not in known:
            raise unknown(name, sorted(known), f"{where}: {key}")
    return table


# --- What moves as parts 0 … 1 of its range, and back.

LOGARITHMIC_FROM_RATIO = 4.0  # upper over lower bound, above which a range is scaled by its logarithm


def unscaled(part: Any, move: Move) -> Any:
    """Value of a move in SI from its scaled part 0 … 1 (float or CasADi expression, and so the value)."""
    if is_logarithmic(move):
        return move.lower * (move.upper / move.lower) ** part
    return move.lower + (move.upper - move.lower) * part


def scaled(value: float, move: Move) -> float:
    """Scaled part 0 … 1 of a value in SI."""
    if is_logarithmic(move):
        return float(np.log(value / move.lower) / np.log(move.upper / move.lower))
    return (value - move.lower) / (move.upper - move.lower)


def is_logarithmic(move: Move) -> bool:
    """Whether a move is scaled by its logarithm."""
    return move.lower > 0 and move.upper / move.lower > LOGARITHMIC_FROM_RATIO


# --- A case at other values of what may move.


def apply(case: Case, values: Mapping[str, float]) -> Case:
    """The case with quantities ``rig.…``, ``residual_vehicle.…`` and ``loop.…`` changed, SI.

    What is uncertain goes with them: beds are drawn about the changed values. Stiffness and inertias follow the
    dimensions of a shaft.
    """
    values = with_sizes(case.rig, values)
    rig = {name.removeprefix("rig."): value for name, value in values.items() if name.startswith("rig.")}
    emulated = {
        name.removeprefix("residual_vehicle."): value
        for name, value in values.items()
        if name.startswith("residual_vehicle.")
    }
    loop = {name.removeprefix("loop."): value for name, value in values.items() if name.startswith("loop.")}
    parts = tuple(
        part.with_values({name: value for name, value in emulated.items() if name in part.parameters})
        for part in case.residual_vehicle.parts
    )
    return dataclasses.replace(
        case,
        rig=case.rig.with_values(rig, designed=True),
        residual_vehicle=dataclasses.replace(case.residual_vehicle, parts=parts),
        loop=case.loop.with_values(loop),
        uncertainty=case.uncertainty.about(values),
    )
