"""Ranges of a system's quantities, in which recordings are to find them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from modelling.model.components import Effect
from modelling.model.quantity import Quantity
from modelling.model.system import System

WIDER = 2.0  # ranges of a fit over the half-widths of the box, which need not hold to the letter
SMALLEST = 1e-6  # of a value: bounds stay above it where only positive values make sense
_KEYS = ("J", "drag", "stiffness", "damping", "ratio")


def around(value: float, half_width: float) -> Quantity:
    """A quantity with the range that a half-width of the box asks for."""
    reach = WIDER * half_width
    return Quantity(value, max(value - reach, SMALLEST * value), value + reach)


def with_quantities(system: System, quantities: Mapping[str, Quantity]) -> System:
    """A system with other quantities of inertias, shafts and effects, by name."""

    def changed(table: str, part: Any) -> Any:
        keys = [key for key in _KEYS if getattr(part, key, None) is not None]
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
