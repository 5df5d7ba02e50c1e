"""Tables in text: CSV and what spreadsheets, loggers and scopes write.

The header is the line that has the most of the channels that are asked for, or else the first one of texts above a row
of numbers. Cells are separated by commas, or by semicolons, tabs or blanks, and then with decimal commas too.
"""

from __future__ import annotations

import csv
import re
import warnings
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field, replace
from datetime import date
from itertools import islice
from pathlib import Path
from typing import TextIO

import numpy as np

from modelling.errors import InputError
from modelling.recordings.table import TIME_NAMES, Column, Table, name_and_unit

LONGEST_LINE = 65_536  # characters
LARGEST_FILE = 2_000_000_000  # bytes
MOST_LINES = 200  # among which the header is looked for
SEPARATORS = ",;\t"
BLANKS = " "  # any number of blanks or tabs between cells
WINDOWS = "cp1252"  # what spreadsheets write where UTF-8 is not chosen: ° and µ in units
TIME_UNITS = {"s", "sec", "ms", "us", "µs", "min", "h", "second", "seconds"}  # below time in a row of units
MISSING = {
    "", "nan", "na", "n/a", "#n/a", "#na", "null", "none", "-", "--", "---", "ol", "ovld", "overload", "overflow",
    "over", "overrange", "invalid", "inv", "n.a.", "inf", "infinity", "#value!", "#div/0!", "#num!", "#ref!", "#name?",
}  # fmt: skip
_MISSING_NUMBER = re.compile(
    r"[+-]?(?:1\.#(?:q?nan|snan|ind|inf|j)\w*|nan\(\w*\)|[*#?]+)"
)  # 1.#QNAN, -1.#IND, nan(ind)
_WORD = re.compile(r'"[^"]*"|[^\s\[\]"]+(?:\s*\[[^\]]*\])?')  # of a header separated by blanks: name [unit]
COMMENTS = ("#", "%", "//", "!")


def read_csv(path: Path, used: Collection[str] | None = None, header: int | None = None) -> Table:
    """Read a table in text; empty cells and ``nan`` are missing values, units may stand in a row of their own.

    Text in columns that are not used, columns without a name, blank lines and comments do not matter.

    Parameters
    ----------
    header : int, optional
        The line of the header, counted from 1; found by itself where not given.

    Raises
    ------
    InputError
        Naming the line: no header, text among numbers, a row of another length, a used column that is there twice;
        in no known encoding; too large.
    """
    size = path.stat().st_size
    if size > LARGEST_FILE:
        raise InputError(str(path), f"{size / 1e9:.1f} GB are too much", "cut the recording: at most 2 GB are read")
    encoding = _encoding(path)
    try:
        return _read(path, encoding, used, header)
    except UnicodeError as error:
        try:
            table = _read(path, WINDOWS, used, header)
        except UnicodeError:
            reason = getattr(error, "reason", str(error))
            raise InputError(str(path), f"is not UTF-8 text: {reason}", "save it as UTF-8 CSV") from None
    return replace(table, notes=(*table.notes, "is not UTF-8 text, read as Windows-1252"))


def is_text(path: Path) -> bool:
    """Whether a file begins as text, in an encoding that is read."""
    with path.open("rb") as file:
        start = file.read(512)
    return b"\0" not in start or _encoding(path) != "utf-8-sig"


def _encoding(path: Path) -> str:
    with path.open("rb") as file:
        start = file.read(512)
    if start.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    zeros = [start[place::2].count(0) for place in (0, 1)]
    if len(start) > 8 and max(zeros) > 0.4 * len(start) and min(zeros) == 0:  # half of it is zero: Latin letters
        return "utf-16-be" if zeros[0] else "utf-16-le"
    return "utf-8-sig"


@dataclass(frozen=True)
class _Line:
    number: int
    text: str
    after: int  # where in the file the next line begins


