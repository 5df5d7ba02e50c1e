"""Units: what a text such as ``"300 N*m/rad"`` means in SI. Everything behind this room computes in SI."""

from __future__ import annotations

import ast
import functools
import math
import re
from dataclasses import dataclass
from functools import cache
from typing import Any

from modelling.errors import InputError

# --- The one registry of units of this process (pint).


@functools.cache
def registry() -> Any:
    """Pint's registry, imported and made when it is first needed: both take time at the start of every command."""
    import pint

    return pint.UnitRegistry(autoconvert_offset_to_baseunit=True, cache_folder=None)


# --- The units that stand in most files; Pint, which takes half a second to import, is asked for all others.
#
# ``tests/modelling/units`` holds every row against Pint.

_PREFIXES = {"": 1.0, "milli": 1e-3, "kilo": 1e3}
_BASES = {  # value in kg, m, s and rad
    "newton": 1.0, "gram": 1e-3, "meter": 1.0, "second": 1.0, "minute": 60.0, "hour": 3600.0,
    "radian": 1.0, "degree": math.pi / 180, "turn": 2 * math.pi, "hertz": 1.0, "watt": 1.0,
}  # fmt: skip
_TEXTS = {  # as it is written: prefix and unit by Pint's names
    "N": ("", "newton"), "kN": ("kilo", "newton"), "kg": ("kilo", "gram"), "m": ("", "meter"), "mm": ("milli", "meter"),
    "km": ("kilo", "meter"), "s": ("", "second"), "ms": ("milli", "second"), "min": ("", "minute"), "h": ("", "hour"),
    "rad": ("", "radian"), "mrad": ("milli", "radian"), "deg": ("", "degree"), "turn": ("", "turn"),
    "Hz": ("", "hertz"), "W": ("", "watt"), "kW": ("kilo", "watt"),
    "newton": ("", "newton"), "meter": ("", "meter"), "second": ("", "second"), "minute": ("", "minute"),
}  # fmt: skip


@dataclass(frozen=True)
class CommonUnit:
    """Pint's name with prefix, without it, and the value in kg, m, s and rad."""

    name: str
    base: str
    value: float


BY_TEXT = {
    text: CommonUnit(prefix + base, base, _PREFIXES[prefix] * _BASES[base]) for text, (prefix, base) in _TEXTS.items()
}
BY_NAME = {unit.name: unit for unit in BY_TEXT.values()}


# --- The one parser of units: a text such as ``N·m/rad``, ``kNm`` or ``min-1`` as a product of powers of units.

LONGEST_TEXT = 60
LARGEST_EXPONENT = 9
Powers = tuple[tuple[str, int], ...]  # (pint's name of a unit, exponent), e.g. (("kilonewton", 1), ("meter", 1))

_SIGNS = {
    "**": "^", "·": "*", "⋅": "*", "∙": "*", "×": "*", "−": "-", "⁻": "^-", "¹": "1", "²": "2", "³": "3", "⁴": "4",
    "°C": "degC", "°F": "degF", "°": "deg", "″": "arcsecond", "′": "arcminute", "%": "percent", "‰": "permille",
}  # fmt: skip
_LETTERS = "A-Za-zµμΩΩ_"
_KNOWN_SIGNS = re.compile(rf"[{_LETTERS}0-9\s*/.^()-]*")
_PER_MINUTE = re.compile(r"\(\s*(?:1\s*/\s*min(?:utes?)?|min\s*\^?\s*-\s*1)\s*\)")  # in brackets: a speed
_PER_TIME = r"\s*/\s*(?=(?:min|minutes?|s|secs?|seconds?)\s*$)"
_TURNS = re.compile(rf"(?<![A-Za-z])(?:revs?|turns?|tr|umdr|[ur])\.?{_PER_TIME}", re.IGNORECASE)
_POWER = re.compile(rf"([{_LETTERS}]+)((?:-?[0-9]+)?)")  # s, s2, s-2
_TIMES = re.compile(r"(?<=[0-9)])\s*[.-]\s*(?=[u(])|(?<=[0-9)])\s+(?=[u1(])|(?<=[0-9)])(?=\()")
_JOINED = re.compile(r"([ckMmµμu]?N)([cm]?m)(s?)|(kg)([cm]?m)")  # Nm, kNm, cNm, Ncm, Nms, kgm2, kgcm2
_ALIASES = {
    "rpm": "turn/minute", "rev": "turn", "revs": "turn", "sec": "second", "secs": "second", "metre": "meter",
    "metres": "meter", "newtonmetre": "newton*meter", "mph": "mile/hour",
    "kph": "kilometer/hour", "kmh": "kilometer/hour",
    "lbm": "pound", "ozf": "force_ounce", "lbin": "force_pound*inch", "inlb": "inch*force_pound",
    "ftlb": "foot*force_pound", "lbft": "force_pound*foot",
}  # fmt: skip
_ANGLES_AND_TIMES = ("radian", "degree", "turn", "second", "minute", "hour")


