"""Readers of measurement files, one for each format: each turns a file into a :class:`Table`, in the file's units.

A reader is told which channels are used, by their names in the file. It need not read others, but names them. A further
format is one function here and one line in ``READERS``. All but CSV are read by libraries in C, in a process of its own
(:mod:`modelling.recordings.child`): if a damaged file crashes the library, the program goes on.
"""

from __future__ import annotations

import csv
import re
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from modelling.errors import InputError, listed

# --- What a reader turns a file into: columns of numbers with names and units.

TIME_NAMES = {"t", "time", "zeit", "times", "timestamp", "timestamps", "time_s", "t_s"}
_NAME_AND_UNIT = re.compile(r"\s*(.*?)\s*(?:\[([^\[\]]*)\])?\s*", re.DOTALL)


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
    """Name and unit of a header ``name [unit]``; the unit is empty where none stands there."""
    match = _NAME_AND_UNIT.fullmatch(header)
    return (match[1], (match[2] or "").strip()) if match else ("", "")


def time_hint(names: Collection[str]) -> str:
    """What to do where no column is called ``time``, with the one that may well be it."""
    likely = next((name for name in names if name.strip().lower() in TIME_NAMES), "NAME")
    return f'call it time, or write time = "{likely}" into a channel file (--channels)'


# --- CSV: a header row, then numbers; separated by commas, or by semicolons or tabs, and then with decimal commas too.

LONGEST_LINE = 65_536  # characters
LARGEST_FILE = 2_000_000_000  # bytes
SEPARATORS = ",;\t"
WINDOWS = "cp1252"  # what spreadsheets write where UTF-8 is not chosen: ° and µ in units
TIME_UNITS = {"s", "sec", "ms", "us", "µs", "min", "h"}  # below the name of time in a row of units
MISSING = {"", "nan", "na", "n/a", "null", "none", "-", "--"}


def read_csv(path: Path, used: Collection[str] | None = None) -> Table:
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

        values = values.reshape(len(values), len(self.columns))
        columns = [Column(self.names[i], self.units[i], values[:, k]) for k, i in enumerate(self.columns)]
        return Table(tuple(columns), place, others=self.others)


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


# --- MATLAB .mat files: one vector a channel, or one struct of them; version 7.3, which is HDF5, by h5py.


def _is_version_7_3(path: Path) -> bool:
    with path.open("rb") as file:
        header = file.read(128)
    return header.startswith(b"MATLAB") and header[124:126] in (b"\x00\x02", b"\x02\x00")


def read_matlab(path: Path, used: Collection[str] | None = None) -> Table:
    """Read a .mat file with a vector ``time`` and one a channel, of one length; only structs and what is used is read.

    Names in MATLAB hold no brackets, so values are in SI, unless a struct ``units`` gives a text by channel.

    Raises
    ------
    InputError
        If it is no such file, a used channel has another length than time, or h5py is missing for version 7.3.
    """
    known = set(used or ()) | {"time"}
    columns_of = {name: place for name in sorted(known) if (place := _column_of_matrix(name))}
    wanted = None if used is None else known | {matrix for matrix, _ in columns_of.values()}
    try:
        variables, others = (_version_7_3 if _is_version_7_3(path) else _version_5)(path, wanted)
    except (InputError, MemoryError):
        raise
    except Exception as fault:  # the libraries raise many kinds for what is not a .mat file
        if isinstance(fault, OSError) and fault.strerror:
            raise
        raise InputError(str(path), f"is no .mat file: {fault}", "save it with MATLAB's save -v7") from None
    structs = [
        value for name, value in variables.items() if isinstance(value, dict) and name != "units" and known & {*value}
    ]
    if not known & {*variables} and len(structs) == 1:
        variables = structs[0]
    variables |= {
        name: _column(path, name, variables[matrix], number)
        for name, (matrix, number) in columns_of.items()
        if name not in variables and matrix in variables
    }
    units = _units(variables.get("units"))
    sizes = [np.size(variables[name]) for name in known & {*variables}]
    length = np.size(variables["time"]) if "time" in variables else max(sizes, key=sizes.count, default=0)
    for name in sorted(known & {*variables}):
        if np.size(variables[name]) != length:
            raise InputError(
                f"{path}: {name!r}",
                f"has {np.size(variables[name])} values, time {length}",
                "save channels of one length, or leave it out",
            )
    columns = {
        name: np.asarray(value, dtype=float).ravel()
        for name, value in variables.items()
        if (used is None or name in known)
        and isinstance(value, np.ndarray)
        and np.size(value) == length
        and np.issubdtype(value.dtype, np.number)
        and value.dtype.kind != "c"
    }
    if "time" in variables and "time" not in columns:
        raise InputError(str(path), "'time' holds no real numbers", "save it as a vector of seconds")
    others = tuple(name for name in (*others, *variables) if name not in columns and name != "units")
    return Table(tuple(Column(name, units.get(name, ""), own) for name, own in columns.items()), others=others)


