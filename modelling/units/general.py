"""Units of any quantity, as budgets and fidelity cases have them: what a unit's text means in SI."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

from modelling.common.errors import InputError
from modelling.units.registry import registry
from modelling.units.spelling import Powers, SpellingError, parse

_EXAMPLES = "write it like N*m, 1/min, degC, nm or %"
_OFFSET_UNITS = {"degree_Celsius": "kelvin", "degree_Fahrenheit": "degree_Rankine"}  # in a product: a difference


@dataclass(frozen=True)
class Unit:
    """A unit as an affine map into SI: ``si = scale * x + offset`` (the offset is for °C and °F alone).

    ``dimension`` is pint's, an angle being a plain number. ``counts`` says of a number of events per time whether it
    counts ``"turns"`` (1/min, rpm: its SI value is in rad/s) or ``"cycles"`` (Hz); else it is empty.
    """

    text: str
    scale: float
    offset: float
    dimension: Any
    counts: str = ""

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
    powers = parse(text)
    if len(powers) == 1 and powers[0][0] in _OFFSET_UNITS and powers[0][1] == 1:
        zero, unity = (float(units.Quantity(value, powers[0][0]).to_base_units().magnitude) for value in (0.0, 1.0))
        return Unit(text, unity - zero, zero, units.Unit(powers[0][0]).dimensionality)
    product = units.Quantity(1.0, "dimensionless")
    for name, exponent in powers:
        product = product * units.Quantity(1.0, _OFFSET_UNITS.get(name, name)) ** exponent
    base = product.to_base_units()
    counts = _counts(powers, base.dimensionality)
    scale = float(base.magnitude) * (2 * math.pi if counts == "turns" and "turn" not in dict(powers) else 1.0)
    return Unit(text, scale, 0.0, base.dimensionality, counts)


def _counts(powers: Powers, dimension: Any) -> str:
    """What a number per time counts.

    Raises
    ------
    SpellingError
        If it leaves open whether it counts turns, radians or cycles, as 1/s and 1/h do.
    """
    units = registry()
    rates = {units.hertz.dimensionality: 1, (units.hertz**2).dimensionality: 2}
    if dimension not in rates:
        return ""
    names = {name for name, _ in powers}
    if "turn" in names:
        return "turns"
    if not all(units.Unit(name).dimensionality == units.second.dimensionality for name in names):
        if any("hertz" not in name and _is_rate(name) for name in names):
            raise SpellingError("is no speed and no frequency")
        return "cycles" if any("hertz" in name for name in names) else ""
    if "minute" in names:
        return "turns"
    raise SpellingError("leaves open whether it counts turns, radians or cycles; write 1/min, rad/s or Hz")


def _is_rate(name: str) -> bool:
    """Whether a unit by itself is a number per time, as Bq and Ci are."""
    return bool(registry().Unit(name).dimensionality == registry().hertz.dimensionality)


def unit_of(text: Any, where: str) -> Unit:
    """The unit that a text names; no text at all is a plain number. 1/min counts turns, as on every test bed.

    Raises
    ------
    InputError
        If the text is no unit, or leaves open whether it counts turns, radians or cycles.
    """
    if not isinstance(text, str):
        raise InputError(where, f"a unit must be text, not {text!r}", 'for example unit = "N*m"')
    try:
        return _unit(text)
    except SpellingError as error:
        if "leaves open" in str(error):
            raise InputError(where, f"unit '{text}' {error}") from None
        raise InputError(where, f"unknown unit '{text[:60]}'", _EXAMPLES) from None
    except Exception as error:  # pint raises its own and arithmetic errors alike
        raise InputError(where, f"unknown unit '{text[:60]}'", _EXAMPLES) from error


def signal_unit(text: Any, where: str) -> Unit:
    """The unit of a signal, as :func:`unit_of`, but Hz is refused: a speed in Hz could count radians or turns.

    Raises
    ------
    InputError
        If the unit is unknown or in Hz.
    """
    unit = unit_of(text, where)
    if unit.counts == "cycles":
        raise InputError(where, f"{text!r} leaves open whether it counts radians or turns", "write rad/s or 1/min")
    return unit


def signal_quantity(stated: Any, where: str) -> tuple[float, Any]:
    """A number (SI, dimension None) or a text such as ``"0.689 N*m"`` as SI number with its dimension.

    Raises
    ------
    InputError
        No finite number, or an unknown unit.
    """
    if isinstance(stated, str):
        number, _, unit = stated.strip().partition(" ")
        try:
            value = float(number)
        except ValueError as error:
            raise InputError(
                where, f"'{stated}' is no quantity", 'write a number, a space and a unit: "0.5 N*m"'
            ) from error
        parsed = signal_unit(unit.strip() or "1", where)
        value, dimension = parsed.difference_to_si(value), parsed.dimension
    elif isinstance(stated, int | float) and not isinstance(stated, bool):
        value, dimension = float(stated), None
    else:
        raise InputError(where, f"{stated!r} is no quantity", 'write a number in SI or a text like "0.5 N*m"')
    if not math.isfinite(value):
        raise InputError(where, f"{stated!r} is not finite", "give a finite number")
    return value, dimension


def printed(unit: str) -> str:
    """A unit as it is printed: N·m rather than N*m."""
    return unit.replace("**", "^").replace("*", "·").replace("delta_degC", "K").replace("degC", "°C")
