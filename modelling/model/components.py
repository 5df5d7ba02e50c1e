"""The components of a drivetrain: inertias, what joins them, what drives and measures them, and effects on them."""

from __future__ import annotations

from dataclasses import dataclass

from modelling.effects import EFFECTS, Kind
from modelling.model.quantity import Quantity
from modelling.units import SENSOR_UNITS

TABLES = ("inertias", "shafts", "gears", "differentials", "inputs", "sensors")


@dataclass(frozen=True)
class Inertia:
    """A rigid body on a shaft line: inertia ``J`` (kg·m²), viscous ``drag`` to ground (N·m·s/rad)."""

    name: str
    J: Quantity
    drag: Quantity = Quantity(0.0)


@dataclass(frozen=True)
class Shaft:
    """A spring and damper: twist = angle(first)/ratio − angle(second); stiffness and torque on the second's side."""

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
    """A torque (N·m) on the inertia ``on``."""

    name: str
    on: str


@dataclass(frozen=True)
class Sensor:
    """A reading: ``measures`` angle, speed or acceleration of an inertia or torque of a shaft; standard uncertainty."""

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
    """Something beyond the linear chain: a ``kind`` of the vocabulary at ``table.name`` with its parameters."""

    kind: str
    at: str
    parameters: tuple[tuple[str, Quantity], ...] = ()

    @property
    def name(self) -> str:
        """How its parameters begin in reports: ``shafts.link.backlash``."""
        return f"{self.at}.{self.kind}"

    @property
    def law(self) -> Kind:
        """What is known of its kind: law, units, bounds, what it asks of a simulation.

        Raises
        ------
        KeyError
            If there is no such kind; a checked system has none of these.
        """
        return EFFECTS[self.kind]