@dataclass(frozen=True)
class _Layout:
    """How a file is laid out: names and units of all columns, the columns (by index) to read, the first line after.

    ``regular`` is the step of time (s) where the file states it in place of a column; of a file that ends within a row
    ``rows`` are the lines before that.
    """

    path: Path
    separator: str
    names: list[str]
    units: list[str]
    columns: list[int]
    first_line: int
    notes: tuple[str, ...] = ()
    regular: float | None = field(default=None)
    rows: int | None = None

    @property
    def others(self) -> tuple[str, ...]:
        return tuple(name for i, name in enumerate(self.names) if name and i not in self.columns)

    def header(self, column: int) -> str:
        unit = self.units[column]
        return f"{self.names[column]} [{unit}]" if unit else self.names[column]

    def cells(self, text: str) -> list[str]:
        return cells_of(text, self.separator)

    def table(self, values: np.ndarray, lines: list[int] | None, dates: Collection[int] = ()) -> Table:
        def place(row: int) -> str:
            return f"line {row + self.first_line if lines is None else lines[row]}"

        values = values.reshape(len(values), len(self.columns))
        columns = [
            Column(self.names[i], "s" if k in dates else self.units[i], values[:, k])
            for k, i in enumerate(self.columns)
        ]
        if self.regular is not None and not any(column.name == "time" for column in columns):
            columns.insert(0, Column("time", "s", np.arange(len(values)) * self.regular))
        return Table(tuple(columns), place, self.notes, self.others)


def cells_of(text: str, separator: str) -> list[str]:
    """Cells of a line; quotes may follow blanks."""
    if separator == BLANKS:
        return [word.strip('"') for word in re.findall(r'"[^"]*"|[^\s"]+', text)]
    line = text.rstrip("\r\n")
    return next(csv.reader([line], strict=True, delimiter=separator, skipinitialspace=True), [""])


def _read(path: Path, encoding: str, used: Collection[str] | None, header: int | None) -> Table:
    with path.open(encoding=encoding, newline="") as file:
        layout = _layout(path, file, used, header)
        begin = file.tell()
        layout = _without_cut_row(file, layout)
        file.seek(begin)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of no rows: the caller says so
                values = np.loadtxt(
                    _regular_lines(file, layout), ndmin=2, comments=None, dtype=float, usecols=layout.columns,
                    delimiter=None if layout.separator == BLANKS else layout.separator,
                )  # fmt: skip
        except ValueError as error:
            if isinstance(error, UnicodeError):
                raise
            file.seek(begin)
            return _read_row_by_row(file, layout)
    return layout.table(values, None)


CUT_OFF = "the last row ends within a number and is left out: a logger that was cut off has not written all of it"
LONGEST_MARK = 4  # bytes of a character, in any encoding


def _without_cut_row(file: TextIO, layout: _Layout) -> _Layout:
    """The layout of a file whose last row has no end and is cut: a logger lost its power, or is still writing.

    Many programs write no end of line after the last row. So only a row counts as cut that has fewer cells than the
    others, or a last cell that is shorter than every other one of its column.
    """
    with layout.path.open("rb") as raw:
        raw.seek(-min(LONGEST_MARK, raw.seek(0, 2)), 2)
        if any(end in raw.read() for end in (b"\n", b"\r")):
            return layout
    rows, shortest, fewest, last = 0, LONGEST_LINE, LONGEST_LINE, ""
    for line in file:
        if last.strip():
            cells = last.rstrip().rsplit(None if layout.separator == BLANKS else layout.separator, 1)
            shortest = min(shortest, len(cells[-1].strip()))
            fewest = min(fewest, len(last.split() if layout.separator == BLANKS else last.split(layout.separator)))
        rows, last = rows + 1, line
    cells = last.split() if layout.separator == BLANKS else last.split(layout.separator)
    is_cut = len(cells) < fewest or len(cells[-1].strip()) < shortest
    return replace(layout, rows=rows - 1, notes=(*layout.notes, CUT_OFF)) if rows > 1 and is_cut else layout


# --- The header, and what stands above and below it.


