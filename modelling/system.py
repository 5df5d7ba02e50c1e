"""A drivetrain as one checked, frozen value."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

from modelling import display
from modelling.effects import EFFECTS
from modelling.effects.effect import Kind, members, shared_place
from modelling.effects.torque_map import PedalMap
from modelling.errors import InputError, listed, unknown
from modelling.topology import Joint, connected_parts, joints
from modelling.units import GEARBOX_UNITS, INPUT_UNITS, PEDAL_UNIT, QUANTITY_UNITS, SENSOR_UNITS, in_unit, to_si

# --- A number in SI with the range it is known to lie in.


@dataclass(frozen=True)
class Quantity:
    """A value in SI; with ``lower`` and ``upper`` it is uncertain and may be identified, without it is taken as known.

    Attributes
    ----------
    value, lower, upper : float
        In the SI unit of the quantity; ``lower`` and ``upper`` are both given or both None.

    Raises
    ------
    InputError
        If a number is not finite or the bounds do not enclose the value.
    """

    value: float
    lower: float | None = None
    upper: float | None = None

    def __post_init__(self) -> None:
        if (self.lower is None) != (self.upper is None):
            raise InputError("", "a quantity has one bound only", "give lower and upper, or neither")
        numbers = (self.value,) if self.lower is None or self.upper is None else (self.value, self.lower, self.upper)
        if not all(math.isfinite(number) for number in numbers):
            raise InputError("", "a quantity is not finite", "write finite numbers")
        if self.lower is not None and self.upper is not None and not self.lower <= self.value <= self.upper:
            raise InputError(
                "",
                f"bounds {self.lower:g} … {self.upper:g} do not enclose {self.value:g}",
                "lower ≤ value ≤ upper is needed",
            )

    @property
    def uncertain(self) -> bool:
        """Whether it may be identified."""
        return self.lower is not None

    @property
    def ends(self) -> tuple[float, float]:
        """Of its range; twice the value where it has none."""
        return (self.value, self.value) if self.lower is None or self.upper is None else (self.lower, self.upper)

    def written(self) -> float | dict[str, float]:
        """As a model file has it."""
        if self.lower is None or self.upper is None:
            return self.value
        return {"value": self.value, "lower": self.lower, "upper": self.upper}

    def designed(self, value: float) -> Quantity:
        """The same quantity designed with another value: its bounds stay as far from it as before, relatively."""
        if self.lower is None or self.upper is None or self.value == 0:
            return self.at(value)
        ends = value * self.lower / self.value, value * self.upper / self.value
        return Quantity(value, min(ends), max(ends))

    def at(self, value: float) -> Quantity:
        """The same quantity at another value; bounds widen where they must to enclose it."""
        if self.lower is None or self.upper is None:
            return Quantity(value)
        return Quantity(value, min(self.lower, value), max(self.upper, value))


# --- The components of a drivetrain: inertias, what connects them, inputs, sensors, and effects on them.

TABLES = ("inertias", "shafts", "gears", "gearboxes", "differentials", "planetary_gears", "inputs", "sensors")
TABLES_WITH_QUANTITIES = ("inertias", "shafts", "gears", "gearboxes", "planetary_gears")


@dataclass(frozen=True)
class Inertia:
    """A rigid body that rotates: inertia ``J`` (kg·m²), viscous ``drag`` to ground (N·m·s/rad)."""

    name: str
    J: Quantity
    drag: Quantity = Quantity(0.0)


MOVABLE_DIMENSIONS = ("length", "diameter", "inner_diameter")  # of a drawing; its material stays


LARGEST = {"length": 500.0, "diameter": 5.0}  # m: twice those of the largest ships' shafting; beyond, mm were meant


@dataclass(frozen=True)
class Drawing:
    """A shaft by its drawing: a round bar or tube, sizes in m, ``shear_modulus`` in Pa, ``density`` in kg/m³.

    Half of its inertia is part of the ``J`` of each end of the shaft.
    """

    length: Quantity
    diameter: Quantity
    inner_diameter: Quantity
    shear_modulus: Quantity
    density: Quantity

    @property
    def sizes(self) -> dict[str, Quantity]:
        """Every quantity by its key."""
        return dict(vars(self))

    @property
    def stiffness(self) -> Quantity:
        """N·m/rad: shear modulus times polar moment of area over length."""
        return self._over_range(
            lambda at: at["shear_modulus"] * _polar_moment(at) / at["length"], rising=("diameter", "shear_modulus")
        )

    @property
    def inertia(self) -> Quantity:
        """kg·m² of all of it about its axis."""
        return self._over_range(
            lambda at: at["density"] * at["length"] * _polar_moment(at), rising=("diameter", "density", "length")
        )

    @property
    def stress_per_torque(self) -> float:
        """Largest shear stress, at the outer diameter, of a torque of 1 N·m, Pa: 16/(π·d³) of a solid bar."""
        return self.diameter.value / 2 / _polar_moment({key: size.value for key, size in self.sizes.items()})

    def with_sizes(self, values: Mapping[str, float], *, designed: bool = False) -> Drawing:
        """The same part with other sizes by their keys, SI; ``designed`` so, their ranges go with them.

        Raises
        ------
        InputError
            If a size is impossible.
        """
        moved = Quantity.designed if designed else Quantity.at
        made = dataclasses.replace(self, **{key: moved(getattr(self, key), value) for key, value in values.items()})
        made.check("")
        return made

    def check(self, place: str) -> None:
        """Refuse impossible sizes.

        Raises
        ------
        InputError
            That names the key at ``place``.
        """
        for key, size in self.sizes.items():
            least = size.ends[0]
            if least < 0 or (least == 0 and key not in ("inner_diameter", "density")):
                raise InputError(f"{place}.{key}".lstrip("."), f"{least:g} is not possible", "greater than 0 is needed")
            if size.value > LARGEST.get(key, math.inf):
                raise InputError(
                    f"{place}.{key}".lstrip("."), f"{size.value:g} m is longer than any shaft",
                    f'write a unit: "{size.value:g} mm"',
                )  # fmt: skip
        if self.inner_diameter.ends[1] >= self.diameter.ends[0]:
            raise InputError(f"{place}.inner_diameter".lstrip("."), "is not smaller than the diameter", "exchange them")

    def _over_range(self, law: Callable[[Mapping[str, float]], float], rising: tuple[str, ...]) -> Quantity:
        """What a law gives, and over which range: it rises with the sizes named, and falls with the others."""
        sizes = self.sizes
        value = law({key: size.value for key, size in sizes.items()})
        if not any(size.uncertain for size in sizes.values()):
            return Quantity(value)
        low, high = (
            law({key: size.ends[end if key in rising else 1 - end] for key, size in sizes.items()}) for end in (0, 1)
        )
        return Quantity(value, low, high)


def _polar_moment(at: Mapping[str, float]) -> float:
    """m⁴, of the cross-section of a round bar or tube."""
    return math.pi / 32 * (at["diameter"] ** 4 - at["inner_diameter"] ** 4)


@dataclass(frozen=True)
class Shaft:
    """A spring and damper: twist = angle(first)/ratio − angle(second), stiffness and torque on the second's side.

    ``stiffness`` in N·m/rad, ``damping`` in N·m·s/rad; ``drawing`` where the file states the shaft by its drawing.
    """

    name: str
    between: tuple[str, str]
    stiffness: Quantity
    damping: Quantity = Quantity(0.0)
    ratio: Quantity | None = None
    drawing: Drawing | None = None


@dataclass(frozen=True)
class Gear:
    """A rigid, ideal gear: speed(first) = ratio · speed(second)."""

    name: str
    between: tuple[str, str]
    ratio: Quantity


@dataclass(frozen=True)
class Converter:
    """A hydrodynamic torque converter: pump torque = capacity factor · (pump speed)², turbine torque = ratio · that.

    Both are tables over turbine speed over pump speed, straight between the points and constant beyond them. A capacity
    factor below 0 is a turbine that drives the pump.

    Attributes
    ----------
    speed_ratios, capacity_factors, torque_ratios : tuple of float
        1, N·m/(rad/s)², 1; one of each a point.
    """

    speed_ratios: tuple[float, ...]
    capacity_factors: tuple[float, ...]
    torque_ratios: tuple[float, ...]

    def written(self) -> dict[str, list[float]]:
        """As a model file has it."""
        return {key: list(getattr(self, key)) for key in ("speed_ratios", "capacity_factors", "torque_ratios")}


@dataclass(frozen=True)
class Gearbox:
    """Gears with a clutch each, in parallel: speed(first) = ratio · speed(second) in the gear whose clutch sticks.

    Each clutch is dry friction whose torque is an input, see :func:`modelling.effects.torques.dry_friction`: the slip
    is speed(first) − ratio · speed(second), and the torque acts on the first inertia. With ``engages_below`` the
    clutches are dog clutches, see :func:`modelling.effects.torques.dog`: their teeth hold whatever the torque is.

    Attributes
    ----------
    ratios : tuple of Quantity
        By gear, the first one first.
    capacities : tuple of str
        The input of each gear's clutch: the torque that it can carry, N·m at the first inertia, 0 or more.
    deflection : Quantity
        By which a clutch gives way before it slips under its whole torque, rad of the first inertia.
    settling : Quantity or None
        Time with which it does so, s.
    engages_below : Quantity or None
        Of dog clutches: the slip, rad/s at the first inertia, below which teeth that are asked for find their gaps.
    converter : Converter or None
        From the first inertia, its pump, to the second; the clutch of its only gear is the lock-up clutch beside it.
        Where the lock-up clutch is open for good, there are no ``capacities``: see :meth:`System.in_gear`.
    """

    name: str
    between: tuple[str, str]
    ratios: tuple[Quantity, ...]
    capacities: tuple[str, ...]
    deflection: Quantity
    settling: Quantity | None = None
    engages_below: Quantity | None = None
    converter: Converter | None = None

    @property
    def quantities(self) -> dict[str, Quantity]:
        """Every quantity by its key: ``ratio_1`` is that of the first gear."""
        ratios = {f"ratio_{gear}": ratio for gear, ratio in enumerate(self.ratios, 1)}
        given = {"settling": self.settling, "engages_below": self.engages_below}
        further = {key: quantity for key, quantity in given.items() if quantity is not None}
        return {**ratios, "deflection": self.deflection, **further}

    def with_quantities(self, changed: Mapping[str, Quantity]) -> Gearbox:
        """The same gearbox with other quantities by their keys."""
        every = {**self.quantities, **changed}
        ratios = tuple(every[f"ratio_{gear}"] for gear in range(1, len(self.ratios) + 1))
        return dataclasses.replace(
            self, ratios=ratios, deflection=every["deflection"], settling=every.get("settling"),
            engages_below=every.get("engages_below"),
        )  # fmt: skip


@dataclass(frozen=True)
class Differential:
    """An open, ideal differential: 2·speed(cage) = speed(left) + speed(right)."""

    name: str
    cage: str
    left: str
    right: str

    @property
    def ends(self) -> tuple[str, str, str]:
        """Cage, left and right."""
        return self.cage, self.left, self.right


@dataclass(frozen=True)
class PlanetaryGear:
    """An ideal planetary gear whose members all turn: (1 + ratio)·speed(carrier) = speed(sun) + ratio·speed(ring).

    ``ratio`` is the number of teeth of the ring over that of the sun (Willis). The planets' inertia about the axis
    belongs to the carrier.
    """

    name: str
    sun: str
    carrier: str
    ring: str
    ratio: Quantity

    @property
    def ends(self) -> tuple[str, str, str]:
        """Carrier, sun and ring."""
        return self.carrier, self.sun, self.ring


@dataclass(frozen=True)
class Input:
    """A torque (N·m) on the inertia ``on``; where an effect imposes its motion, its speed (rad/s) or angle (rad); where
    it has a torque map, a pedal (0 to 1).

    ``measures`` is ``torque``, ``speed`` or ``angle``; None is a torque, or the speed of an imposed motion.
    ``reference`` is the channel that the controller of the input follows, where there is one.
    """

    name: str
    on: str
    measures: str | None = None
    reference: str | None = None


@dataclass(frozen=True)
class Sensor:
    """Measures the angle, speed or acceleration ``of`` an inertia, or the torque of a shaft.

    ``uncertainty`` is the standard uncertainty (k = 1) in the SI unit of the reading, or None; ``counts`` are those of
    a turn of an encoder whose speed is the counts of a sample over its duration, or None.
    """

    name: str
    measures: str
    of: str
    uncertainty: float | None = None
    counts: float | None = None

    @property
    def unit(self) -> str:
        """SI unit of the reading."""
        return SENSOR_UNITS[self.measures]


Component = Inertia | Shaft | Gear | Gearbox | Differential | PlanetaryGear | Input | Sensor


def quantities(part: Any) -> dict[str, Quantity]:
    """The quantities of a component by their keys, in the order of the parameter vector."""
    if isinstance(part, Gearbox):
        return part.quantities
    return {key: own for key in QUANTITY_UNITS if (own := getattr(part, key, None)) is not None}


def quantity_unit(key: str) -> str:
    """SI unit of a quantity of a component by its key; ``ratio_2`` is a ratio."""
    word, _, number = key.rpartition("_")
    return (QUANTITY_UNITS | GEARBOX_UNITS)[word if number.isdecimal() else key]


@dataclass(frozen=True)
class Effect:
    """One effect beyond the linear chain: its ``kind``, the place ``at`` which it acts, and its parameters by key.

    Several inputs or sensors share it where ``at`` is of :func:`modelling.effects.effect.shared_place`.
    """

    kind: str
    at: str
    parameters: tuple[tuple[str, Quantity], ...] = ()

    @property
    def name(self) -> str:
        """How its parameters begin in reports: ``shafts.link.backlash``."""
        return f"{self.at}.{self.kind}"

    @property
    def places(self) -> tuple[str, ...]:
        """The inputs or sensors that share it; of any other effect the place at which it acts."""
        return members(self.at)

    @property
    def law(self) -> Kind:
        """What is known of its kind: law, units, bounds, what it asks of a simulation.

        Raises
        ------
        KeyError
            If there is no such kind; a checked system has none of these.
        """
        return EFFECTS[self.kind]


@dataclass(frozen=True)
class OperatingPoint:
    """The steady motion that a system is linearised about: what of it is stated; the rest follows from the equations.

    Attributes
    ----------
    speeds : tuple of (str, float)
        Speeds of inertias, rad/s; without any, the speed follows from the balance of torques.
    torques : tuple of (str, float)
        Torques of inputs, N·m, of a pedal 0 to 1. Inputs that are not named are solved for.
    """

    speeds: tuple[tuple[str, float], ...] = ()
    torques: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True)
class Components:
    """All parts of one drivetrain, in the order of the file; not checked, see :class:`modelling.system.System`.

    Attributes
    ----------
    inertias, shafts, gears, differentials, inputs, sensors, effects, planetary_gears, gearboxes : tuple
        The components.
    mirror : tuple of pairs of str
        Names of inertias that left/right symmetry swaps.
    title, reference : str
        A title, and the inertia to whose shaft reduced values are reported.
    operating_point : OperatingPoint or None
        Linear models are taken about this motion, at rest without one. No part of a model file: a case states it.
    """

    inertias: tuple[Inertia, ...]
    shafts: tuple[Shaft, ...] = ()
    gears: tuple[Gear, ...] = ()
    differentials: tuple[Differential, ...] = ()
    inputs: tuple[Input, ...] = ()
    sensors: tuple[Sensor, ...] = ()
    mirror: tuple[tuple[str, str], ...] = ()
    effects: tuple[Effect, ...] = ()
    title: str = ""
    reference: str = ""
    operating_point: OperatingPoint | None = None
    planetary_gears: tuple[PlanetaryGear, ...] = ()
    gearboxes: tuple[Gearbox, ...] = ()

    @functools.cached_property
    def imposed_by(self) -> dict[str, Kind]:
        """By input that measures a motion: the kind of effect that imposes it."""
        imposing = {effect.at: effect.law for effect in self.effects if effect.law.imposes_motion}
        places = {part.name: f"inertias.{part.on}" for part in self.inputs if part.measures != "torque"}
        return {name: imposing[place] for name, place in places.items() if place in imposing}

    @property
    def held(self) -> frozenset[str]:
        """Places of inertias whose motion is imposed: by a recording, or held still."""
        return frozenset(effect.at for effect in self.effects if effect.law.imposes_motion)

    @property
    def brakes(self) -> tuple[str, ...]:
        """Inputs that are the torque of a brake."""
        braked = {place for effect in self.effects if effect.law.brakes for place in effect.places}
        return tuple(part.name for part in self.inputs if f"inputs.{part.name}" in braked)

    @functools.cached_property
    def pedals(self) -> dict[str, PedalMap]:
        """By input that is a pedal: its torque map."""
        return {
            place.removeprefix("inputs."): PedalMap.of({key: own.value for key, own in effect.parameters})
            for effect in self.effects if effect.kind in EFFECTS and effect.law.pedal for place in effect.places
        }  # fmt: skip

    @property
    def capacities(self) -> tuple[str, ...]:
        """Inputs that are the torque that a clutch can carry."""
        return tuple(name for box in self.gearboxes for name in box.capacities)

    @property
    def input_quantities(self) -> dict[str, str]:
        """By input: ``torque``, the ``speed`` or ``angle`` that it imposes, or ``pedal``."""
        pedals = {place for effect in self.effects if effect.law.pedal for place in effect.places}
        stated = {part.name: "pedal" for part in self.inputs if f"inputs.{part.name}" in pedals}
        return {
            part.name: stated.get(part.name) or part.measures or ("speed" if part.name in self.imposed_by else "torque")
            for part in self.inputs
        }

    @property
    def input_units(self) -> dict[str, str]:
        """SI unit of each input."""
        units = {**INPUT_UNITS, "pedal": PEDAL_UNIT}
        return {name: units[quantity] for name, quantity in self.input_quantities.items()}

    @property
    def input_references(self) -> list[str]:
        """Channels that controllers of inputs follow, where they were stated; none is an input or a sensor."""
        return [part.reference for part in self.inputs if part.reference]

    @property
    def further_signals(self) -> list[str]:
        """Channels of any dimension beside inputs and sensors: references of controllers, gears engaged."""
        return [*self.input_references, *(box.name for box in self.gearboxes)]

    def inputs_to_record(self, channels: Collection[str]) -> list[Input]:
        """Inputs that a recording needs; what clutches can carry is none where a channel has the number of the gear."""
        told = {name for box in self.gearboxes if box.name in channels for name in box.capacities}
        return [part for part in self.inputs if part.name in channels or part.name not in told]

    def places(self) -> Iterator[str]:
        """Every ``table.name``."""
        for table in TABLES:
            for part in getattr(self, table):
                yield f"{table}.{part.name}"

    @functools.cached_property
    def parameters(self) -> dict[str, Quantity]:
        """Every quantity by its full name, e.g. ``shafts.link.stiffness``, in the order of the parameter vector (p)."""
        found: dict[str, Quantity] = {}
        for table in TABLES_WITH_QUANTITIES:
            for part in getattr(self, table):
                found |= {f"{table}.{part.name}.{key}": own for key, own in quantities(part).items()}
        for effect in self.effects:
            for key, quantity in effect.parameters:
                found[f"{effect.name}.{key}"] = quantity
        return found


def resistance(at: str, exponent: int, coefficient: float) -> Effect:
    """The effect on an inertia whose torque coefficient·speed^exponent resists, SI."""
    law = next(law for law in EFFECTS.values() if law.speed_exponent == exponent)
    return Effect(law.kind, at, tuple((key, Quantity(coefficient)) for key in law.parameters))


def clock_error(places: Iterable[str], largest: float) -> Effect:
    """The effect on the channels of a logger whose clock is late by an uncertain time, at most ``largest`` s."""
    law = next(law for law in EFFECTS.values() if law.is_clock)
    return Effect(
        law.kind, shared_place(places), tuple((key, Quantity(0.0, -largest, largest)) for key in law.parameters)
    )


# --- Checks that components make a system: names, ends, signs, and that all are connected.

WIDEST_PLAY = 0.5  # rad: all play of a geared chain together is seldom 10 degrees at the wheel, 29 nowhere
FASTEST_DOG = 30.0  # rad/s of slip, 290 1/min: dog clutches without a synchroniser engage below 50 to 150 1/min
RPM = math.pi / 30  # rad/s
MOST_COMPONENTS = 10_000  # a chain of 3000 inertias has 6000; a model of them takes some ten seconds
_NAME = re.compile(r"\w[\w-]{0,199}")


def check(system: Components) -> None:
    """Check values, references and connections of a system.

    Raises
    ------
    InputError
        Naming the key that is wrong.
    """
    if not system.inertias:
        raise InputError("inertias", "the model has none", "at least one [inertias.NAME] with J is needed")
    size = sum(len(getattr(system, table)) for table in (*TABLES, "effects"))
    if size > MOST_COMPONENTS:
        raise InputError("model", f"has {size} components and effects", f"at most {MOST_COMPONENTS} are handled")
    _names(system)
    inertias = dict.fromkeys(part.name for part in system.inertias)
    for part in system.inertias:
        _sign(f"inertias.{part.name}.J", part.J, positive=True)
        _sign(f"inertias.{part.name}.drag", part.drag)
    for shaft in system.shafts:
        _ends(f"shafts.{shaft.name}.between", shaft.between, inertias)
        _sign(f"shafts.{shaft.name}.stiffness", shaft.stiffness)
        _sign(f"shafts.{shaft.name}.damping", shaft.damping)
        _ratio(f"shafts.{shaft.name}.ratio", shaft.ratio)
    for gear in system.gears:
        _ends(f"gears.{gear.name}.between", gear.between, inertias)
        _ratio(f"gears.{gear.name}.ratio", gear.ratio)
    for differential in system.differentials:
        _ends(f"differentials.{differential.name}", differential.ends, inertias)
    for planetary in system.planetary_gears:
        _ends(f"planetary_gears.{planetary.name}", planetary.ends, inertias)
        _sign(f"planetary_gears.{planetary.name}.ratio", planetary.ratio, positive=True)
    for source in system.inputs:
        if source.on not in inertias:
            raise unknown(source.on, list(inertias), f"inputs.{source.name}.on")
    _imposed(system)
    shafts = dict.fromkeys(part.name for part in system.shafts)
    for sensor in system.sensors:
        _sensor(sensor, shafts if sensor.measures == "torque" else inertias)
    for pair in system.mirror:
        _ends("mirror.pairs", pair, inertias)
    mirrored = [name for pair in system.mirror for name in pair]
    if len(set(mirrored)) < len(mirrored):
        raise InputError("mirror.pairs", "an inertia stands in two pairs", "each inertia has one mirror image")
    if system.reference and system.reference not in inertias:
        raise unknown(system.reference, list(inertias), "reference")
    _effects(system)
    _pedals(system)
    for box in system.gearboxes:
        _gearbox(box, system, inertias)
    _connected(system, inertias)
    _operating_point(system, inertias)


def _names(system: Components) -> None:
    for table in TABLES:
        names = set()
        for part in getattr(system, table):
            if not _NAME.fullmatch(part.name):
                raise InputError(
                    f"{table}.{part.name[:40]!r}", "is no usable name", "use up to 200 letters, digits, _ and -"
                )
            if part.name in names:
                raise InputError(f"{table}.{part.name}", "the name is taken twice", "names must differ within a table")
            names.add(part.name)
    both = {part.name for part in system.inputs} & {part.name for part in system.sensors}
    if both:
        raise InputError(
            f"sensors.{min(both)}", "an input has the same name", "inputs and sensors share the columns of a recording"
        )
    taken = {source.name for source in system.inputs} | {sensor.name for sensor in system.sensors}
    for source in system.inputs:
        if source.reference in taken:
            raise InputError(
                f"inputs.{source.name}.reference", f"{source.reference!r} is an input or a sensor",
                "name the channel with what the controller was to follow",
            )  # fmt: skip


def _sign(where: str, quantity: Quantity, positive: bool = False) -> None:
    low = quantity.value if quantity.lower is None else min(quantity.lower, quantity.value)
    if low < 0 or (positive and low == 0):
        bound = "greater than 0" if positive else "0 or more"
        raise InputError(where, f"{low:g} is not possible", f"{bound} is needed")


def _ratio(where: str, quantity: Quantity | None) -> None:
    if quantity is None:
        return
    low, high = (quantity.value if end is None else end for end in (quantity.lower, quantity.upper))
    if low <= 0 <= high:
        raise InputError(where, "a ratio of 0 connects nothing", "write speed(first)/speed(second)")


def _ends(where: str, ends: tuple[str, ...], inertias: Collection[str]) -> None:
    for end in ends:
        if end not in inertias:
            raise unknown(end, list(inertias), where)
    if len(set(ends)) < len(ends):
        raise InputError(where, f"joins {ends[0]!r} to itself", "name different inertias")


def _converter(box: Gearbox, where: str) -> None:
    """Check the tables of a converter, and that its only gear has a clutch of friction.

    Raises
    ------
    InputError
        Naming the key that is wrong.
    """
    converter = box.converter
    assert converter is not None
    if len(box.ratios) != 1 or box.engages_below is not None:
        wrong = "stands beside dog clutches" if box.engages_below is not None else f"has {len(box.ratios)} gears"
        raise InputError(where, wrong, "give it a gearbox of its own: one ratio, and its lock-up clutch")
    points, tables = converter.speed_ratios, converter.written()
    for key, values in tables.items():
        if len(values) != len(points) or len(values) < 2:
            raise InputError(f"{where}.{key}", f"has {len(values)} values", f"{max(len(points), 2)}, one a point")
        if not all(math.isfinite(value) for value in values):
            raise InputError(f"{where}.{key}", "holds no finite number", "give finite numbers")
    if any(after <= before for before, after in itertools.pairwise(points)):
        raise InputError(f"{where}.speed_ratios", "do not rise", "sort the points by turbine speed over pump speed")
    driven = [(at, factor) for at, factor in zip(points, converter.capacity_factors, strict=True) if at < 1]
    if wrong := next((f"{factor:g} at the speed ratio {at:g}" for at, factor in driven if factor < 0), ""):
        raise InputError(
            f"{where}.capacity_factors", f"is {wrong}: the turbine would drive the pump",
            "0 or more below the speed ratio 1, negative beyond it",
        )  # fmt: skip
    if min(converter.torque_ratios) < 0:
        raise InputError(f"{where}.torque_ratios", f"{min(converter.torque_ratios):g} is not possible", "0 or more")


LEAST_DEFLECTION = 5e-4  # rad: slip over it is an eigenvalue, 1e5 1/s at 50 rad/s; faster ones were not integrated


def _gearbox(box: Gearbox, system: Components, inertias: Collection[str]) -> None:
    """Check the gears of a gearbox, and that every clutch is an input of its own at the first inertia.

    Raises
    ------
    InputError
        Naming the key that is wrong.
    """
    where = f"gearboxes.{box.name}"
    _ends(f"{where}.between", box.between, inertias)
    if not box.ratios:
        raise InputError(f"{where}.ratios", "there is no gear", "write ratios = [first, second, …]")
    for ratio in box.ratios:
        _ratio(f"{where}.ratios", ratio)
    least = box.deflection.ends[0]
    if least < LEAST_DEFLECTION:
        raise InputError(f"{where}.deflection", f"{least:g} is not possible", f"{LEAST_DEFLECTION:g} rad or more")
    _sign(f"{where}.settling", box.settling or Quantity(0.0))
    if box.engages_below is not None:
        _sign(f"{where}.engages_below", box.engages_below, positive=True)
    if box.converter is not None:
        _converter(box, f"{where}.converter")
    if len(box.capacities) != len(box.ratios) and not (box.converter is not None and not box.capacities):
        wrong = f"names {len(box.capacities)} inputs for {len(box.ratios)} ratios"
        raise InputError(f"{where}.capacities", wrong, "name the input of each gear's clutch")
    inputs, measures = {part.name: part for part in system.inputs}, system.input_quantities
    for name in box.capacities:
        if name not in inputs:
            raise unknown(name, list(inputs), f"{where}.capacities")
        if inputs[name].on != box.between[0] or measures[name] != "torque":
            right = f'[inputs.{name}] on = "{box.between[0]}", the first inertia of the gearbox'
            raise InputError(f"inputs.{name}", f"is the torque of a clutch of {where}", right)
        if name in system.brakes:
            raise InputError(f"inputs.{name}", "is the torque of a clutch and of a brake", "leave out the effect brake")
        if system.capacities.count(name) > 1:
            raise InputError(f"{where}.capacities", f"{name!r} stands twice", "each clutch has an input of its own")
    if any(gear.name == box.name for gear in system.gears):
        raise InputError(where, f"gears.{box.name} has the same name", "in one gear it is a gear; give another name")


def _imposed(system: Components) -> None:
    """Check that inputs measure a motion only where it is imposed, and one each."""
    imposed = {e.at.split(".")[1] for e in system.effects if e.kind in EFFECTS and EFFECTS[e.kind].imposes_motion}
    driven = set[str]()
    for source in system.inputs:
        if source.measures not in (None, *INPUT_UNITS):
            raise unknown(str(source.measures), list(INPUT_UNITS), f"inputs.{source.name}.measures")
        if source.measures in (None, "torque") and not (source.measures is None and source.on in imposed):
            continue
        where = f"inputs.{source.name}"
        if source.on not in imposed:
            right = f"[[effects]] imposed_motion at inertias.{source.on}, or a torque"
            raise InputError(f"{where}.measures", f"nothing imposes the motion of {source.on!r}", right)
        if source.on in driven:
            raise InputError(f"{where}.on", f"the motion of {source.on!r} is recorded twice", "one input for it")
        driven.add(source.on)


def _pedals(system: Components) -> None:
    """Check that a pedal is nothing else: no brake, no clutch, no imposed motion, no measured torque.

    Raises
    ------
    InputError
        Naming the input.
    """
    for part in system.inputs:
        if part.name not in system.pedals:
            continue
        where = f"inputs.{part.name}"
        if part.name in system.brakes or part.name in system.capacities:
            wrong = "is a pedal with a torque map, and the torque of a brake or a clutch"
            raise InputError(where, wrong, "give the torque map an input of its own")
        if part.measures is not None or f"inertias.{part.on}" in system.held:
            wrong = f"is a pedal with a torque map, and measures a {part.measures or 'speed'}"
            raise InputError(where, wrong, "leave out measures, or the torque map")


def _sensor(part: Sensor, known: Collection[str]) -> None:
    where = f"sensors.{part.name}"
    if part.measures not in SENSOR_UNITS:
        raise unknown(part.measures, list(SENSOR_UNITS), f"{where}.measures")
    if part.of not in known:
        raise unknown(part.of, list(known), f"{where}.of")
    if part.uncertainty is not None and not part.uncertainty > 0:
        raise InputError(f"{where}.uncertainty", f"{part.uncertainty:g} is not possible", "greater than 0 is needed")


def _effects(system: Components) -> None:
    names = set[tuple[str, str]]()
    places: dict[str, dict[str, None]] = {}
    for number, effect in enumerate(system.effects, 1):
        where = f"effects[{number}]"
        if effect.kind not in EFFECTS:
            raise unknown(effect.kind, sorted(EFFECTS), f"{where}.kind")
        kind = EFFECTS[effect.kind]
        if effect.kind not in places:
            places[effect.kind] = dict.fromkeys(kind.places(system))
        for place in effect.places:
            if place not in places[effect.kind]:
                raise unknown(place, list(places[effect.kind]), f"{where}.at")
        if len(effect.places) > 1 or kind.follows:
            _shared(kind, effect, where)
        _effect(kind, effect, system, where)
        for place in effect.places:
            if (effect.kind, place) in names:
                raise InputError(where, f"{effect.kind} stands twice at {place}", "one of a kind at a place")
            names.add((effect.kind, place))


def _shared(kind: Kind, effect: Effect, where: str) -> None:
    """Check that several places can share an effect.

    Raises
    ------
    InputError
        If the kind cannot be shared, or a place stands twice.
    """
    if kind.follows:
        _followed(effect, where)
    elif not kind.shareable:
        shareable = listed(sorted(name for name, other in EFFECTS.items() if other.shareable))
        raise InputError(
            f"{where}.at", f"{effect.kind} cannot be shared by several places", f"one place; {shareable} can"
        )
    if len(set(effect.places)) < len(effect.places):
        raise InputError(f"{where}.at", "names a place twice", "each place once")


def _followed(effect: Effect, where: str) -> None:
    """Check that an effect names the inertia it acts on and the one it follows.

    Raises
    ------
    InputError
        If these are not two.
    """
    if len(effect.places) != 2:
        raise InputError(
            f"{where}.at", f"{effect.kind} needs two inertias", 'at = ["inertias.acted_on", "inertias.followed"]'
        )


def _effect(kind: Kind, effect: Effect, system: Components, where: str) -> None:
    """Check keys and bounds of one effect.

    Raises
    ------
    InputError
        Naming the key that is wrong.
    """
    quantities = dict(effect.parameters)
    for key in quantities:
        if key not in kind.parameters:
            raise unknown(key, list(kind.parameters), f"{where} ({effect.kind})")
    for key, parameter in kind.parameters.items():
        if key not in quantities:
            if parameter.optional:
                continue
            raise InputError(
                f"{where} ({effect.kind})",
                f"{key!r} is missing",
                f"give a number{in_unit(kind.unit(key, effect.at, system))}",
            )
        value = quantities[key].value
        if not parameter.lower <= value <= parameter.upper:
            raise InputError(
                f"{where}.{key}",
                f"{value:g} is not possible",
                f"{parameter.lower:g} … {parameter.upper:g} is needed",
            )
    if fault := kind.fault(effect.at, {key: quantity.value for key, quantity in quantities.items()}):
        raise InputError(f"{where} ({effect.kind})", fault, "see docs/files.md")


def _connected(system: Components, inertias: Collection[str]) -> None:
    across = [Joint(f"gearboxes.{box.name}", box.between) for box in system.gearboxes]
    parts = connected_parts(inertias, [*joints(system), *across])
    driven = {source.on for source in system.inputs}
    apart = [name for part in parts[1:] if not driven & set(part) for name in part]
    if apart or (len(parts) > 1 and not driven & set(parts[0])):
        raise InputError(
            "inertias",
            f"{listed(apart or parts[1])} are not connected to {next(iter(inertias))!r}",
            "add the missing shaft or gear; parts that stand apart each need an input that drives them",
        )


def _operating_point(system: Components, inertias: Collection[str]) -> None:
    point, inputs = system.operating_point, [source.name for source in system.inputs]
    for name, _ in point.speeds if point else ():
        if name not in inertias:
            raise unknown(name, list(inertias), "operating_point.speed")
    for name, _ in point.torques if point else ():
        if name not in inputs:
            raise unknown(name, inputs, "operating_point.torque")


# --- System


@dataclass(frozen=True, repr=False)
class System(Components):
    """One drivetrain: its components, checked and frozen.

    Names of quantities are ``table.name.quantity``, those of an effect ``table.name.kind.quantity``. Systems are
    values: methods that change something return a new system.

    Raises
    ------
    InputError
        From :func:`modelling.system.check` at construction, if the components do not make a system.
    """

    def __post_init__(self) -> None:
        check(self)

    def __hash__(self) -> int:
        return self._hash

    @functools.cached_property
    def _hash(self) -> int:  # every component is hashed for it, and each look-up of the compiled model asks for it
        return hash(tuple(getattr(self, own.name) for own in fields(self)))

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name != "_hash"}  # texts hash by process

    @functools.cached_property
    def units(self) -> dict[str, str]:
        """SI unit of every parameter, same keys as :attr:`parameters`."""
        units = {
            f"{table}.{part.name}.{key}": quantity_unit(key)
            for table in TABLES_WITH_QUANTITIES
            for part in getattr(self, table)
            for key in quantities(part)
        }
        for effect in self.effects:
            for key, _ in effect.parameters:
                units[f"{effect.name}.{key}"] = effect.law.unit(key, effect.at, self)
        return units

    @property
    def free_plays(self) -> dict[str, str]:
        """Parameter that is the total free play of a shaft (rad), by the shaft's place ``shafts.NAME``."""
        return {effect.at: f"{effect.name}.{effect.law.free_play}" for effect in self.effects if effect.law.free_play}

    @property
    def doubts(self) -> list[str]:
        """A note on every free play that is wider than any drivetrain's: in degrees, perhaps; and on every dog clutch
        that engages at more slip than teeth find their gaps at: in 1/min, perhaps."""
        values = self.parameters
        fast = [
            f"gearboxes.{box.name}.engages_below is {box.engages_below.value:g} rad/s, "
            f"{box.engages_below.value / RPM:.0f} 1/min: is it meant in 1/min?"
            for box in self.gearboxes if box.engages_below is not None and box.engages_below.value > FASTEST_DOG
        ]  # fmt: skip
        return fast + [
            f"{name} is {values[name].value:g} rad, {math.degrees(values[name].value):.0f} deg: is it meant in degrees?"
            for name in self.free_plays.values() if values[name].value > WIDEST_PLAY
        ]  # fmt: skip

    @property
    def uncertain(self) -> dict[str, Quantity]:
        """The parameters that have a range, by name."""
        return {name: quantity for name, quantity in self.parameters.items() if quantity.uncertain}

    def __getitem__(self, place: str) -> Component | Quantity:
        """The component at ``table.name``, or the quantity ``table.name.quantity``.

        Raises
        ------
        InputError
            If there is none, with the nearest name.
        """
        table, _, name = place.partition(".")
        if table in TABLES:
            for part in getattr(self, table):
                if part.name == name:
                    return part
        if place in self.parameters:
            return self.parameters[place]
        raise unknown(place, [*self.places(), *self.parameters], "")

    @functools.cached_property
    def dimensions(self) -> dict[str, Quantity]:
        """Length and diameters (m) of the shafts that are stated by their drawing, as ``shafts.NAME.diameter``."""
        return {
            f"shafts.{shaft.name}.{key}": getattr(shaft.drawing, key)
            for shaft in self.shafts
            if shaft.drawing is not None
            for key in MOVABLE_DIMENSIONS
        }

    def in_si(self, values: Mapping[str, float | str]) -> dict[str, float]:
        """Values of parameters and dimensions by name, SI or texts with a unit, all in SI; raises as
        :meth:`with_values`."""
        for name in values:
            if name not in self.parameters and name not in self.dimensions:
                raise unknown(name, [*self.parameters, *self.dimensions], "")
        return {
            name: to_si(value, self.units.get(name, "m"), name) if isinstance(value, str) else value
            for name, value in values.items()
        }

    def with_sizes(self, values: Mapping[str, float]) -> dict[str, float]:
        """Values by name, SI, and next to them the stiffness and inertias that dimensions among them make.

        A stiffness or inertia that is stated itself stays as it is stated.

        Raises
        ------
        InputError
            If a dimension is impossible.
        """
        if self.dimensions.keys().isdisjoint(values):
            return dict(values)
        made: dict[str, float] = {}
        for shaft in self.shafts:
            place = f"shafts.{shaft.name}"
            own = {key: values[name] for key in MOVABLE_DIMENSIONS if (name := f"{place}.{key}") in values}
            if shaft.drawing is None or not own:
                continue
            try:
                drawn = shaft.drawing.with_sizes(own)
            except InputError as fault:
                raise InputError(f"{place}.{fault.where}", fault.wrong, fault.right) from None
            made[f"{place}.stiffness"] = drawn.stiffness.value
            for end in (f"inertias.{name}.J" for name in shaft.between):
                more = (drawn.inertia.value - shaft.drawing.inertia.value) / 2
                made[end] = made.get(end, self.parameters[end].value) + more
        return {**made, **values}

    def with_values(self, values: Mapping[str, float | str], *, designed: bool = False) -> System:
        """The same system at other parameter values (as :meth:`in_si`); ``designed`` so, their ranges go with them.

        With a dimension of a shaft its stiffness and the inertias of its ends change, see :meth:`with_sizes`.

        Raises
        ------
        InputError
            If a name is unknown or a value impossible.
        """
        values = self.with_sizes(self.in_si(values))
        tables: dict[str, Any] = {
            table: tuple(_with_values(part, f"{table}.{part.name}", values, designed) for part in getattr(self, table))
            for table in TABLES_WITH_QUANTITIES
        }
        effects = tuple(_effect_with_values(effect, values) for effect in self.effects)
        return dataclasses.replace(self, effects=effects, **tables)

    def with_ranges(self, ranges: Mapping[str, tuple[float, float]]) -> System:
        """The same system with other ranges (lower, upper), SI, of quantities by name; values stay."""
        tables: dict[str, Any] = {}
        for table in TABLES_WITH_QUANTITIES:
            parts = []
            for part in getattr(self, table):
                known = quantities(part)
                own = {key: ranges[name] for key in known if (name := f"{table}.{part.name}.{key}") in ranges}
                parts.append(_with_quantities(part, {key: Quantity(known[key].value, *own[key]) for key in own}))
            tables[table] = tuple(parts)
        return dataclasses.replace(self, **tables)

    def with_effects(self, *effects: Effect) -> System:
        """The same system with further effects."""
        return dataclasses.replace(self, effects=self.effects + effects)

    def in_gear(self, gear: int | Mapping[str, int] = 1) -> System:
        """The drivetrain in one gear: the gear's clutch is locked, so that the gearbox is a rigid gear of its name.

        The torques that the clutches can carry are no inputs any more. A drivetrain without a gearbox stays as it is.

        Parameters
        ----------
        gear : int or mapping of str to int
            Number of the gear, 1 the first; by gearbox where there are several. 0 is a converter whose lock-up clutch
            is open: it stays, and a linear model holds it about an operating point.

        Raises
        ------
        InputError
            If there is no such gearbox or gear.
        """
        if not self.capacities:
            return self
        chosen = dict.fromkeys((box.name for box in self.gearboxes), gear) if isinstance(gear, int) else gear
        for name in chosen:
            if all(name != box.name for box in self.gearboxes):
                raise unknown(name, [box.name for box in self.gearboxes], "gear")
        held, open_ones = [], []
        for box in self.gearboxes:
            number, most = chosen.get(box.name, 1 if box.capacities else 0), len(box.ratios)
            if number == 0 and box.converter is not None:
                open_ones.append(dataclasses.replace(box, capacities=()))
                continue
            if not 1 <= number <= most:
                raise InputError(f"gearboxes.{box.name}", f"has no gear {number}", f"1 to {most}")
            held.append(Gear(box.name, box.between, box.ratios[number - 1]))
        gone, point = set(self.capacities), self.operating_point
        if point is not None:
            kept = tuple((name, torque) for name, torque in point.torques if name not in gone)
            point = dataclasses.replace(point, torques=kept)
        return dataclasses.replace(
            self, gears=(*self.gears, *held), gearboxes=tuple(open_ones), operating_point=point,
            inputs=tuple(part for part in self.inputs if part.name not in gone),
            effects=tuple(_without_places(effect, {f"inputs.{name}" for name in gone}) for effect in self.effects
                          if not {place.removeprefix("inputs.") for place in effect.places} <= gone),
        )  # fmt: skip

    def shifting(self, live: System, carried: Mapping[str, float]) -> System:
        """The drivetrain in one gear with clutches that carry torques again, as inputs; all else as it is.

        Parameters
        ----------
        live : System
            The drivetrain of which this one is in a gear.
        carried : mapping of str to float
            N·m by input: what the clutches carry at the operating point. Gearboxes of which none is named stay in their
            gear.
        """
        boxes = tuple(box for box in live.gearboxes if not carried.keys().isdisjoint(box.capacities))
        names, back = {box.name for box in boxes}, [name for box in boxes for name in box.capacities]
        places, point = {f"inputs.{name}" for name in back}, self.operating_point
        if point is not None:
            torques = tuple((name, carried.get(name, 0.0)) for name in back)
            point = dataclasses.replace(point, torques=(*point.torques, *torques))
        return dataclasses.replace(
            self, operating_point=point, gears=tuple(gear for gear in self.gears if gear.name not in names),
            gearboxes=(*(box for box in self.gearboxes if box.name not in names), *boxes),
            inputs=(*self.inputs, *(part for part in live.inputs if part.name in back)),
            effects=(*self.effects, *(effect for effect in live.effects if set(effect.places) <= places)),
        )  # fmt: skip

    @property
    def gears_of_gearboxes(self) -> list[dict[str, int]]:
        """Every choice of a gear by gearbox, the first gears first, an open converter (0) last; none without a
        gearbox."""
        choices = ([*range(1, len(box.ratios) + 1), *([0] if box.converter else [])] for box in self.gearboxes)
        every = itertools.product(*choices)
        return [dict(zip((box.name for box in self.gearboxes), one, strict=True)) for one in every if one]

    def __repr__(self) -> str:
        names = ("inertias", "shafts", "gears", "gearboxes", "inputs", "sensors", "effects")
        tables = ((name, getattr(self, name)) for name in names)
        return f"System({', '.join(f'{len(parts)} {name}' for name, parts in tables if parts)})"

    def _repr_html_(self) -> str:
        return display.html(self)


