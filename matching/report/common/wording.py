"""Numbers, units and names as a reader expects them; every number can be copied into a calculator or a file."""

from __future__ import annotations

import math
from collections.abc import Sequence

ABSENT = "–"
_UNIT_SIGNS = {"kg*m^2": "kg·m²", "rad/s^2": "rad/s²", "1": ""}
_PRACTICAL_UNITS = {  # factor and unit by SI unit
    "s": (1e3, "ms"),
    "rad": (180 / math.pi, "°"),
    "rad/s": (30 / math.pi, "1/min"),
    "W": (1e-3, "kW"),
}
_PLAIN_POWERS = range(-4, 7)  # powers of ten that are written without exponent
UNCHANGED_PERCENT = 0.05  # a smaller change would be printed as 0.0 %


def number(value: float | None, digits: int = 4) -> str:
    """A number with so many significant digits; ``–`` where there is none."""
    if value is None or not math.isfinite(value):
        return ABSENT
    text = f"{value:.{digits}g}"
    if "e" not in text:
        return text
    mantissa, power = text.split("e")
    if int(power) not in _PLAIN_POWERS:
        return f"{mantissa}e{int(power)}"
    return f"{float(text):.0f}"  # the format g writes small numbers of these powers without exponent


def enough_digits(values: Sequence[float | None], least: int = 3, most: int = 6) -> int:
    """Significant digits with which numbers that lie close together differ in two digits, as far as ``most`` allows."""
    known = [value for value in values if value is not None and math.isfinite(value)]
    width = max(known, default=0.0) - min(known, default=0.0)
    if width == 0.0:
        return least
    digits = 2 + math.floor(math.log10(max(abs(value) for value in known))) - math.floor(math.log10(width))
    return min(max(digits, least), most)


def hertz(value: float | None) -> str:
    """A frequency with four digits, zeros kept so that columns compare."""
    return ABSENT if value is None or not math.isfinite(value) else f"{value:#.4g}".rstrip(".")


def percent(share: float | None, digits: int = 2) -> str:
    """A share as a percentage with so many decimals; ``–`` where there is none."""
    return ABSENT if share is None else f"{100 * share:.{digits}f} %"


def unit(si: str) -> str:
    """A unit of the files as it is printed."""
    return _UNIT_SIGNS.get(si, si.replace("*", "·").replace("^2", "²").replace("^3", "³"))


def amount(value: float | None, si: str, digits: int = 4) -> str:
    """A number with its SI unit."""
    return f"{number(value, digits)} {unit(si)}".rstrip()


def practical(value: float | None, si: str, digits: int = 3) -> str:
    """The same in the unit that test benches use: ms, °, 1/min, kW.

    Parameters
    ----------
    value : float or None
        SI.
    si : str
        Its unit.
    """
    factor, shown_unit = _PRACTICAL_UNITS.get(si, (1.0, unit(si)))
    return f"{number(None if value is None else factor * value, digits)} {shown_unit}".rstrip()


def change(before: float, after: float) -> str:
    """A relative change in %, as a factor where it is large, or ``unchanged``."""
    if before == 0 or after == 0 or not math.isfinite(after / before):
        return ""
    if not 1 / 3 < after / before < 3:
        return f"× {number(after / before, 3)}"
    relative = 100 * (after / before - 1)
    return "unchanged" if abs(relative) < UNCHANGED_PERCENT else f"{relative:+.3g} %"


def spaced(name: str) -> str:
    """A name of a file without underscores."""
    return name.replace("_", " ")


def component(name: str) -> str:
    """``shafts.side_left.stiffness`` in words: side left, stiffness."""
    name = name.replace("dynamometers.dynamometer", "dynamometer").replace("dynamometers.", "dynamometer ")
    left_out = ("inertias", "shafts", "gears", "rig", "residual_vehicle", "loop")
    return ", ".join(spaced(part) for part in name.split(".") if part not in left_out)


def sentence(parts: Sequence[str]) -> str:
    """Parts joined as in a sentence: a, b and c."""
    parts = list(parts)
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}" if parts else ""


def counted(count: int, singular: str, plural: str = "") -> str:
    """A number with its noun: ``1 point``, ``2 points``; ``plural`` where it is not the singular with an s."""
    return f"{count} {singular}" if count == 1 else f"{count} {plural or singular + 's'}"