def _layout(path: Path, file: TextIO, used: Collection[str] | None, header: int | None) -> _Layout:
    """Find the header, and the row of units if there is one; the file is left at the first row of numbers."""
    lines = _first_lines(path, file, max(MOST_LINES, header or 0))
    if not lines:
        raise InputError(str(path), "is empty", "a header row 'time [s],name [unit],…' is needed")
    if lines[0].text.startswith("LabVIEW Measurement"):
        return _labview(path, file, lines, used)
    stated = re.fullmatch(r'"?sep=(.)"?', lines[0].text.rstrip("\r\n"))
    lines = lines[1:] if stated else lines
    if not lines:
        raise InputError(str(path), "has no header row", "'time [s],name [unit],…' is needed")
    place = _header_place(path, lines, used, stated[1] if stated else "", header)
    line = lines[place]
    text = line.text
    if text.lstrip().startswith(COMMENTS) and len(lines) > place + 1:
        text = text.lstrip().lstrip("#%/! ")
    separator = stated[1] if stated else _separator(text)
    headers = _headers(text, separator)
    names, units = [name for name, _ in headers], [unit for _, unit in headers]
    columns = [i for i, name in enumerate(names) if name and (used is None or name in used)]
    for count, i in enumerate(columns):
        if names[i] in [names[j] for j in columns[:count]]:
            raise InputError(f"{path}: line {line.number}", f"column {names[i]!r} is there twice", "names must differ")
    layout = _Layout(path, separator, names, units, columns, line.number + 1)
    above = [own.number for own in lines[:place] if not own.text.lstrip().startswith(COMMENTS)]
    notes = (f"the header is line {line.number}: the lines above it are left out",) if above else ()
    return _below_header(file, replace(layout, notes=notes), lines[place:])


def _first_lines(path: Path, file: TextIO, most: int) -> list[_Line]:
    lines: list[_Line] = []
    for number in range(1, most + 1):
        text = file.readline(LONGEST_LINE)
        if not text:
            break
        if "\0" in text or (len(text) >= LONGEST_LINE and not text.endswith("\n")):
            if lines and "\0" not in text:
                break  # told when it is read as a row
            raise InputError(str(path), f"line {number} is no header row", "'time [s],name [unit],…' is needed")
        if text.strip():
            lines.append(_Line(number, text, file.tell()))
    return lines


def _separator(text: str) -> str:
    best = max(SEPARATORS, key=text.count)
    if text.count(best):
        return best
    return BLANKS if len(_WORD.findall(text)) > 1 else ","


def _headers(text: str, separator: str) -> list[tuple[str, str]]:
    if separator == BLANKS:
        return [name_and_unit(word.strip('"')) for word in _WORD.findall(text)]
    try:
        return [name_and_unit(cell) for cell in cells_of(text, separator)]
    except csv.Error:
        return [name_and_unit(cell.strip('"')) for cell in text.rstrip("\r\n").split(separator)]


def _header_place(path: Path, lines: list[_Line], used: Collection[str] | None, stated: str, header: int | None) -> int:
    """Index of the line of the header.

    Raises
    ------
    InputError
        If the line that is named is blank, or the first line holds numbers.
    """
    if header is not None:
        place = next((i for i, line in enumerate(lines) if line.number == header), None)
        if place is None:
            raise InputError(f"{path}: line {header}", "holds no header", "name the line of the header, from 1")
        return place
    scores: list[tuple[int, bool, int]] = []
    for i, line in enumerate(lines):
        text = line.text.lstrip()
        comment = text.startswith(COMMENTS)
        text = text.lstrip("#%/! ") if comment else text
        separator = stated or _separator(text)
        names = {name for name, _ in _headers(text, separator)}
        found = len(names & set(used)) if used is not None else len({name.lower() for name in names} & TIME_NAMES)
        scores.append((found, not comment and _above_numbers(lines[i : i + 5], stated), -i))
    plain = [score for score, line in zip(scores, lines, strict=True) if not line.text.lstrip().startswith(COMMENTS)]
    best = max(scores)
    if best[0]:
        return -best[2]
    first = -(plain or scores)[0][2]
    return next((-i for _, above, i in scores if above), first)


def _above_numbers(lines: list[_Line], stated: str) -> bool:
    """Whether the first of some lines is a row of texts, with a row of as many numbers among the next few."""
    separator = stated or _separator(lines[0].text)
    heads = _headers(lines[0].text, separator)
    if len(heads) < 2 or all(is_number_or_date(name) for name, _ in heads):
        return False
    for line in lines[1:]:
        try:
            cells = cells_of(line.text, separator)
        except csv.Error:
            return False
        if len(cells) < len(heads):
            return False
        if sum(is_number_or_date(cell) for cell in cells) > len(heads) / 2:
            return True
    return False