def _without_places(effect: Effect, places: Collection[str]) -> Effect:
    """An effect without some of the places that share it."""
    kept = [place for place in effect.places if place not in places]
    return effect if len(kept) == len(effect.places) else dataclasses.replace(effect, at=shared_place(kept))


def _with_values(part: Any, place: str, values: Mapping[str, float], designed: bool) -> Any:
    moved = Quantity.designed if designed else Quantity.at
    changed: dict[str, Any] = {
        key: moved(own, float(values[f"{place}.{key}"]))
        for key, own in quantities(part).items()
        if f"{place}.{key}" in values
    }
    drawing = getattr(part, "drawing", None)
    sizes = {key: float(values[f"{place}.{key}"]) for key in MOVABLE_DIMENSIONS if f"{place}.{key}" in values}
    if drawing is not None and sizes:
        changed["drawing"] = drawing.with_sizes(sizes, designed=designed)
    return _with_quantities(part, changed)


def _with_quantities(part: Any, changed: Mapping[str, Any]) -> Any:
    if not changed:
        return part
    return part.with_quantities(changed) if isinstance(part, Gearbox) else dataclasses.replace(part, **changed)


def _effect_with_values(effect: Effect, values: Mapping[str, float]) -> Effect:
    parameters = tuple(
        (key, quantity.at(values[f"{effect.name}.{key}"]) if f"{effect.name}.{key}" in values else quantity)
        for key, quantity in effect.parameters
    )
    return dataclasses.replace(effect, parameters=parameters)


