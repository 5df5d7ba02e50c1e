"""What a reader turns a file into: columns of numbers with names and units."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection
from dataclasses import dataclass, field

import numpy as np

TIME_NAMES = {"t", "time", "zeit", "times", "timestamp", "timestamps", "time_s", "t_s"}
_NAME_AND_UNIT = re.compile(r"\s*(.*?)\s*(?:\[([^\[\]]*)\])?\s*", re.DOTALL)


@dataclass(frozen=True)
class Table:
    """Columns as a file holds them.

    Attributes
    ----------
    names, units : list of str
        A unit is empty where the file states none.
    values : ndarray (t, columns)
        NaN where missing.
    place : function
        Where a row of values stands in the file, for error lines.
    notes : tuple of str
        What the reader had to do.
    others : tuple of str
        Columns that were not asked for and not read.
    """

    names: list[str]
    units: list[str]
    values: np.ndarray = field(repr=False)
    place: Callable[[int], str] = field(default=lambda row: f"row {row + 1}", repr=False)
    notes: tuple[str, ...] = ()
    others: tuple[str, ...] = ()


def name_and_unit(header: str) -> tuple[str, str]:
    """Name and unit of a header ``name [unit]``; the unit is empty where none stands there."""
    match = _NAME_AND_UNIT.fullmatch(header)
    return (match[1], (match[2] or "").strip()) if match else ("", "")


def time_hint(names: Collection[str]) -> str:
    """What to do where no column is called ``time``, with the one that may well be it."""
    likely = next((name for name in names if name.strip().lower() in TIME_NAMES), "NAME")
    return f'call it time, or write time = "{likely}" into a channel file (--channels)'