def is_number_or_date(cell: str) -> bool:
    """Whether a cell is a number, also with a decimal comma, a date or a time of day."""
    plain = cell.strip().replace(",", ".", 1)
    number = number_in(plain)
    return (number is not None and not np.isnan(number)) or clock(cell) is not None


def _below_header(file: TextIO, layout: _Layout, lines: list[_Line]) -> _Layout:
    """Rows of units and types below the header, in which no cell that is used is a number."""
    units, at = layout.units, lines[0].after
    number = lines[0].number
    for line in lines[1:]:
        if line.text.lstrip().startswith(COMMENTS):
            at, number = line.after, line.number
            continue
        try:
            cells = layout.cells(line.text)
        except csv.Error:
            break
        if len(cells) != len(layout.names):
            break
        texts = [cell.strip().strip("[]()") for cell in cells]
        read = [cells[i] for i in layout.columns] or cells
        if any(is_number_or_date(cell) for cell in read) or all(text.lower() in MISSING for text in texts):
            break
        known = any(text in TIME_UNITS for text in texts)
        if known and not any(units):
            units = [text if text.lower() not in MISSING else "" for text in texts]
        at, number = line.after, line.number
    file.seek(at)
    return replace(layout, units=units, first_line=number + 1)


def _labview(path: Path, file: TextIO, lines: list[_Line], used: Collection[str] | None) -> _Layout:
    """LabVIEW's measurement file (.lvm): two heads of keys, then the names of the columns.

    Raises
    ------
    InputError
        If there are no columns below the heads.
    """
    keys: dict[str, list[str]] = {}
    ends = [i for i, line in enumerate(lines) if line.text.startswith("***End_of_Header***")]
    if not ends or len(lines) < ends[-1] + 2:
        raise InputError(str(path), "has no columns below ***End_of_Header***", "export it anew")
    separator = "\t"
    for line in lines[: ends[-1]]:
        if line.text.startswith("Separator") and "Comma" in line.text:
            separator = ","
        cells = line.text.rstrip("\r\n").split(separator)
        keys[cells[0]] = cells[1:]
    head = lines[ends[-1] + 1]
    names = [cell.strip() for cell in head.text.rstrip("\r\n").split(separator)]
    names = names[:-1] if names[-1] in ("Comment", "") else names
    units = [""] * len(names)
    labels = [label.strip() for label in keys.get("Y_Unit_Label", [])]
    if keys.get("X_Columns", ["One"])[0] == "Multi":
        raise InputError(str(path), "has a column of time for every channel", "export it with one column of time")
    for i, label in enumerate(labels[: len(names) - 1], 1):
        units[i] = label
    if names[0] == "X_Value" and "X_Value" not in (used or ()) and keys.get("X_Dimension", ["Time"])[0] in ("Time", ""):
        names[0], units[0] = "time", "s"
    step = None
    if keys.get("X_Columns", ["One"])[0] == "No":
        names[0] = ""
        step = number_in(keys.get("Delta_X", [""])[0].strip().replace(",", "."))
    columns = [i for i, name in enumerate(names) if name and (used is None or name in used)]
    file.seek(head.after)
    return _Layout(path, separator, names, units, columns, head.number + 1, (), step)


# --- Rows of numbers.


def _regular_lines(file: TextIO, layout: _Layout) -> Iterator[str]:
    """Lines with decimal points for decimal commas, as long as all are alike.

    Raises
    ------
    ValueError
        If a line has another number of cells than the header, or the file both points and commas.
    """
    separators, comma, blanks = len(layout.names) - 1, layout.separator != ",", layout.separator == BLANKS
    decimal: set[str] = set()
    if not layout.columns:
        raise ValueError
    for line in islice(file, layout.rows):
        if (len(line.split()) - 1 if blanks else line.count(layout.separator)) != separators:
            raise ValueError
        if comma:
            decimal |= {",", "."} & {*line}
            if len(decimal) > 1:
                raise ValueError
            line = line.replace(",", ".")
        yield line


_GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+")  # 1,234: a decimal comma, or a thousand


