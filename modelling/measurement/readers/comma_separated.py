"""CSV: a header row, then numbers; separated by commas, or by semicolons or tabs, and then with decimal commas too."""

from __future__ import annotations

import csv
import warnings
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np

from modelling.common.errors import InputError
from modelling.measurement.readers.table import Table, name_and_unit

LONGEST_LINE = 65_536  # characters
LARGEST_FILE = 2_000_000_000  # bytes
SEPARATORS = ",;\t"
WINDOWS = "cp1252"  # what spreadsheets write where UTF-8 is not chosen: ° and µ in units
TIME_UNITS = {"s", "sec", "ms", "us", "µs", "min", "h"}  # below the name of time in a row of units
MISSING = {"", "nan", "na", "n/a", "null", "none", "-", "--"}


def is_foreign(_: Path) -> bool:
    """Never."""
    return False


def read(path: Path, used: Collection[str] | None = None) -> Table:
    """Read a CSV file; empty cells and ``nan`` are missing values, units may stand in a row of their own.

    Text in columns that are not used, columns without a name and blank lines do not matter.

    Raises
    ------
    InputError
        Naming the line: no header, text among numbers, a row of another length, a used column that is there twice;
        neither UTF-8 nor Windows-1252; too large.
    """
    size = path.stat().st_size
    if size > LARGEST_FILE:
        raise InputError(str(path), f"{size / 1e9:.1f} GB are too much", "cut the recording: at most 2 GB are read")
    try:
        return _read(path, "utf-8-sig", used)
    except UnicodeDecodeError as error:
        try:
            table = _read(path, WINDOWS, used)
        except UnicodeDecodeError:
            raise InputError(str(path), f"is not UTF-8 text: {error.reason}", "save it as UTF-8 CSV") from None
    return replace(table, notes=("is not UTF-8 text, read as Windows-1252",))


@dataclass(frozen=True)
class _Layout:
    """How a file is laid out: names and units of all columns, the columns (by index) to read, the first line after."""

    path: Path
    separator: str
    names: list[str]
    units: list[str]
    columns: list[int]
    first_line: int

    @property
    def others(self) -> tuple[str, ...]:
        return tuple(name for i, name in enumerate(self.names) if name and i not in self.columns)

    def header(self, column: int) -> str:
        unit = self.units[column]
        return f"{self.names[column]} [{unit}]" if unit else self.names[column]

    def table(self, values: np.ndarray, lines: list[int] | None) -> Table:
        def place(row: int) -> str:
            return f"line {row + self.first_line if lines is None else lines[row]}"

        names, units = ([texts[i] for i in self.columns] for texts in (self.names, self.units))
        return Table(names, units, values.reshape(len(values), len(names)), place, others=self.others)


def _read(path: Path, encoding: str, used: Collection[str] | None) -> Table:
    with path.open(encoding=encoding, newline="") as file:
        layout = _layout(path, file, used)
        begin = file.tell()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of no rows: the caller says so
                values = np.loadtxt(
                    _regular_lines(file, layout), delimiter=layout.separator, ndmin=2, comments=None, dtype=float,
                    usecols=layout.columns,
                )  # fmt: skip
        except ValueError:
            file.seek(begin)
            return _read_row_by_row(file, layout)
    return layout.table(values, None)


def _layout(path: Path, file: TextIO, used: Collection[str] | None) -> _Layout:
    """Read the header, and the row of units if there is one; the file is left at the first row of numbers."""
    line, number = "\n", 0
    while line and not line.strip():
        line, number = file.readline(LONGEST_LINE), number + 1
    if not line:
        raise InputError(str(path), "is empty", "a header row 'time [s],name [unit],…' is needed")
    if "\0" in line or (len(line) >= LONGEST_LINE and not line.endswith("\n")):
        raise InputError(str(path), f"line {number} is no header row", "'time [s],name [unit],…' is needed")
    separator = max(SEPARATORS, key=line.count)
    headers = [name_and_unit(cell) for cell in next(csv.reader([line], delimiter=separator))]
    names, units = [name for name, _ in headers], [unit for _, unit in headers]
    begin = file.tell()
    if not any(units) and (below := _units_below(file.readline(LONGEST_LINE), len(names), separator)):
        units, number = below, number + 1
    else:
        file.seek(begin)
    columns = [i for i, name in enumerate(names) if name and (used is None or name in used)]
    for place, i in enumerate(columns):
        if names[i] in [names[j] for j in columns[:place]]:
            raise InputError(f"{path}: line {number}", f"column {names[i]!r} is there twice", "names must differ")
    return _Layout(path, separator, names, units, columns, number + 1)


