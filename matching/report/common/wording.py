"""Numbers and units as a reader expects them: kW, 1/min, degrees and ms for the eye; SI where values are entered."""

from __future__ import annotations

import math
from collections.abc import Sequence

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_SIGNS = {"kg*m^2": "kg·m²", "rad/s^2": "rad/s²", "1": ""}


def number(value: float | None, digits: int = 4) -> str:
    """A number with so many significant digits; ``–`` where there is none."""
    if value is None or not math.isfinite(value):
        return "–"
    text = f"{value:.{digits}g}"
    if "e" in text:
        mantissa, power = text.split("e")
        if not -4 < int(power) < 7:
            return f"{mantissa}·10{str(int(power)).translate(_SUPERSCRIPTS)}".replace("-", "−")
        text = f"{float(text):.0f}" if int(power) > 0 else f"{value:.{digits - 1 - int(power)}f}"
    if abs(value) >= 1e4:
        text = f"{float(text):_.0f}".replace("_", "\u202f")
    return text.replace("-", "−")


def hertz(value: float | None) -> str:
    """A frequency with four digits, zeros kept so that columns compare."""
    return "–" if value is None or not math.isfinite(value) else f"{value:#.4g}".rstrip(".")


def unit(si: str) -> str:
    """A unit of the files as it is printed."""
    return _SIGNS.get(si, si.replace("*", "·").replace("^2", "²").replace("^3", "³"))


def amount(value: float | None, si: str, digits: int = 4) -> str:
    """A number with its SI unit."""
    return f"{number(value, digits)} {unit(si)}".rstrip()


def handy(value: float | None, si: str, digits: int = 3) -> str:
    """The same in the unit that test beds use: ms, °, 1/min, kW."""
    factor, shown = {
        "s": (1e3, "ms"),
        "rad": (180 / math.pi, "°"),
        "rad/s": (30 / math.pi, "1/min"),
        "W": (1e-3, "kW"),
    }.get(si, (1.0, unit(si)))
    return f"{number(None if value is None else factor * value, digits)} {shown}".rstrip()


def change(before: float, after: float) -> str:
    """A relative change in %, or ``unchanged``."""
    if before == 0 or after == 0 or not math.isfinite(after / before):
        return ""
    if not 1 / 3 < after / before < 3:
        return f"× {number(after / before, 3)}"
    relative = 100 * (after / before - 1)
    return "unchanged" if abs(relative) < 0.05 else f"{relative:+.3g} %".replace("-", "−")


def plain(name: str) -> str:
    """``shafts.side_left.stiffness`` as a reader says it: side left, stiffness."""
    name = name.replace("dynamometers.dynamometer", "dynamometer").replace("dynamometers.", "dynamometer ")
    parts = [part for part in name.split(".") if part not in ("inertias", "shafts", "gears", "rig", "residual_vehicle")]
    return ", ".join(part.replace("_", " ") for part in parts)


def sentence(parts: Sequence[str]) -> str:
    """Parts joined as in a sentence: a, b and c."""
    parts = list(parts)
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}" if parts else ""