# --- Mirror images by name: which inertia, shaft or quantity left/right symmetry swaps with which.


def mirror_image(name: str, system: System) -> str:
    """The name of the mirror image; the name itself where it has none.

    Parameters
    ----------
    name : str
        ``table.name`` or ``table.name.quantity``.
    system : System
        Its ``mirror`` pairs inertias; shafts and gears follow from their ends.
    """
    return mirror_images([name], system)[0]


def mirror_images(names: Sequence[str], system: System) -> list[str]:
    """The mirror image of each name, see :func:`mirror_image`."""
    swap = {a: b for pair in system.mirror for a, b in (pair, pair[::-1])}
    ends_of = {table: _ends_by_name(getattr(system, table)) for table in ("shafts", "gears")}
    images = []
    for name in names:
        table, _, rest = name.partition(".")
        part, _, quantity = rest.partition(".")
        image = swap.get(part, part) if table == "inertias" else part
        ends, by_ends = ends_of.get(table, ({}, {}))
        if part in ends:
            first, second = ends[part]
            image = by_ends.get((swap.get(first, first), swap.get(second, second)), part)
        images.append(f"{table}.{image}" + (f".{quantity}" if quantity else ""))
    return images


def _ends_by_name(parts: Sequence[Shaft | Gear]) -> tuple[dict[str, tuple[str, str]], dict[tuple[str, str], str]]:
    """Ends by name, and the first name by ends."""
    return {part.name: part.between for part in parts}, {part.between: part.name for part in reversed(parts)}