def _read_row_by_row(file: TextIO, layout: _Layout) -> Table:
    """Slower: takes missing values, quotes, dates and blank lines, finds the line of a fault."""
    rows: list[list[float | None]] = []
    lines: list[int] = []
    decimal: set[str] = set()
    stamps: dict[int, list[Stamp]] | None = None
    grouped = ""
    for line, cells in _rows(file, layout):
        where = f"{layout.path}: line {line}"
        used = [cells[i].strip() for i in layout.columns]
        if stamps is None:
            stamps = {k: [] for k, cell in enumerate(used) if clock(cell) is not None}
        for k, own in stamps.items():
            stamp = clock(used[k])
            if stamp is None:
                header = layout.header(layout.columns[k])
                raise InputError(where, f"{used[k]!r} in column {header!r}", "write every row's date or time of day")
            own.append(stamp)
            used[k] = "0"
        marks = {",", "."} & {*"".join(cell for cell in used if not _is_missing(cell))}
        if layout.separator != "," or any("," in cell for cell in used):
            decimal |= marks
            if len(decimal) > 1:
                raise InputError(where, "numbers have points here and commas there", "write one kind, ungrouped")
            if layout.separator == ",":
                commas = [cell for cell in used if "," in cell]
                grouped = "no" if any(not _GROUPED.fullmatch(cell) for cell in commas) else grouped or where
                if any(cell.count(",") > 1 for cell in commas):
                    raise InputError(where, "commas divide thousands", "write numbers ungrouped")
            used = [cell.replace(",", ".") for cell in used]
        elif "." in marks and layout.separator == ",":
            decimal.add(".")
        row = [number_in(cell) for cell in used]
        if None in row:
            wrong = row.index(None)
            text = used[wrong] if len(used[wrong]) <= 30 else used[wrong][:27] + "..."
            header = layout.header(layout.columns[wrong])
            raise InputError(where, f"{text!r} in column {header!r}", "write a number or leave it empty")
        rows.append(row)
        lines.append(line)
    if grouped and grouped != "no":
        raise InputError(grouped, "a comma may divide thousands or decimals here", "write numbers ungrouped")
    values, notes = np.array(rows, dtype=float), list(layout.notes)
    for k, own in (stamps or {}).items():
        values[:, k], more = seconds_of(own, f"{layout.path}: column {layout.names[layout.columns[k]]!r}")
        notes += more
    return replace(layout, notes=tuple(notes)).table(values, lines, tuple(stamps or ()))


def _rows(file: TextIO, layout: _Layout) -> Iterator[tuple[int, list[str]]]:
    """Line numbers and cells of the rows that are not blank; empty cells beyond the header are left out."""
    number, count = layout.first_line - 1, len(layout.names)
    last = None if layout.rows is None else number + layout.rows
    while number != last and (text := file.readline(LONGEST_LINE)):
        number += 1
        where = f"{layout.path}: line {number}"
        if len(text) >= LONGEST_LINE and not text.endswith("\n"):
            raise InputError(where, "is longer than any row of numbers", "correct the file")
        if not text.strip():
            continue
        try:
            cells = layout.cells(text)
            if text.startswith(COMMENTS) and len(cells) != count:
                continue
        except csv.Error as error:
            raise InputError(where, f"is no row of a CSV file: {error}", "correct that line") from None
        if len(cells) < count or any(cell.strip() for cell in islice(cells, count, None)):
            if number <= layout.first_line and len(cells) > 1:
                right = f"the header (line {layout.first_line - 1}) has {count} columns; if another line is the header,"
                raise InputError(where, f"{len(cells)} cells", f"{right} write header = LINE in a channel file")
            raise InputError(where, f"{len(cells)} cells", f"the header has {count} columns")
        yield number, cells


def _is_missing(cell: str) -> bool:
    cell = cell.strip().lower()
    return cell.lstrip("+-") in MISSING or _MISSING_NUMBER.fullmatch(cell) is not None


def number_in(cell: str) -> float | None:
    """The number in a cell, NaN where it is missing, None if it is text."""
    cell = cell.strip().lower()
    if _is_missing(cell):
        return np.nan
    try:
        return float(cell) if "_" not in cell else None
    except ValueError:
        return None


# --- Dates and times of day in place of seconds.

