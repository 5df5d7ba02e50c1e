"""A mechanical system: inertias, what joins them, what drives and measures them. Frozen, checked, a graph."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from modelling.common import display
from modelling.common.errors import unknown
from modelling.model.checks import check
from modelling.model.components import TABLES, Differential, Effect, Gear, Inertia, Input, Sensor, Shaft
from modelling.model.quantity import Quantity
from modelling.units import QUANTITY_UNITS


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
        check(self)

    @functools.cached_property
    def parameters(self) -> dict[str, Quantity]:
        """Every quantity by its full name, e.g. ``shafts.link.stiffness``, in the order of the parameter vector (p)."""
        found: dict[str, Quantity] = {}
        for table in ("inertias", "shafts", "gears"):
            for part in getattr(self, table):
                for key in QUANTITY_UNITS:
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
        found = {name: QUANTITY_UNITS[name.rsplit(".", 1)[1]] for name in self.parameters if self._is_plain(name)}
        for effect in self.effects:
            for key, _ in effect.parameters:
                found[f"{effect.name}.{key}"] = effect.law.unit(key, effect.at, self)
        return found

    def _is_plain(self, name: str) -> bool:
        return name.count(".") == 2

    @property
    def free_plays(self) -> dict[str, str]:
        """Parameter that is the total free play of a shaft (rad), by the shaft's place ``shafts.NAME``."""
        return {own.at: f"{own.name}.{own.law.free_play}" for own in self.effects if own.law.free_play}

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
        return display.html(self)


def _replaced(part: Any, place: str, values: Mapping[str, float]) -> Any:
    new = {
        key: getattr(part, key).at(float(values[f"{place}.{key}"]))
        for key in QUANTITY_UNITS
        if getattr(part, key, None) is not None and f"{place}.{key}" in values
    }
    return dataclasses.replace(part, **new) if new else part