def _units_below(line: str, count: int, separator: str) -> list[str]:
    """The units in the row below the header; empty if none stand there."""
    cells = [cell.strip().strip("[]()") for cell in line.split(separator)]
    if cells[0] not in TIME_UNITS or len(cells) != count:
        return []
    return [unit if unit.lower() not in MISSING else "" for unit in cells]


def _regular_lines(file: TextIO, layout: _Layout) -> Iterator[str]:
    """Lines with decimal points for decimal commas, as long as all are alike.

    Raises
    ------
    ValueError
        If a line has another number of cells than the header, or the file both points and commas.
    """
    separators, comma = len(layout.names) - 1, layout.separator != ","
    decimal: set[str] = set()
    if not layout.columns:
        raise ValueError
    for line in file:
        if line.count(layout.separator) != separators:
            raise ValueError
        if comma:
            decimal |= {",", "."} & {*line}
            if len(decimal) > 1:
                raise ValueError
            line = line.replace(",", ".")
        yield line


def _read_row_by_row(file: TextIO, layout: _Layout) -> Table:
    """Slower: takes missing values, quotes and blank lines, finds the line of a fault."""
    rows: list[list[float | None]] = []
    lines: list[int] = []
    decimal: set[str] = set()
    for line, cells in _rows(file, layout):
        where = f"{layout.path}: line {line}"
        used = [cells[i] for i in layout.columns]
        if layout.separator != ",":
            decimal |= {",", "."} & {*"".join(used)}
            if len(decimal) > 1:
                raise InputError(where, "numbers have points here and commas there", "write one kind, ungrouped")
            used = [cell.replace(",", ".") for cell in used]
        row = [_number(cell) for cell in used]
        if None in row:
            wrong = row.index(None)
            text = used[wrong] if len(used[wrong]) <= 30 else used[wrong][:27] + "..."
            header = layout.header(layout.columns[wrong])
            raise InputError(where, f"{text!r} in column {header!r}", "write a number or leave it empty")
        rows.append(row)
        lines.append(line)
    return layout.table(np.array(rows, dtype=float), lines)


def _rows(file: TextIO, layout: _Layout) -> Iterator[tuple[int, list[str]]]:
    """Line numbers and cells of the rows that are not blank; empty cells beyond the header are left out."""
    number, count = layout.first_line - 1, len(layout.names)
    while text := file.readline(LONGEST_LINE):
        number += 1
        where = f"{layout.path}: line {number}"
        if len(text) >= LONGEST_LINE and not text.endswith("\n"):
            raise InputError(where, "is longer than any row of numbers", "correct the file")
        if not text.strip():
            continue
        try:
            cells = next(csv.reader([text], strict=True, delimiter=layout.separator))
        except (csv.Error, StopIteration) as error:
            raise InputError(where, f"is no row of a CSV file: {error}", "correct that line") from None
        if len(cells) < count or any(cell.strip() for cell in islice(cells, count, None)):
            raise InputError(where, f"{len(cells)} cells", f"the header has {count} columns")
        yield number, cells


def _number(cell: str) -> float | None:
    """The number in a cell, NaN where it is missing, None if it is text."""
    cell = cell.strip().lower()
    if cell in MISSING:
        return np.nan
    try:
        return float(cell) if "_" not in cell else None
    except ValueError:
        return None
