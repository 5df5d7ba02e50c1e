"""Units of budgets and fidelity cases: what a unit string means in SI, by pint."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import cache
from typing import Any

from modelling.common.errors import InputError
from modelling.units.quantities import factor
from modelling.units.registry import pint_spelling, registry

# Towers such as m^9^9^9 keep pint's arithmetic busy for ever.
_TOWER = re.compile(r"(\^|\*\*)\s*[(\d.\s-]*(\^|\*\*)|(\^|\*\*)\s*\(?-?\d\d")


@dataclass(frozen=True)
class Unit:
    """A unit as an affine map into SI: ``si = scale * x + offset`` (the offset is for °C alone)."""

    text: str
    scale: float
    offset: float
    dimension: Any

    def value_to_si(self, value: Any) -> Any:
        """A value in this unit as SI."""
        return self.scale * value + self.offset

    def difference_to_si(self, difference: Any) -> Any:
        """Uncertainties and half-widths are differences: the offset of °C does not apply."""
        return self.scale * difference

    def value_from_si(self, value: Any) -> Any:
        """A value in SI in this unit."""
        return (value - self.offset) / self.scale

    def difference_from_si(self, difference: Any) -> Any:
        """A difference in SI in this unit."""
        return difference / self.scale


@cache
def _unit(text: str) -> Unit:
    units = registry()
    if text.strip() in ("", "1", "-"):
        return Unit("1", 1.0, 0.0, units.dimensionless.dimensionality)
    parsed = units.Unit(pint_spelling(text))
    zero, one = (float(units.Quantity(value, parsed).to_base_units().magnitude) for value in (0.0, 1.0))
    return Unit(text, one - zero, zero, parsed.dimensionality)


def unit_of(text: Any, where: str) -> Unit:
    """The unit a text names; no text at all is a plain number.

    Raises
    ------
    InputError
        The text is no unit pint knows.
    """
    if not isinstance(text, str):
        raise InputError(where, f"a unit must be text, not {text!r}", 'for example unit = "N*m"')
    if len(text) > 60 or _TOWER.search(text):
        raise InputError(where, f"'{text[:60]}' is no unit", "write it like N*m, 1/min, degC, nm or %")
    try:
        return _unit(text)
    except Exception as error:  # pint raises its own, Python's tokenizer's and arithmetic errors alike
        raise InputError(where, f"unknown unit '{text}'", "write it like N*m, 1/min, degC, nm or %") from error


def signal_unit(text: Any, where: str) -> Unit:
    """The unit of a signal: as ``unit_of``, but 1/min counts turns as on every test bed, and 1/s is refused for it."""
    unit = unit_of(text, where)
    if unit.dimension == unit_of("1/s", where).dimension:
        return Unit(unit.text, factor(unit.text, "rad/s", where), 0.0, unit.dimension)
    return unit


def signal_quantity(given: Any, where: str) -> tuple[float, Any]:
    """A number (SI, dimension None) or a text such as ``"0.689 N*m"`` as SI number with its dimension.

    Raises
    ------
    InputError
        No finite number, or an unknown unit.
    """
    if isinstance(given, str):
        number, _, unit = given.strip().partition(" ")
        try:
            value = float(number)
        except ValueError as error:
            raise InputError(
                where, f"'{given}' is no quantity", 'write a number, a space and a unit: "0.5 N*m"'
            ) from error
        parsed = signal_unit(unit.strip() or "1", where)
        value, dimension = parsed.difference_to_si(value), parsed.dimension
    elif isinstance(given, int | float) and not isinstance(given, bool):
        value, dimension = float(given), None
    else:
        raise InputError(where, f"{given!r} is no quantity", 'write a number in SI or a text like "0.5 N*m"')
    if not math.isfinite(value):
        raise InputError(where, f"{given!r} is not finite", "give a finite number")
    return value, dimension


def printed(unit: str) -> str:
    """A unit as it is printed: N·m rather than N*m."""
    return unit.replace("**", "^").replace("*", "·").replace("delta_degC", "K").replace("degC", "°C")