class SpellingError(ValueError):
    """The text is no product of powers of known units."""


@functools.lru_cache(maxsize=4096)
def parse(text: str) -> Powers:
    """The unit that a text names.

    Factors are joined by ``*``, ``·``, ``.``, ``-`` or a space; ``/`` divides by the next factor; exponents are written
    ``s^2``, ``s**2``, ``s²``, ``s2``, ``s-2`` or ``s⁻²``. Revolutions are ``rpm``, ``rev/min`` and ``U/min``.

    Raises
    ------
    SpellingError
        If it is too long, not understood, or names a unit that does not exist.
    """
    for sign, plain in _SIGNS.items():
        text = text.replace(sign, plain)
    if len(text) > LONGEST_TEXT or not _KNOWN_SIGNS.fullmatch(text):
        raise SpellingError(text)
    text = _TURNS.sub("turn/", _PER_MINUTE.sub("(rpm)", " ".join(text.split())))
    words: list[str] = []

    def numbered(match: re.Match) -> str:
        joined = _JOINED.fullmatch(match[1])
        factors = [part for part in joined.groups() if part] if joined else [match[1]]
        words.extend(factors)
        names = "*".join(f"u{number}" for number in range(len(words) - len(factors), len(words)))
        return names + (f"^({match[2]})" if match[2] else "")

    product = re.sub(r"^/|(?<=\()/", "1/", _TIMES.sub("*", _POWER.sub(numbered, text)))  # as Python writes it
    try:
        powers = _product(ast.parse(product.replace("^", "**"), mode="eval").body, words)
    except SyntaxError:
        raise SpellingError(text) from None
    return tuple((name, exponent) for name, exponent in powers.items() if exponent)


def _product(node: ast.expr, words: list[str]) -> dict[str, int]:
    """Powers of units in an expression of products, quotients and powers of numbered words."""
    match node:
        case ast.Name(name):
            return dict(_unit(words[int(name[1:])]))
        case ast.Constant(int(value)) if value == 1:
            return {}
        case ast.BinOp(base, ast.Pow(), power):
            match power:
                case ast.Constant(int(size)):
                    exponent = size
                case ast.UnaryOp(ast.USub(), ast.Constant(int(size))):
                    exponent = -size
                case _:
                    raise SpellingError("an exponent is expected")
            if not 1 <= size <= LARGEST_EXPONENT:
                raise SpellingError("an exponent is expected")
            return {name: exponent * each for name, each in _product(base, words).items()}
        case ast.BinOp(left, ast.Mult() | ast.Div() as sign, right):
            powers = _product(left, words)
            for name, exponent in _product(right, words).items():
                powers[name] = powers.get(name, 0) + (exponent if isinstance(sign, ast.Mult) else -exponent)
            return powers
        case _:
            raise SpellingError("a unit is expected")


def _unit(name: str) -> Powers:
    """The unit of one word; words of test beds that pint reads otherwise or not at all come first."""
    if alias := _ALIASES.get(name.lower()):
        return parse(alias)
    return ((_pint_name(name), 1),)


def _pint_name(name: str) -> str:
    if known := BY_TEXT.get(name):
        return known.name
    candidates = registry().parse_unit_name(name)
    if not candidates and len(name) > 3:
        candidates = registry().parse_unit_name(name.lower())
    if not candidates:
        raise SpellingError(f"{name} is no unit")
    prefix, unit, _ = candidates[0]
    if unit in _ANGLES_AND_TIMES and prefix not in ("", "milli", "micro", "nano"):
        raise SpellingError(f"{name} is no unit of an angle or a time")  # Grad is a degree, Ms or MS a millisecond
    return f"{prefix}{unit}"


# --- Units of any quantity, as budgets and fidelity cases have them: what a unit's text means in SI.

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
def _general_unit(text: str) -> Unit:
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
    if dict(powers).get("minute", 0) > 0 and not _has_angle(powers):
        scale /= _minutes_as_speed(base.dimensionality)
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


def _has_angle(powers: Powers) -> bool:
    """Whether a unit has an angle in it."""
    return any(_KINDS.get(name.removeprefix("milli").removeprefix("micro")) == "angle" for name, _ in powers)


