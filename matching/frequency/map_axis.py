"""Axes of a map: a quantity of the case and its values."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from matching.frequency.case import Case, movable
from modelling.errors import InputError
from modelling.loop import HARDWARE, KNOBS
from modelling.system import unknown
from modelling.units import to_si

STEPS = 5
MOST = 100  # values an axis
WIDE = 4.0  # from this ratio on values are spread by ratio, not by difference
RANGES = {"loop.dead_time": (5e-4, 8e-3), "loop.inverter_lag": (5e-4, 8e-3), "loop.sample_time": (2.5e-4, 4e-3)}


@dataclass(frozen=True)
class Axis:
    """A quantity and its values (n,), SI; ``here`` is what the case has."""

    name: str
    unit: str
    values: tuple[float, ...]
    here: float

    @property
    def by_ratio(self) -> bool:
        """Whether the values are better drawn on a logarithmic axis."""
        return self.values[0] > 0 and self.values[-1] >= WIDE * self.values[0]


def quantities(case: Case) -> dict[str, tuple[float, str, tuple[str, ...]]]:
    """Every quantity of a case that can be set: value, SI unit, and it with its mirror image."""
    return movable(case.rig, case.residual_vehicle, case.loop)


def axis(case: Case, text: str, where: str = "") -> Axis:
    """An axis from ``QUANTITY``, ``QUANTITY=LOW:HIGH`` or ``QUANTITY=LOW:HIGH:N``; bounds in SI or with a unit.

    Without bounds those of the case's ``[move]`` are taken, else a third to three times what the case has.

    Raises
    ------
    InputError
        If the quantity is unknown, or the range is empty or impossible.
    """
    name, given, span = text.partition("=")
    known = quantities(case)
    if name not in known:
        raise unknown(name, list(known), where)
    here, unit, _ = known[name]
    low, high = _usual(case, name, here)
    count = STEPS
    if given:
        parts = span.split(":")
        if len(parts) not in (2, 3):
            raise InputError(where, f"{span!r} is no range", f"write {name}=LOW:HIGH or {name}=LOW:HIGH:N")
        low, high = (to_si(_number(part), unit, f"{where} {name}".strip()) for part in parts[:2])
        if len(parts) == 3:
            if not parts[2].strip().isdigit() or not 2 <= int(parts[2]) <= MOST:
                raise InputError(where, f"{parts[2]!r} is no number of values", f"2 … {MOST} are needed")
            count = int(parts[2])
    if not low < high:
        raise InputError(where, f"{low:g} … {high:g} is an empty range of {name}", "LOW < HIGH is needed")
    _check(case, name, low, high, where)
    values = np.geomspace(low, high, count) if low > 0 and high >= WIDE * low else np.linspace(low, high, count)
    return Axis(name, unit, tuple(values.tolist()), here)


def _usual(case: Case, name: str, here: float) -> tuple[float, float]:
    for move in case.moves:
        if name in move.together:
            return move.lower, move.upper
    if name in RANGES:
        return RANGES[name]
    return (here / 3, here * 3) if here else (0.0, 1.0)


def _check(case: Case, name: str, low: float, high: float, where: str) -> None:
    lower, upper = 0.0, np.inf
    if name.startswith("loop."):
        knob = (HARDWARE | KNOBS[case.loop.structure])[name.removeprefix("loop.")]
        lower, upper = knob.lower, knob.upper
    if low < lower or high > upper or (low <= 0 and name.rsplit(".", 1)[1] in ("J", "ratio")):
        raise InputError(where, f"{low:g} … {high:g} of {name} is not possible", f"{lower:g} … {upper:g} is")


def _number(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text