def _units(struct: Any) -> dict[str, str]:
    """Unit by channel of a struct ``units``, where the file has one."""
    entries = struct.items() if isinstance(struct, dict) else ()
    return {name: unit for name, unit in entries if isinstance(unit, str) and unit}


def _column_of_matrix(name: str) -> tuple[str, int] | None:
    """Matrix and column, from 0: ``data[:,2]`` counts from 0, as NumPy does, ``data(:,3)`` from 1, as MATLAB does."""
    if place := re.fullmatch(r"(.+)\[ *: *, *(\d{1,6}) *\]", name):
        return place[1].strip(), int(place[2])
    if place := re.fullmatch(r"(.+)\( *: *, *([1-9]\d{0,5}) *\)", name):
        return place[1].strip(), int(place[2]) - 1
    return None


def _column(path: Path, name: str, matrix: Any, number: int) -> np.ndarray:
    """A column (t,) of a matrix (t, columns).

    Raises
    ------
    InputError
        If it is no matrix, or has not so many columns.
    """
    if not isinstance(matrix, np.ndarray) or matrix.ndim != 2 or number >= matrix.shape[1]:
        size = " × ".join(map(str, np.shape(matrix))) or "1"
        right = "columns are data[:,0], data[:,1], … or data(:,1), data(:,2), …"
        raise InputError(f"{path}: {name!r}", f"is no column of a {size} matrix", right)
    return np.asarray(matrix[:, number])


