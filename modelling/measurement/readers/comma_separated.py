"""CSV: a header row, then numbers; parted by commas, or by semicolons or tabs, and then with decimal commas too."""

from __future__ import annotations

import csv
import warnings
from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TextIO

import numpy as np

from modelling.common.errors import InputError
from modelling.measurement.readers import Table

LONGEST_LINE = 65_536
LARGEST = 2_000_000_000  # bytes
MARKS = ",;\t"
WINDOWS = "cp1252"  # what spreadsheets write where UTF-8 is not chosen: ° and µ in units
SECONDS = {"s", "sec", "ms", "us", "µs", "min", "h"}  # what stands below the name of time in a row of units
MISSING = {"", "nan", "na", "n/a", "null", "none", "-", "--"}


def read(path: Path, used: Collection[str] | None = None) -> Table:
    """Read a CSV file; empty cells and ``nan`` are missing values, units may stand in a row of their own.

    Raises
    ------
    InputError
        Naming the line: no header, text among numbers, a row of another length; neither UTF-8 nor Windows-1252; too
        large.
    """
    if path.stat().st_size > LARGEST:
        raise InputError(
            str(path), f"{path.stat().st_size / 1e9:.1f} GB are too much", "cut the recording: at most 2 GB are read"
        )
    try:
        return _read(path, "utf-8-sig")
    except UnicodeDecodeError as fault:
        try:
            found = _read(path, WINDOWS)
        except UnicodeDecodeError:
            raise InputError(str(path), f"is not UTF-8 text: {fault.reason}", "save it as UTF-8 CSV") from None
    return replace(found, notes=("is not UTF-8 text, read as Windows-1252",))


def _read(path: Path, encoding: str) -> Table:
    with path.open(encoding=encoding, newline="") as file:
        header, mark = _header(path, file)
        begin = file.tell()
        if below := _units(file.readline(LONGEST_LINE), header, mark):
            header, begin = below, file.tell()
        first = 3 if below else 2
        file.seek(begin)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # no rows: told below
                rows = file if mark == "," else _points(file)
                values = np.loadtxt(rows, delimiter=mark, ndmin=2, comments=None, dtype=float)
            if values.size and values.shape[1] != len(header):
                raise ValueError
        except ValueError:
            file.seek(begin)
            return _with_care(path, file, header, mark, first)
    return Table(header, values.reshape(-1, len(header)), lambda row: f"line {row + first}")


def _header(path: Path, file: TextIO) -> tuple[list[str], str]:
    line = file.readline(LONGEST_LINE)
    if not line.strip():
        raise InputError(str(path), "is empty", "a header row 'time [s],name [unit],…' is needed")
    if "\0" in line or (len(line) >= LONGEST_LINE and not line.endswith("\n")):
        raise InputError(str(path), "line 1 is no header row", "'time [s],name [unit],…' is needed")
    mark = max(MARKS, key=line.count)
    return [cell.strip() for cell in next(csv.reader([line], delimiter=mark))], mark


def _units(line: str, header: list[str], mark: str) -> list[str]:
    """The header with the units that stand in the row below it; empty if none do."""
    cells = [cell.strip().strip("[]()") for cell in line.split(mark)]
    if cells[0] not in SECONDS or len(cells) != len(header) or any("[" in name for name in header):
        return []
    known = [unit if unit.lower() not in MISSING else "" for unit in cells]
    return [f"{name} [{unit}]" if unit else name for name, unit in zip(header, known)]


def _points(file: TextIO) -> Iterator[str]:
    """Lines with decimal points for decimal commas; a file that has both is for :func:`_with_care` to refuse."""
    seen: set[str] = set()
    for line in file:
        seen |= {",", "."} & {*line}
        if len(seen) > 1:
            raise ValueError
        yield line.replace(",", ".")


def _with_care(path: Path, file: TextIO, header: list[str], mark: str, first: int) -> Table:
    """Row by row: slower, takes missing values and quotes, finds the line of a fault."""
    rows: list[list[float | None]] = []
    lines: list[int] = []
    seen: set[str] = set()
    for line, cells in _rows(path, file, mark, first):
        if len(cells) != len(header):
            raise InputError(f"{path}: line {line}", f"{len(cells)} cells", f"the header has {len(header)} columns")
        if mark != ",":
            seen |= {",", "."} & {*"".join(cells)}
            if len(seen) > 1:
                raise InputError(
                    f"{path}: line {line}", "numbers have points here and commas there", "write one kind, ungrouped"
                )
            cells = [cell.replace(",", ".") for cell in cells]
        row = [_number(cell) for cell in cells]
        if None in row:
            column = row.index(None)
            text = cells[column] if len(cells[column]) <= 30 else cells[column][:27] + "..."
            where = f"{path}: line {line}"
            raise InputError(where, f"{text!r} in column {header[column]!r}", "write a number or leave it empty")
        rows.append(row)
        lines.append(line)
    values = np.array(rows, dtype=float).reshape(-1, len(header))
    return Table(header, values, lambda row: f"line {lines[row]}")


def _rows(path: Path, file: TextIO, mark: str, first: int) -> Iterator[tuple[int, list[str]]]:
    """Line numbers and cells of the rows after the header that are not blank."""
    line = first - 1
    while text := file.readline(LONGEST_LINE):
        line += 1
        if len(text) >= LONGEST_LINE and not text.endswith("\n"):
            raise InputError(f"{path}: line {line}", "is longer than any row of numbers", "mend the file")
        if text.strip():
            try:
                yield line, next(csv.reader([text], strict=True, delimiter=mark))
            except (csv.Error, StopIteration) as fault:
                raise InputError(
                    f"{path}: line {line}", f"is no row of a CSV file: {fault}", "mend that line"
                ) from None


def _number(cell: str) -> float | None:
    """The number in a cell, NaN where it is missing, None if it is text."""
    cell = cell.strip().lower()
    if cell in MISSING:
        return np.nan
    try:
        return float(cell) if "_" not in cell else None
    except ValueError:
        return None
