"""Axes of a map: a quantity of the case and its values."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from matching.frequency.case.case import Case
from matching.frequency.case.load_moves import Movable, movable
from modelling.common.errors import InputError, unknown
from modelling.units import to_si

STEPS = 5
MOST_VALUES = 100  # values an axis
GEOMETRIC_FROM_RATIO = 4.0  # from this ratio on values are spread by ratio, not by difference
RANGES = {"loop.dead_time": (5e-4, 8e-3), "loop.inverter_lag": (5e-4, 8e-3), "loop.sample_time": (2.5e-4, 4e-3)}


@dataclass(frozen=True)
class Axis:
    """A quantity and its values (n,), SI; ``here`` is what the case has."""

    name: str
    unit: str
    values: tuple[float, ...]
    here: float

    def to_dict(self) -> dict[str, Any]:
        """As ``map.json`` holds it."""
        return {"name": self.name, "unit": self.unit, "values": list(self.values), "value_in_case": self.here}

    @property
    def by_ratio(self) -> bool:
        """Whether the values lie more evenly on a logarithmic axis."""
        if self.values[0] <= 0 or len(self.values) < 2:
            return False
        plain, log = np.diff(self.values), np.diff(np.log(self.values))
        return bool(log.std() / log.mean() < plain.std() / plain.mean())


def quantities(case: Case) -> dict[str, Movable]:
    """Every quantity of a case that can be set, by name."""
    return movable(case.rig, case.residual_vehicle, case.loop)


def axis(case: Case, text: str, where: str = "") -> Axis:
    """An axis from ``QUANTITY``, ``QUANTITY=LOW:HIGH[:N]`` or ``QUANTITY=VALUE,VALUE,…``; SI or each with a unit.

    Without values those of the case's ``[move]`` are taken, else a third to three times what the case has.

    Raises
    ------
    InputError
        If the quantity is unknown, or the range is empty or impossible.
    """
    name, equals, span = text.partition("=")
    known = quantities(case)
    if name not in known:
        raise unknown(name, list(known), where)
    here, unit, _ = known[name]
    low, high = _usual(case, name, here)
    if not equals:
        values = _spread(low, high, STEPS)
    elif "," in span:
        values = tuple(_si(part, unit, where, name) for part in span.split(","))
    else:
        values = _range(span, unit, where, name)
    if any(a >= b for a, b in pairwise(values)):
        raise InputError(
            where, f"{span!r} is no row of rising values of {name}", "let every value be given once, least first"
        )
    if len(values) > MOST_VALUES:
        raise InputError(where, f"{len(values)} values of {name} are too many", f"2 … {MOST_VALUES} are needed")
    _check(case, name, values[0], values[-1], where)
    return Axis(name, unit, values, here)


def _range(span: str, unit: str, where: str, name: str) -> tuple[float, ...]:
    """Values of LOW:HIGH or LOW:HIGH:N."""
    parts = span.split(":")
    if len(parts) not in (2, 3):
        right = f"write {name}=LOW:HIGH, {name}=LOW:HIGH:N or {name}=VALUE,VALUE"
        raise InputError(where, f"{span!r} is no range", right)
    if len(parts) == 3 and (not parts[2].strip().isdigit() or not 2 <= int(parts[2]) <= MOST_VALUES):
        raise InputError(where, f"{parts[2]!r} is no number of values", f"2 … {MOST_VALUES} are needed")
    low, high = (_si(part, unit, where, name) for part in parts[:2])
    if not low < high:
        raise InputError(where, f"{low:g} … {high:g} is an empty range of {name}", "LOW < HIGH is needed")
    return _spread(low, high, int(parts[2]) if len(parts) == 3 else STEPS)


def _spread(low: float, high: float, count: int) -> tuple[float, ...]:
    """So many values: by ratio where they reach far, else by difference."""
    spaced = np.geomspace if low > 0 and high >= GEOMETRIC_FROM_RATIO * low else np.linspace
    return tuple(spaced(low, high, count).tolist())


def _si(text: str, unit: str, where: str, name: str) -> float:
    return to_si(_number(text), unit, f"{where} {name}".strip())


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
        knob = case.loop.quantities[name.removeprefix("loop.")]
        lower, upper = knob.lower, knob.upper
    if low < lower or high > upper or (low <= 0 and name.rsplit(".", 1)[1] in ("J", "ratio")):
        raise InputError(where, f"{low:g} … {high:g} of {name} is not possible", f"{lower:g} … {upper:g} is")


def _number(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text