def _version_5(path: Path, wanted: set[str] | None) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Values by name, structs as dicts, and the names of what is not read."""
    from scipy.io import loadmat, whosmat  # for the process that reads alone

    names = {name: kind for name, _, kind in whosmat(path)}
    read = [name for name, kind in names.items() if wanted is None or name in wanted or kind == "struct"]
    variables = loadmat(path, simplify_cells=True, variable_names=read) if read else {}
    return {name: variables[name] for name in read if name in variables}, tuple(
        name for name in names if name not in read
    )


def _version_7_3(path: Path, wanted: set[str] | None) -> tuple[dict[str, Any], tuple[str, ...]]:
    try:
        import h5py
    except ImportError:
        right = 'in rigmatch\'s folder: pip install -e ".[measurement]", or save it with -v7'
        raise InputError(str(path), "is a .mat file of version 7.3, which needs h5py", right) from None
    with h5py.File(path) as file:
        others: list[str] = []
        return _members(file, wanted, others), tuple(others)


def _members(group: Any, wanted: set[str] | None, others: list[str]) -> dict[str, Any]:
    """Numbers, texts and structs of a group, as ``loadmat`` would give them; other classes are left out.

    Names of numbers that are not ``wanted`` are added to ``others``.
    """
    import h5py

    members: dict[str, Any] = {}
    for name, member in group.items():
        kind = member.attrs.get("MATLAB_class", b"")
        kind = kind.decode() if isinstance(kind, bytes) else str(kind)
        if isinstance(member, h5py.Group):
            if not name.startswith("#"):
                members[name] = _members(member, wanted, others)
        elif kind == "char":
            members[name] = "" if "MATLAB_empty" in member.attrs else member[()].tobytes().decode("utf-16-le")
        elif member.dtype.kind in "fiu" and "MATLAB_empty" not in member.attrs:
            if wanted is None or name in wanted:
                members[name] = np.asarray(member)
            else:
                others.append(name)
    return members


# --- MDF measurement files, versions 3 and 4, by asammdf: channels by name, units as they stand, on one time base.

SAME_STAMP = 1e-3  # of a step: nearer time stamps are one
SAME_SHARE = 1e-3  # of a channel's range: channels of one name that differ less are copies of each other
LEAST_NUMBERS = 0.5  # of the samples: a channel with fewer holds states, not a quantity with a status now and then


@dataclass(frozen=True)
class _Channel:
    """A channel of numbers: samples and their times (t,) in s, NaN where invalid, and the texts among the samples."""

    name: str
    group: int
    unit: str
    time: np.ndarray
    samples: np.ndarray
    texts: tuple[str, ...]

    @property
    def varies(self) -> bool:
        there = self.samples[np.isfinite(self.samples)]
        return bool(len(there)) and bool(np.ptp(there) > 0)


def read_mdf(path: Path, used: Collection[str] | None = None, groups: Mapping[str, int] | None = None) -> Table:
    """Read an MDF file on the time base with most samples; slower channels are missing between their samples.

    Only channels that are used are read, and only they decide the time base. A sample that is marked invalid, or is a
    text in place of a number, is missing. Where several groups have the same channel, ``groups`` says which one to
    take; copies of one another, and constant ones beside one that varies, need no choice.

    Raises
    ------
    InputError
        If it is no MDF file, has no channel of numbers, a used channel holds none, or several that differ.
    """
    from asammdf import MDF

    groups = groups or {}
    try:
        with MDF(path) as file:
            masters = set(file.masters_db.items())
            places = {name: [place for place in at if place not in masters] for name, at in file.channels_db.items()}
            wanted = [name for name, at in places.items() if at and (used is None or name in used)]
            for name in wanted:
                _check_group(path, name, groups.get(name), [group for group, _ in places[name]])
            signals = {
                name: [
                    (group, file.select([(name, group, index)], copy_master=False)[0])
                    for group, index in places[name]
                    if groups.get(name, group) == group
                ]
                for name in wanted
            }
    except (InputError, MemoryError):
        raise
    except Exception as fault:  # asammdf raises many kinds for what is not MDF
        if isinstance(fault, OSError) and fault.strerror:
            raise
        raise InputError(str(path), f"is no MDF file: {fault}", "save it as MDF 4") from None
    channels, notes = [], []
    for name, versions in signals.items():
        numeric = [
            version for version in (_numeric(name, group, signal) for group, signal in versions) if version is not None
        ]
        if numeric:
            channel, note = _chosen(path, name, numeric)
            channels.append(channel)
            notes += note
        elif used is not None:
            raise InputError(f"{path}: channel {name!r}", "holds no numbers", "record it as one number a sample")
    others = tuple(name for name, at in places.items() if at and name not in [channel.name for channel in channels])
    if not channels and used is None:
        raise InputError(str(path), "has no channel of numbers", "record inputs and sensors into it")
    if not channels:  # what is missing is told by who asked
        return Table((Column("time", "s", np.empty(0)),), others=others)
    return _table(channels, notes, others)


def _check_group(path: Path, name: str, group: int | None, there: list[int]) -> None:
    if group is not None and group not in there:
        raise InputError(
            f"{path}: channel {name!r}", f"is not in group {group}", f"it is in {listed([str(i) for i in there])}"
        )


def _numeric(name: str, group: int, signal: Any) -> _Channel | None:
    """The numbers of a signal; None where it holds none, or more texts than numbers."""
    samples: np.ndarray = signal.samples
    texts: tuple[str, ...] = ()
    if samples.ndim != 1 or not len(samples):
        return None
    if samples.dtype.kind in "SUO":
        samples, texts = _numbers_among_texts(samples)
        if np.isfinite(samples).mean() < LEAST_NUMBERS:
            return None
    elif samples.dtype.kind not in "fiu":
        return None
    samples = samples.astype(float)
    if signal.invalidation_bits is not None:
        samples[np.asarray(signal.invalidation_bits, dtype=bool)] = np.nan
    return _Channel(name, group, signal.unit or "", signal.timestamps, samples, texts)


def _numbers_among_texts(samples: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
    """Numbers (t,) of a channel whose conversion turns some values into texts, NaN for those; and the texts."""
    texts = [value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value) for value in samples]
    numbers: dict[str, float] = {}
    for text in set(texts):
        try:
            numbers[text] = float(text)
        except ValueError:
            numbers[text] = np.nan
    remaining = sorted(text for text, number in numbers.items() if np.isnan(number))
    return np.array([numbers[text] for text in texts]), tuple(remaining)


def _chosen(path: Path, name: str, versions: list[_Channel]) -> tuple[_Channel, list[str]]:
    """Which of the channels of one name to take, and notes of it.

    Raises
    ------
    InputError
        If they differ.
    """
    varying = [version for version in versions if version.varies] or versions
    best = max(varying, key=lambda version: len(version.time))
    different = [version for version in varying if version is not best and not _same(best, version)]
    if different:
        there = listed(
            [str(version.group) for version in sorted([best, *different], key=lambda version: version.group)]
        )
        raise InputError(
            f"{path}: channel {name!r}",
            f"has different values in the groups {there}",
            f'choose one in a channel file: {name} = {{ channel = "{name}", group = {best.group} }}',
        )
    notes = []
    if len(versions) > 1:
        why = "the one that varies" if len(varying) < len(versions) else "with most samples"
        notes.append(f"{name} is in {len(versions)} groups, taken from group {best.group}: {why}")
    if best.texts:
        notes.append(f"{name} has the texts {listed(list(best.texts), 3)} among its numbers: those samples are missing")
    return best, notes


def _same(first: _Channel, second: _Channel) -> bool:
    """Whether the second agrees with the first wherever it has samples."""
    both = np.isfinite(first.samples)
    there = np.isfinite(second.samples) & (second.time >= first.time[0]) & (second.time <= first.time[-1])
    if not both.any() or not there.any() or first.unit != second.unit:
        return False
    expected = np.interp(second.time[there], first.time[both], first.samples[both])
    return bool(np.abs(second.samples[there] - expected).max() <= SAME_SHARE * np.ptp(first.samples[both]))


def _table(channels: list[_Channel], notes: list[str], others: tuple[str, ...]) -> Table:
    time = max((channel.time for channel in channels), key=len)
    columns, moved = [Column("time", "s", time)], []
    for channel in channels:
        values, between = _placed(time, channel.time, channel.samples)
        columns.append(Column(channel.name, channel.unit, values))
        if between:
            moved.append(channel.name)
    if moved:
        notes = [
            f"channels sampled at other times, brought to the time base with most samples: {listed(moved)}; straight "
            "lines between samples",
            *notes,
        ]
    return Table(tuple(columns), notes=tuple(notes), others=others)


def _placed(time: np.ndarray, stamps: np.ndarray, samples: np.ndarray) -> tuple[np.ndarray, int]:
    """Samples on a time base (t,): each at the row nearest to it, nothing in between; and how many had to be moved.

    A sample that lies beside its row is moved there on the straight line to its neighbour, at most half a step, so that
    a slow channel stays as slow as it is and none is made up.
    """
    placed = np.full(len(time), np.nan)
    there = np.isfinite(stamps) & np.isfinite(samples)
    stamps, samples = stamps[there], samples[there]
    if not len(stamps) or len(time) < 2:
        return placed, 0
    step = float(np.median(np.diff(time)))
    inside = (stamps >= time[0] - 0.5 * step) & (stamps <= time[-1] + 0.5 * step)
    right = np.clip(np.searchsorted(time, stamps), 1, len(time) - 1)
    rows = np.where(stamps - time[right - 1] <= time[right] - stamps, right - 1, right)
    beside = np.abs(stamps - time[rows]) > SAME_STAMP * step
    known = inside & (~beside | ((time[rows] >= stamps[0]) & (time[rows] <= stamps[-1])))
    values = np.where(beside, np.interp(time[rows], stamps, samples), samples)
    placed[rows[known]] = values[known]
    return placed, int((known & beside).sum())


# --- Parquet: columns named ``name [unit]``, or a ``unit`` in the field's metadata; time may be a date or a duration.

TICKS_PER_SECOND = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}


def read_parquet(path: Path, used: Collection[str] | None = None) -> Table:
    """Read a Parquet file.

    Raises
    ------
    InputError
        If it is no Parquet file, or ``time`` holds no numbers.
    """
    import pyarrow
    import pyarrow.parquet

    try:
        fields = pyarrow.parquet.read_schema(path).names
        wanted = [name for name in fields if used is None or name_and_unit(name)[0] in used]
        table = pyarrow.parquet.read_table(path, columns=wanted)
    except MemoryError:
        raise
    except (pyarrow.ArrowException, ValueError, OSError) as fault:
        if isinstance(fault, OSError) and fault.strerror:
            raise
        raise InputError(str(path), f"is no Parquet file: {fault}", "write it as Parquet") from None
    columns = []
    for field, values in zip(table.schema, table.columns, strict=True):
        name, unit = name_and_unit(field.name)
        if pyarrow.types.is_duration(field.type) or pyarrow.types.is_timestamp(field.type):
            ticks = values.cast(pyarrow.int64()).to_numpy()
            values, unit = (ticks - ticks[:1]) / TICKS_PER_SECOND[field.type.unit], "s"
        elif pyarrow.types.is_integer(field.type) or pyarrow.types.is_floating(field.type):
            unit = unit or (field.metadata or {}).get(b"unit", b"").decode(errors="replace")
            values = values.to_numpy().astype(float)
        elif name == "time":
            raise InputError(str(path), f"column {field.name!r} holds {field.type}", "write time as seconds")
        else:
            continue  # e.g. a comment; a channel of the model that is missing is reported later
        columns.append(Column(name, unit, values))
    read = {column.name for column in columns}
    others = tuple(name for name in (name_and_unit(field)[0] for field in fields) if name not in read)
    return Table(tuple(columns), others=others)


# --- Which reader takes which file

READERS: dict[str, Callable[..., Table]] = {
    ".csv": read_csv,
    ".txt": read_csv,
    ".mat": read_matlab,
    ".parquet": read_parquet,
    ".mf4": read_mdf,
    ".mdf": read_mdf,
    ".dat": read_mdf,
}


def read_table(path: str | Path, used: Collection[str] | None = None, groups: Mapping[str, int] | None = None) -> Table:
    """Read a file by its suffix.

    Parameters
    ----------
    path : path
    used : collection of str, optional
        Channels to read, by their names in the file; by default all.
    groups : mapping of str to int, optional
        Of a file with groups (MDF): the group to take a channel from.

    Raises
    ------
    InputError
        If the format is not known or the file cannot be read; if groups are named for a format without them.
    """
    from modelling.recordings.child import read_in_child

    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in READERS:
        raise InputError(str(path), f"{suffix or 'no suffix'!r} is no known format", f"read are {', '.join(READERS)}")
    options = {"groups": dict(groups)} if groups else {}
    if groups and READERS[suffix] is not read_mdf:
        raise InputError(str(path), f"{suffix} files have no groups", "drop group in the channel file")
    try:
        if READERS[suffix] is read_csv:
            return read_csv(path, used)
        return read_in_child(path, used, options)  # a library in C, which a damaged file may crash
    except FileNotFoundError:
        raise InputError(str(path), "does not exist", "name an existing file") from None
    except OSError as error:
        raise InputError(str(path), error.strerror or "cannot be read", "name a readable file") from None
    except ModuleNotFoundError as error:
        right = 'in rigmatch\'s folder: pip install -e ".[measurement]", or save as CSV'
        raise InputError(str(path), f"reading {suffix} needs the package {error.name}", right) from None


def reader_of(path: Path) -> Callable[..., Table]:
    """The reader of a file by its suffix."""
    return READERS[path.suffix.lower()]
