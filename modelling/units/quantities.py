"""Quantities with units → SI, by pint. Nothing else in rigmatch knows any unit but SI."""

from __future__ import annotations

import functools
import math
import re
from typing import Any

import pint

from modelling.common.errors import InputError
from modelling.units.registry import pint_spelling, registry

_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*)", re.DOTALL)
_UNIT = re.compile(r"[A-Za-zµ°Ωω%·*/ ()²³⁻¹1-9^-]{1,60}")
_TOWER = re.compile(r"\^\s*\(?-?\d\d|\^.{0,4}\^|\*\s*\*.{0,4}\*\s*\*|\*\*\s*\d\d")
_SPEED = "rad/s"
_AMBIGUOUS_SPEEDS = {"hz", "khz", "1/s", "s^-1", "1/second", "hertz"}


# SI unit of every quantity that stands in a table of a model file
QUANTITY_UNITS = {
    "J": "kg*m^2",
    "drag": "N*m*s/rad",
    "stiffness": "N*m/rad",
    "damping": "N*m*s/rad",
    "ratio": "1",
}
SENSOR_UNITS = {"angle": "rad", "speed": "rad/s", "acceleration": "rad/s^2", "torque": "N*m"}


@functools.lru_cache(maxsize=1024)
def factor(unit: str, si: str, where: str = "") -> float:
    """Factor that takes a value in ``unit`` to the SI unit ``si``.

    ``1/min`` of a speed counts turns, as test beds write it; ``1/s`` and ``Hz`` of a speed could
    mean radians or turns and are refused.

    Raises
    ------
    InputError
        If the unit is unknown or measures something else than ``si``.
    """
    text = unit.strip()
    if text == si or not text:
        return 1.0
    if si == _SPEED:
        compact = text.replace(" ", "").lower()
        if compact in {"1/min", "min^-1", "min⁻¹", "u/min", "1/minute"}:
            return 2 * math.pi / 60
        if compact in _AMBIGUOUS_SPEEDS:
            raise InputError(where, f"{text!r} leaves open whether it counts radians or turns", "write rad/s or 1/min")
    right = f"a unit like {si} is expected" if si != "1" else "a plain number is expected"
    if not _UNIT.fullmatch(text) or _TOWER.search(text):
        raise InputError(where, f"{text!r} is no unit", right)
    units = registry()
    try:
        parsed = units.parse_units(pint_spelling(text))
        return float(units.Quantity(1.0, parsed).to(_pint_si(si)).magnitude)
    except pint.DimensionalityError:
        raise InputError(where, f"unit {text!r} does not fit", right) from None
    except Exception:  # pint raises many kinds for text it cannot read
        raise InputError(where, f"unknown unit {text!r}", right) from None


@functools.cache
def _pint_si(si: str) -> Any:
    return registry().parse_units(si if si != "1" else "dimensionless")


def to_si(value: object, si: str, where: str) -> float:
    """A number, or a string such as ``"1.0 kg*m^2"``, as a finite float in the SI unit ``si``.

    Parameters
    ----------
    value : int, float or str
        A number is taken to be in SI already.
    si : str
        The SI unit wanted, e.g. ``"N*m/rad"``; ``"1"`` for a pure number.
    where : str
        File and key, for the error line.

    Raises
    ------
    InputError
        If it is no number, not finite, or its unit is unknown or of another dimension.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise InputError(
            where, f"{type(value).__name__} where a quantity is expected", f'write a number in {si} or "number unit"'
        )
    if isinstance(value, str):
        match = _NUMBER.fullmatch(value)
        if not match:
            raise InputError(where, f"{_short(value)} is no quantity", f'write a number in {si} or "number unit"')
        number = float(match[1]) * factor(match[2].strip(), si, where)
    else:
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
    if not math.isfinite(number):
        raise InputError(where, f"{_short(str(value))} is not finite", f"write a finite number in {si}")
    return number


def _short(text: str) -> str:
    return repr(text if len(text) <= 40 else text[:37] + "...")
