"""The components of a drivetrain: inertias, what connects them, inputs, sensors, and effects on them."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from modelling.effects import EFFECTS, Kind
from modelling.effects.place import members, shared_place
from modelling.model.quantity import Quantity
from modelling.units import INPUT_UNITS, QUANTITY_UNITS, SENSOR_UNITS

TABLES = ("inertias", "shafts", "gears", "differentials", "inputs", "sensors")
TABLES_WITH_QUANTITIES = ("inertias", "shafts", "gears")


@dataclass(frozen=True)
class Inertia:
    """A rigid body that rotates: inertia ``J`` (kg·m²), viscous ``drag`` to ground (N·m·s/rad)."""

    name: str
    J: Quantity
    drag: Quantity = Quantity(0.0)


@dataclass(frozen=True)
class Shaft:
    """A spring and damper: twist = angle(first)/ratio − angle(second), stiffness and torque on the second's side.

    ``stiffness`` in N·m/rad, ``damping`` in N·m·s/rad.
    """

    name: str
    between: tuple[str, str]
    stiffness: Quantity
    damping: Quantity = Quantity(0.0)
    ratio: Quantity | None = None


@dataclass(frozen=True)
class Gear:
    """A rigid, ideal gear: speed(first) = ratio · speed(second)."""

    name: str
    between: tuple[str, str]
    ratio: Quantity


@dataclass(frozen=True)
class Differential:
    """An open, ideal differential: 2·speed(cage) = speed(left) + speed(right)."""

    name: str
    cage: str
    left: str
    right: str


@dataclass(frozen=True)
class Input:
    """A torque (N·m) on the inertia ``on``; where an effect imposes its motion, its speed (rad/s) or angle (rad).

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

    ``uncertainty`` is the standard uncertainty (k = 1) in the SI unit of the reading, or None.
    """

    name: str
    measures: str
    of: str
    uncertainty: float | None = None

    @property
    def unit(self) -> str:
        """SI unit of the reading."""
        return SENSOR_UNITS[self.measures]


@dataclass(frozen=True)
class Effect:
    """One effect beyond the linear chain: its ``kind``, the place ``at`` which it acts, and its parameters by key.

    Several inputs or sensors share it where ``at`` is of :func:`modelling.effects.place.shared_place`.
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
        Torques of inputs, N·m. Inputs that are not named are solved for.
    """

    speeds: tuple[tuple[str, float], ...] = ()
    torques: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True)
class Components:
    """All parts of one drivetrain, in the order of the file; not checked, see :class:`modelling.model.system.System`.

    Attributes
    ----------
    inertias, shafts, gears, differentials, inputs, sensors, effects : tuple
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

    @functools.cached_property
    def imposed_by(self) -> dict[str, Kind]:
        """By input that measures a motion: the kind of effect that imposes it."""
        imposing = {effect.at: effect.law for effect in self.effects if effect.law.imposes_motion}
        places = {part.name: f"inertias.{part.on}" for part in self.inputs if part.measures != "torque"}
        return {name: imposing[place] for name, place in places.items() if place in imposing}

    @property
    def input_quantities(self) -> dict[str, str]:
        """By input: ``torque``, or the ``speed`` or ``angle`` that it imposes."""
        return {
            part.name: part.measures or ("speed" if part.name in self.imposed_by else "torque") for part in self.inputs
        }

    @property
    def input_units(self) -> dict[str, str]:
        """SI unit of each input."""
        return {name: INPUT_UNITS[quantity] for name, quantity in self.input_quantities.items()}

    @property
    def input_references(self) -> list[str]:
        """Channels that controllers of inputs follow, where they were stated; none is an input or a sensor."""
        return [part.reference for part in self.inputs if part.reference]

    def places(self) -> Iterator[str]:
        """Every ``table.name``."""
        for table in TABLES:
            for part in getattr(self, table):
                yield f"{table}.{part.name}"

    @functools.cached_property
    def parameters(self) -> dict[str, Quantity]:
        """Every quantity by its full name, e.g. ``shafts.link.stiffness``, in the order of the parameter vector (p)."""
        quantities: dict[str, Quantity] = {}
        for table in TABLES_WITH_QUANTITIES:
            for part in getattr(self, table):
                for key in QUANTITY_UNITS:
                    quantity = getattr(part, key, None)
                    if quantity is not None:
                        quantities[f"{table}.{part.name}.{key}"] = quantity
        for effect in self.effects:
            for key, quantity in effect.parameters:
                quantities[f"{effect.name}.{key}"] = quantity
        return quantities


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
