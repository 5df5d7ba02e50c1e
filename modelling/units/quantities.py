"""What each quantity may be written in, and values with units → SI.

A quantity is named by its SI unit. It may be written in any product of units that measures the same and is built from
the kinds of unit in ``_KINDS``: ``kN*mm/deg`` is a stiffness, ``eV/rad`` or ``N*m/%`` is not. Where the angle is left
out it is a radian (``N*m`` of a stiffness) or, beside minutes, a turn (``1/min`` of a speed). Where it could be either
(``1/s`` or ``Hz`` of a speed) the unit is refused.
"""

from __future__ import annotations

import functools
import math
import re

from modelling.common.errors import InputError
from modelling.units.common_units import BY_NAME
from modelling.units.registry import registry
from modelling.units.spelling import Powers, SpellingError, parse

# SI unit of every quantity that stands in a table of a model file
QUANTITY_UNITS = {
    "J": "kg*m^2",
    "drag": "N*m*s/rad",
    "stiffness": "N*m/rad",
    "damping": "N*m*s/rad",
    "ratio": "1",
}
SENSOR_UNITS = {"angle": "rad", "speed": "rad/s", "acceleration": "rad/s^2", "torque": "N*m"}
INPUT_UNITS = {quantity: SENSOR_UNITS[quantity] for quantity in ("torque", "speed", "angle")}

_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*)", re.DOTALL)
# The kind of every unit that a quantity of a model or case may be written in, by pint's name without prefix
_KINDS = {
    "newton": "force", "force_pound": "force", "force_kilogram": "force", "gram": "mass", "pound": "mass",
    "meter": "length", "foot": "length", "inch": "length", "second": "time", "minute": "time", "hour": "time",
    "radian": "angle", "degree": "angle", "turn": "angle", "arcminute": "angle", "arcsecond": "angle",
    "hertz": "frequency", "watt": "power", "horsepower": "power", "metric_horsepower": "power",
    "percent": "number", "permille": "number", "ppm": "number",
}  # fmt: skip
_TURN = 2 * math.pi  # rad
_INERTIA = {"mass": 1, "length": 2}
_AMBIGUOUS = "leaves open whether it counts radians or turns"


@functools.lru_cache(maxsize=1024)
def factor(unit: str, si: str, where: str = "") -> float:
    """Factor that takes a value in ``unit`` to the SI unit ``si``; no unit at all is SI.

    Raises
    ------
    InputError
        If the unit is unknown, measures something else than ``si``, or leaves open whether it counts radians or turns.
    """
    text = unit.strip()
    if text == si or not text:
        return 1.0
    right = f"a unit like {si} is expected" if si != "1" else "a plain number is expected"
    try:
        powers = parse("1" if text == "-" else text)
    except SpellingError:
        raise InputError(where, f"{_short(text)} is no unit", right) from None
    kinds = [_kind(name) for name, _ in powers]
    if "" in kinds or ("number" in kinds and (si != "1" or len(powers) > 1)):
        raise InputError(where, f"unit {text!r} does not fit", right)
    signature, wanted = _signature(powers), _signature(parse(si))
    scale = math.prod((_to_base(name) ** exponent for name, exponent in powers), start=1.0)
    hours = any(name == "hour" for name, _ in powers)
    if wanted == {"frequency": 1}:
        scale *= _per_cycle(powers, signature)
        signature = wanted if signature in ({"time": -1}, {"angle": 1, "time": -1}) and not hours else signature
    elif "angle" not in signature and (angle := wanted.get("angle")):
        rest = {kind: exponent for kind, exponent in wanted.items() if kind != "angle"}
        minutes = any(name == "minute" for name, _ in powers)
        only_time = set(rest) <= {"time"} and set(signature) <= {"time", "frequency"}
        if only_time and not (minutes and signature == rest):
            raise InputError(where, f"{text!r} {_AMBIGUOUS}", f"write {si}" + " or 1/min" * (si == "rad/s"))
        if signature == rest and not hours:
            scale, signature = scale * (_TURN**angle if minutes else 1.0), wanted
    elif wanted == _INERTIA and ("radian", signature.get("angle")) in powers:
        signature = {
            kind: exponent for kind, exponent in signature.items() if kind != "angle"
        }  # N·m·s²/rad, kg·m²/rad²
    if signature != wanted:
        raise InputError(where, f"unit {text!r} does not fit", right)
    return scale


def _per_cycle(powers: Powers, signature: dict[str, int]) -> float:
    """Cycles in the angle of a frequency: 1 for Hz and 1/s, 1/2π for rad/s, 1 for a turn that is left out in 1/min."""
    return 1 / _TURN if signature == {"angle": 1, "time": -1} else 1.0


@functools.cache
def _kind(name: str) -> str:
    """Kind of a unit by pint's name with prefix; empty if no quantity is written in it."""
    if known := BY_NAME.get(name):
        return _KINDS[known.base]
    candidates = registry().parse_unit_name(name)
    return _KINDS.get(candidates[0][1], "") if candidates else ""


def _signature(powers: Powers) -> dict[str, int]:
    """Exponents by kind; a force is mass·length/time², a plain number nothing."""
    exponents: dict[str, int] = {}
    for name, exponent in powers:
        kind = _kind(name)
        parts = {"mass": 1, "length": 1, "time": -2} if kind == "force" else {} if kind == "number" else {kind: 1}
        for part, power in parts.items():
            exponents[part] = exponents.get(part, 0) + power * exponent
    return {kind: exponent for kind, exponent in exponents.items() if exponent}


SMALLEST, LARGEST = 1e-50, 1e50  # in SI; products of a few such numbers neither overflow nor vanish


@functools.cache
def _to_base(name: str) -> float:
    """Value of one such unit in kg, m, s, rad, and 1."""
    if known := BY_NAME.get(name):
        return known.value
    units = registry()
    return float(units.Quantity(1.0, name).to_base_units().magnitude)


def in_unit(unit: str) -> str:
    """`` in rad/s``, as it stands after "a number"; nothing of a quantity without a unit."""
    return "" if unit == "1" else f" in {unit}"


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
        If it is no number, not finite, beyond all drivetrains, or its unit is unknown or of another dimension.
    """
    right = f'write a number{in_unit(si)} or "number unit"'
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise InputError(where, f"{type(value).__name__} where a quantity is expected", right)
    if isinstance(value, str):
        match = _NUMBER.fullmatch(value)
        if not match:
            raise InputError(where, f"{_short(value)} is no quantity", right)
        number = float(match[1]) * factor(match[2].strip(), si, where)
    else:
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
    if not math.isfinite(number):
        raise InputError(where, f"{_short(str(value))} is not finite", f"write a finite number{in_unit(si)}")
    if number and not SMALLEST <= abs(number) <= LARGEST:
        wrong = f"{_short(str(value))} is too {'large' if abs(number) > 1 else 'small'} for any drivetrain"
        raise InputError(where, wrong, f"write 0 or a number of a size from {SMALLEST:g} to {LARGEST:g}{in_unit(si)}")
    return number


def _short(text: str) -> str:
    return repr(text if len(text) <= 40 else text[:37] + "...")
