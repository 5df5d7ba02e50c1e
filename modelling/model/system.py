"""A drivetrain as one checked, frozen value."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from modelling.common import display
from modelling.common.errors import unknown
from modelling.model.checks import check
from modelling.model.components import (
    TABLES,
    TABLES_WITH_QUANTITIES,
    Components,
    Differential,
    Effect,
    Gear,
    Inertia,
    Input,
    Sensor,
    Shaft,
)
from modelling.model.quantity import Quantity
from modelling.units import QUANTITY_UNITS


@dataclass(frozen=True)
class System(Components):
    """One drivetrain: its components, checked and frozen.

    Names of quantities are ``table.name.quantity``, those of an effect ``table.name.kind.quantity``. Systems are
    values: methods that change something return a new system.

    Raises
    ------
    InputError
        From :func:`modelling.model.checks.check` at construction, if the components do not make a system.
    """

    def __post_init__(self) -> None:
        check(self)

    @functools.cached_property
    def units(self) -> dict[str, str]:
        """SI unit of every parameter, same keys as :attr:`parameters`."""
        units = {
            f"{table}.{part.name}.{key}": unit
            for table in TABLES_WITH_QUANTITIES
            for part in getattr(self, table)
            for key, unit in QUANTITY_UNITS.items()
            if getattr(part, key, None) is not None
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

    def with_values(self, values: Mapping[str, float], *, designed: bool = False) -> System:
        """The same system at other parameter values; ``designed`` so, their ranges go with them.

        Raises
        ------
        InputError
            If a name is unknown or a value impossible.
        """
        for name in values:
            if name not in self.parameters:
                raise unknown(name, list(self.parameters), "")
        tables: dict[str, Any] = {
            table: tuple(_with_values(part, f"{table}.{part.name}", values, designed) for part in getattr(self, table))
            for table in TABLES_WITH_QUANTITIES
        }
        effects = tuple(_effect_with_values(effect, values) for effect in self.effects)
        return dataclasses.replace(self, effects=effects, **tables)

    def with_effects(self, *effects: Effect) -> System:
        """The same system with further effects."""
        return dataclasses.replace(self, effects=self.effects + effects)

    def _repr_html_(self) -> str:
        return display.html(self)


def _with_values(part: Any, place: str, values: Mapping[str, float], designed: bool) -> Any:
    moved = Quantity.designed if designed else Quantity.at
    changed = {
        key: moved(getattr(part, key), float(values[f"{place}.{key}"]))
        for key in QUANTITY_UNITS
        if f"{place}.{key}" in values
    }
    return dataclasses.replace(part, **changed) if changed else part


def _effect_with_values(effect: Effect, values: Mapping[str, float]) -> Effect:
    parameters = tuple(
        (key, quantity.at(values[f"{effect.name}.{key}"]) if f"{effect.name}.{key}" in values else quantity)
        for key, quantity in effect.parameters
    )
    return dataclasses.replace(effect, parameters=parameters)