DAY = 86_400.0  # s
Stamp = tuple[int | None, float, str]  # day (where the date is unambiguous), seconds of the day, the text
_STAMP = re.compile(
    r"""\s*(?:(?P<date>(?P<y>\d{4})[-/.](?P<m>\d{1,2})[-/.](?P<d>\d{1,2})
      |(?P<d2>\d{1,2})(?P<sign>[./-])(?P<m2>\d{1,2})(?P=sign)(?P<y2>\d{4}|\d\d))(?:[T\s]+|(?=$)))?
    (?:(?P<a>\d{1,3}):(?P<b>\d{2})(?::(?P<c>\d{2}))?(?:[.,:](?P<f>\d+))?\s*(?P<half>[AaPp]\.?[Mm]\.?)?
      \s*(?P<zone>Z|UTC|[+-]\d{2}:?\d{2})?)\s*""",
    re.VERBOSE,
)


def clock(cell: str) -> Stamp | None:
    """A date with a time of day, or the time alone; None where a cell holds something else."""
    if ":" not in cell:
        return None
    match = _STAMP.fullmatch(cell)
    if match is None:
        return None
    first, second, third = int(match["a"]), int(match["b"]), match["c"]
    fraction = float(f"0.{match['f']}") if match["f"] else 0.0
    if third is not None:
        seconds = 3600.0 * first + 60.0 * second + int(third)
    elif match["f"]:
        seconds = 60.0 * first + second  # minutes and seconds, as spreadsheets shorten it
    elif match["date"]:
        seconds = 3600.0 * first + 60.0 * second
    else:
        return None  # 12:34 may be hours and minutes, or minutes and seconds
    if match["half"]:
        seconds += DAY / 2 * (match["half"][0] in "pP") - DAY / 2 * (first == 12)
    day = None
    try:
        if match["y"]:
            day = date(int(match["y"]), int(match["m"]), int(match["d"])).toordinal()
        elif match["sign"] == ".":
            year = int(match["y2"])
            day = date(year + 2000 * (year < 100), int(match["m2"]), int(match["d2"])).toordinal()
    except ValueError:
        return None
    if (zone := match["zone"]) and zone[0] in "+-":
        seconds -= (1 if zone[0] == "+" else -1) * (3600.0 * int(zone[1:3]) + 60.0 * int(zone[-2:]))
    return day, seconds + fraction, cell.strip()


LEAST_STAMPS = 3  # with several rows each
EVEN = 0.2  # of the usual number of rows to a stamp: more even numbers belong to a constant sampling rate


def seconds_of(stamps: list[Stamp], where: str) -> tuple[np.ndarray, list[str]]:
    """Seconds (t,) from the first of some stamps, and notes; rows that share a stamp are spread over it.

    Raises
    ------
    InputError
        If rows share stamps in no regular way.
    """
    clocks = np.array([seconds for _, seconds, _ in stamps])
    days = [day for day, _, _ in stamps]
    if None in days:  # a time of day that falls by more than half a day is past midnight
        passed = np.append(0, np.cumsum(np.diff(clocks) < -DAY / 2)).astype(float)
    else:
        passed = np.array(days, dtype=float) - float(days[0] or 0)
    first = clocks[0]
    seconds = DAY * passed + (clocks - first)
    notes = [f"time is given as date or time of day: 0 s is {stamps[0][2]}"]
    begins = np.flatnonzero(np.append(True, np.diff(seconds) != 0))
    counts = np.diff(begins)
    if len(begins) < 2 or len(seconds) <= 1.05 * len(begins) + 1 or (np.diff(seconds) < 0).any():
        return np.round(seconds, 9), notes
    usual = float(np.median(counts))
    inner = counts[1:] if len(counts) > LEAST_STAMPS else counts
    steps = np.diff(seconds[begins])
    rates = inner / steps[-len(inner) :]
    if len(begins) < LEAST_STAMPS or np.abs(rates / np.median(rates) - 1).max() > max(EVEN, 1.01 / usual):
        raise InputError(where, "several rows have the same time, in no regular way", "write time with more digits")
    rows = begins[1:].astype(float)
    slope = float(np.polyfit(rows, seconds[begins[1:]], 1)[0])
    seconds = np.arange(len(seconds)) * slope
    notes.append(f"some {usual:g} rows share a time stamp: taken as equally spaced, {1 / slope:.6g} Hz")
    return seconds, notes
