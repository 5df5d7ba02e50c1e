"""Ranges of a system's quantities, in which recordings are to find them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from modelling.model.components import Effect
from modelling.model.quantity import Quantity
from modelling.model.system import System

FIT_RANGE_RATIO = 2.0  # half-width of the range in a fit over that of the box, which may be too narrow
LEAST_SHARE_OF_VALUE = 1e-6  # bounds stay above it: only positive values make sense
_QUANTITIES = ("J", "drag", "stiffness", "damping", "ratio")


def around(value: float, half_width: float) -> Quantity:
    """A quantity with the range that a half-width of the box asks for."""
    reach = FIT_RANGE_RATIO * half_width
    return Quantity(value, max(value - reach, LEAST_SHARE_OF_VALUE * value), value + reach)


def with_quantities(system: System, quantities: Mapping[str, Quantity]) -> System:
    """A system with other quantities of inertias, shafts and effects, by name."""

    def changed(table: str, part: Any) -> Any:
        keys = [key for key in _QUANTITIES if getattr(part, key, None) is not None]
        return replace(part, **{key: quantities.get(f"{table}.{part.name}.{key}", getattr(part, key)) for key in keys})

    def of_effect(effect: Effect) -> Effect:
        values = {key: quantities.get(f"{effect.name}.{key}", quantity) for key, quantity in effect.parameters}
        return replace(effect, parameters=tuple(values.items()))

    return replace(
        system,
        inertias=tuple(changed("inertias", part) for part in system.inertias),
        shafts=tuple(changed("shafts", part) for part in system.shafts),
        effects=tuple(of_effect(effect) for effect in system.effects),
    )
