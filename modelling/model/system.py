"""A mechanical system: inertias, what joins them, what drives and measures them. Frozen, checked, a graph."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

from modelling.common.errors import InputError
from modelling.model.quantity import Quantity

if TYPE_CHECKING:
    from modelling.equations.lagrange import Equations

# SI unit of every quantity that stands in a table of a model file
UNITS = {
    "J": "kg*m^2",
    "drag": "N*m*s/rad",
    "stiffness": "N*m/rad",
    "damping": "N*m*s/rad",
    "ratio": "1",
}
SENSOR_UNITS = {"angle": "rad", "speed": "rad/s", "acceleration": "rad/s^2", "torque": "N*m"}


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


@dataclass(frozen=True)
class System:
    """One mechanical system.

    Attributes
    ----------
    inertias, shafts, gears, differentials, inputs, sensors, effects : tuple
        The components, in the order of the file.
    mirror : tuple of pairs of str
        Names of inertias that left/right symmetry swaps.
    title, reference : str
        A title, and the inertia to whose shaft reduced values are reported.

    Raises
    ------
    InputError
        From :func:`modelling.model.checks.check`, at construction, if the parts do not make a system.
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

    def __post_init__(self) -> None:
        from modelling.model.checks import check

        check(self)

    @functools.cached_property
    def parameters(self) -> dict[str, Quantity]:
        """Every quantity by its full name, e.g. ``shafts.link.stiffness``, in the order of the parameter vector (p)."""
        found: dict[str, Quantity] = {}
        for table in ("inertias", "shafts", "gears"):
            for part in getattr(self, table):
                for key in UNITS:
                    quantity = getattr(part, key, None)
                    if quantity is not None:
                        found[f"{table}.{part.name}.{key}"] = quantity
        for effect in self.effects:
            for key, quantity in effect.parameters:
                found[f"{effect.name}.{key}"] = quantity
        return found

    @functools.cached_property
    def units(self) -> dict[str, str]:
        """SI unit of every parameter, same keys as :attr:`parameters`."""
        from modelling.effects import EFFECTS

        found = {name: UNITS[name.rsplit(".", 1)[1]] for name in self.parameters if self._is_plain(name)}
        for effect in self.effects:
            for key, _ in effect.parameters:
                found[f"{effect.name}.{key}"] = EFFECTS[effect.kind].unit(key, effect.at, self)
        return found

    def _is_plain(self, name: str) -> bool:
        return name.count(".") == 2

    @property
    def uncertain(self) -> dict[str, Quantity]:
        """The parameters that have a range, by name."""
        return {name: quantity for name, quantity in self.parameters.items() if quantity.uncertain}

    def __getitem__(self, place: str) -> Inertia | Shaft | Gear | Differential | Input | Sensor:
        """The component at ``table.name``.

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
        raise unknown(place, list(self.places()), "")

    def places(self) -> Iterator[str]:
        """Every ``table.name`` of the system."""
        for table in TABLES:
            for part in getattr(self, table):
                yield f"{table}.{part.name}"

    def with_values(self, values: Mapping[str, float]) -> System:
        """The same system at other parameter values.

        Raises
        ------
        InputError
            If a name is unknown or a value impossible.
        """
        for name in values:
            if name not in self.parameters:
                raise unknown(name, list(self.parameters), "")
        changed: dict[str, Any] = {}
        for table in ("inertias", "shafts", "gears"):
            parts = getattr(self, table)
            changed[table] = tuple(_replaced(part, f"{table}.{part.name}", values) for part in parts)
        changed["effects"] = tuple(
            dataclasses.replace(
                effect,
                parameters=tuple(
                    (key, quantity.at(values[f"{effect.name}.{key}"]) if f"{effect.name}.{key}" in values else quantity)
                    for key, quantity in effect.parameters
                ),
            )
            for effect in self.effects
        )
        return dataclasses.replace(self, **changed)

    def with_effects(self, *effects: Effect) -> System:
        """The same system with further effects."""
        return dataclasses.replace(self, effects=self.effects + effects)

    def _repr_html_(self) -> str:
        from modelling.equations.latex import html

        return html(self.equations(), self)

    def equations(self) -> Equations:
        """Its Lagrange equations, see :class:`modelling.equations.lagrange.Equations`."""
        from modelling.equations.lagrange import derive

        return derive(self)


TABLES = ("inertias", "shafts", "gears", "differentials", "inputs", "sensors")


def _replaced(part: Any, place: str, values: Mapping[str, float]) -> Any:
    new = {
        key: getattr(part, key).at(float(values[f"{place}.{key}"]))
        for key in UNITS
        if getattr(part, key, None) is not None and f"{place}.{key}" in values
    }
    return dataclasses.replace(part, **new) if new else part


def unknown(name: str, known: list[str], where: str) -> InputError:
    """The error for a name nobody has, with the nearest one that exists."""
    near = get_close_matches(str(name), known, 1, 0.6)
    return InputError(
        where, f"{name!r} does not exist", f"did you mean {near[0]!r}?" if near else f"known are {listed(known)}"
    )


def listed(names: list[str], most: int = 12) -> str:
    """Names in a sentence, not more than ``most``."""
    shown = ", ".join(names[:most]) or "none"
    return shown + (f" and {len(names) - most} more" if len(names) > most else "")