def counts_angle(text: str) -> bool:
    """Whether a text names a unit with an angle in it, as deg, turn or rad/s."""
    try:
        return _has_angle(parse(text)) if text.strip() not in ("", "1", "-") else False
    except SpellingError:
        return False


def _minutes_as_speed(dimension: Any) -> float:
    """Radians of a turn where minutes stand for a division by a speed in 1/min, as in N*m*min of a damping; else 1.

    Raises
    ------
    SpellingError
        If they may be either, as in V*min.
    """
    units = registry()
    if dimension == (units.newton * units.meter * units.second).dimensionality:
        return 2 * math.pi
    if dimension == (units.volt * units.second).dimensionality:
        raise SpellingError(
            "leaves open whether min is a time or 1/min a speed; write V*s for a time, V/rpm for a speed"
        )
    return 1.0


def is_torque(text: str) -> bool:
    """Whether a unit is written as a force times a length, in any spelling; an energy in J is none."""
    units = registry()
    try:
        powers = parse(text)
    except SpellingError:
        return False
    force, length = units.newton.dimensionality, units.meter.dimensionality
    kinds = [(units.Unit(name).dimensionality, exponent) for name, exponent in powers]
    return len(kinds) == 2 and (force, 1) in kinds and (length, 1) in kinds


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
        return _general_unit(text)
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


# --- What each quantity may be written in, and values with units → SI.
#
# A quantity is named by its SI unit. It may be written in any product of units that measures the same and is built from
# the kinds of unit in ``_KINDS``: ``kN*mm/deg`` is a stiffness, ``eV/rad`` or ``N*m/%`` is not. Where the angle is left
# out it is a radian (``N*m`` of a stiffness) or, beside minutes, a turn (``1/min`` of a speed). Where it could be
# either (``1/s`` or ``Hz`` of a speed) the unit is refused.

# SI unit of every quantity that stands in a table of a model file
QUANTITY_UNITS = {
    "J": "kg*m^2",
    "drag": "N*m*s/rad",
    "stiffness": "N*m/rad",
    "damping": "N*m*s/rad",
    "ratio": "1",
}
GEARBOX_UNITS = {"deflection": "rad", "settling": "s", "engages_below": "rad/s"}  # of a gearbox, next to its ratios
SENSOR_UNITS = {"angle": "rad", "speed": "rad/s", "acceleration": "rad/s^2", "torque": "N*m"}
INPUT_UNITS = {quantity: SENSOR_UNITS[quantity] for quantity in ("torque", "speed", "angle")}  # that a file may state
PEDAL_UNIT = "1"  # of an input with a torque map

_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*)", re.DOTALL)
# The kind of every unit that a quantity of a model or case may be written in, by pint's name without prefix
_KINDS = {
    "newton": "force", "force_pound": "force", "force_ounce": "force", "force_kilogram": "force", "gram": "mass",
    "pound": "mass", "ounce": "mass", "slug": "mass", "pascal": "pressure", "bar": "pressure",
    "pound_force_per_square_inch": "pressure", "meter": "length", "foot": "length", "inch": "length",
    "mile": "length", "second": "time", "minute": "time", "hour": "time",
    "radian": "angle", "degree": "angle", "turn": "angle", "arcminute": "angle", "arcsecond": "angle",
    "hertz": "frequency", "watt": "power", "horsepower": "power", "metric_horsepower": "power",
    "percent": "number", "permille": "number", "ppm": "number",
}  # fmt: skip
_PARTS = {
    "force": {"mass": 1, "length": 1, "time": -2}, "pressure": {"mass": 1, "length": -1, "time": -2}, "number": {},
}  # fmt: skip
_AS_FORCE = {"pound": "force_pound", "ounce": "force_ounce"}  # in·lb, oz·in·s²: where a mass does not fit
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
        forces = tuple((_AS_FORCE.get(name, name), exponent) for name, exponent in powers)
        if forces != powers and _signature(forces) in (wanted, {k: v for k, v in wanted.items() if k != "angle"}):
            return math.prod((_to_base(name) ** exponent for name, exponent in forces), start=1.0)
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
        parts = _PARTS.get(kind, {kind: 1})
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


def of_input(unit: str) -> str:
    """What a response is per one of, by the SI unit of its input: ``N*m``, or ``pedal``."""
    return "pedal" if unit == PEDAL_UNIT else unit


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
        if not match or match[2].startswith(","):
            if re.match(r"\s*-?\d+,\d", value):
                right = f"write a decimal point: {value.replace(',', '.', 1)!r}"
                raise InputError(where, f"{_short(value)} has a decimal comma", right)
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
