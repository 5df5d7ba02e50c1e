"""What a reader turns a file into: columns of numbers with names and units, as the file has them."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from modelling.errors import InputError
from modelling.units import SpellingError, parse

TIME_NAMES = {"t", "time", "zeit", "times", "timestamp", "timestamps", "time_s", "t_s"}
_NAME_AND_UNIT = re.compile(r"\s*(.*?)\s*(?:\[([^\[\]]*)\])?\s*", re.DOTALL)
_NAME_AND_BRACKETS = re.compile(r"(.*\S)\s*\(([^()]*)\)", re.DOTALL)
_LAST_WORD = re.compile(r"(?:.*[\s_.\-/]|)([A-Za-z]+)", re.DOTALL)
UNITS_AT_THE_END = {  # what names of channels end in where loggers keep no units: n_rpm, M_EM_Nm, phi_deg
    "rpm": "1/min", "nm": "N*m", "knm": "kN*m", "deg": "deg", "rad": "rad", "rads": "rad/s", "radps": "rad/s",
    "degps": "deg/s", "lbft": "lbf*ft", "ftlb": "lbf*ft",
}  # fmt: skip


@dataclass(frozen=True)
class Column:
    """A channel of a file: name, unit (empty where the file states none) and values (t,), NaN where missing."""

    name: str
    unit: str
    values: np.ndarray = field(repr=False)


@dataclass(frozen=True)
class Table:
    """Columns of one length, in any order.

    Attributes
    ----------
    columns : tuple of Column
    place : function
        Where a row of values stands in the file, for error lines.
    notes : tuple of str
        What the reader had to do.
    others : tuple of str
        Columns that were not asked for and not read.
    """

    columns: tuple[Column, ...]
    place: Callable[[int], str] = field(default=lambda row: f"row {row + 1}", repr=False)
    notes: tuple[str, ...] = ()
    others: tuple[str, ...] = ()

    @property
    def names(self) -> list[str]:
        """Names of the columns."""
        return [column.name for column in self.columns]

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(self.columns[0].values) if self.columns else 0

    def __contains__(self, name: object) -> bool:
        return any(column.name == name for column in self.columns)

    def __getitem__(self, name: str) -> Column:
        return next(column for column in self.columns if column.name == name)


def name_and_unit(header: str) -> tuple[str, str]:
    """Name and unit of a header ``name [unit]`` or ``name (unit)``; the unit is empty where none stands there.

    What stands in round brackets and is no unit belongs to the name: ``speed (filtered)``.
    """
    match = _NAME_AND_UNIT.fullmatch(header)
    if match is None:
        return "", ""
    name, unit = match[1], (match[2] or "").strip()
    if not unit and (bracketed := _NAME_AND_BRACKETS.fullmatch(name)) and _is_unit(bracketed[2]):
        return bracketed[1], bracketed[2].strip()
    return name, unit


def _is_unit(text: str) -> bool:
    if not re.search("[A-Za-z°%]", text):
        return False
    try:
        parse(text)
    except SpellingError:
        return False
    return True


def unit_in_name(name: str) -> str:
    """The unit that a channel's name ends in, as ``n_rpm``; empty where it ends in none."""
    last = _LAST_WORD.fullmatch(name.strip())
    return UNITS_AT_THE_END.get(last[1].lower(), "") if last else ""


def time_hint(names: Collection[str]) -> str:
    """What to do where no column is called ``time``, with the one that may well be it."""
    likely = next((name for name in names if name.strip().lower() in TIME_NAMES), "NAME")
    equal = "; of equally spaced samples without a time, write sampling_rate = HZ there" * (likely == "NAME")
    return f'call it time, or write time = "{likely}" into a channel file (--channels){equal}'


# --- Compressed numbers are counted before they are read: of zeros a thousand times the file's size may lie in it.

LARGEST_READ = 512_000_000  # bytes of numbers that a file may hold in any case: 64 channels of a million samples
FILE_SIZES = (
    30  # and in sizes of the file; recordings with noise are compressed to a half, steps and counters to a tenth
)


def check_size(path: Path, sizes: dict[str, int]) -> None:
    """Refuse variables whose numbers (bytes by name) are too many for the file that they lie in.

    Raises
    ------
    InputError
        If they are.
    """
    most = max(LARGEST_READ, FILE_SIZES * path.stat().st_size)
    if sum(sizes.values()) <= most:
        return
    largest = max(sizes, key=lambda name: sizes[name])
    raise InputError(
        f"{path}: {largest!r}", f"holds {sizes[largest] / 1e9:.2g} GB of numbers in {path.stat().st_size / 1e6:.2g} MB",
        f"at most {most / 1e9:.2g} GB are read: save the channels of the recording alone",
    )  # fmt: skip
