"""The units that stand in most files; Pint, which takes half a second to import, is asked for all others.

``tests/modelling/units`` holds every row against Pint.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

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
