"""Readers of measurement files, one for each format: each turns a file into a :class:`Table`, in the file's units.

A reader is told which channels are used, by their names in the file. It need not read others, but names them. A further
format is one function here and one line in ``READERS``. All but CSV are read by libraries in C, in a process of its own
(:mod:`modelling.recordings.child`): if a damaged file crashes the library, the program goes on.
"""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from modelling.errors import InputError, listed
from modelling.recordings.hierarchical import read_hdf5, read_tdms
from modelling.recordings.matlab import read_matlab
from modelling.recordings.table import Column, Table, name_and_unit
from modelling.recordings.text import is_text, number_in, read_csv

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
            _check_masters(path, signals)
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


OTHER_MASTERS = {2: "an angle", 3: "a distance", 4: "an index"}  # by MDF's sync type; 1 is time


def _check_masters(path: Path, signals: Mapping[str, list[tuple[int, Any]]]) -> None:
    """Raise ``InputError`` for a channel that is not recorded over time."""
    for name, versions in signals.items():
        for group, signal in versions:
            master, kind = signal.master_metadata or ("", 1)
            if kind in OTHER_MASTERS:
                wrong = f"group {group} is recorded over {OTHER_MASTERS[kind]} ({master!r}), not over time"
                raise InputError(f"{path}: channel {name!r}", wrong, "record it over time, or name another group")


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
        elif (numbers := _numbers(field.type, values, used is None or name in used)) is not None:
            unit = unit or (field.metadata or {}).get(b"unit", b"").decode(errors="replace")
            values = numbers
        elif name == "time":
            raise InputError(str(path), f"column {field.name!r} holds {field.type}", "write time as seconds")
        else:
            continue  # e.g. a comment
        columns.append(Column(name, unit, values))
    read = {column.name for column in columns}
    others = tuple(name for name in (name_and_unit(field)[0] for field in fields) if name not in read)
    return Table(tuple(columns), others=others)


def _numbers(kind: Any, values: Any, wanted: bool) -> np.ndarray | None:
    """Values (t,) of a column of numbers, of decimals, or of numbers that were written as text; else None.

    A text is looked at only if its channel is ``wanted``; all of them have to be numbers or stand for missing ones.
    """
    import pyarrow

    types = pyarrow.types
    if types.is_integer(kind) or types.is_floating(kind):
        return np.asarray(values.to_numpy(), dtype=float)
    if types.is_dictionary(kind) and wanted:
        return _numbers(kind.value_type, values.cast(kind.value_type), wanted)
    if types.is_decimal(kind):
        return np.asarray(values.cast(pyarrow.float64(), safe=False).to_numpy(), dtype=float)
    if wanted and (types.is_string(kind) or types.is_large_string(kind)):
        texts = [text for text in values.to_pylist() if text is not None]
        comma = any("," in text for text in texts) and not any("." in text for text in texts)
        read = [number_in(text.replace(",", ".") if comma else text) for text in texts]
        if texts and None not in read:
            there = np.array([text is not None for text in values.to_pylist()])
            out = np.full(len(there), math.nan)
            out[there] = read
            return out
    return None


# --- Libraries in C read in a process of their own

CHILD = "modelling.recordings.child"
LEAST_SECONDS, BYTES_PER_SECOND = 120.0, 5e6  # limit of processor time: at least, and by the file's size
WAITED = 10  # times that limit, by the clock: the machine may have other work
LEAST_BYTES, FILE_SIZES = 4_000_000_000, 30  # memory limit: at least, and in file sizes (files may be compressed)
DAMAGED = "it is probably damaged: save it again, or as CSV"


def read_in_child(path: Path, used: Collection[str] | None, options: Mapping[str, Any]) -> Table:
    """The table that the reader of this file makes.

    Raises
    ------
    InputError
        If the file is not right; if reading it crashes, takes too long or needs too much memory.
    ModuleNotFoundError, FileNotFoundError
        If the reader needs a package that is missing; if there is no such file.
    """
    size = path.stat().st_size
    seconds, most = LEAST_SECONDS + size / BYTES_PER_SECOND, LEAST_BYTES + FILE_SIZES * size
    request = {
        "path": str(path), "used": used if used is None else sorted(used), "options": options,
        "bytes": most, "seconds": math.ceil(seconds),
    }  # fmt: skip
    too_slow = InputError(str(path), f"is not read within {seconds:.0f} s", DAMAGED)
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(sys.path), "ARROW_DEFAULT_MEMORY_POOL": "system",
        "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1",
    }  # fmt: skip
    with TemporaryDirectory(prefix="rigmatch-") as temporary:  # asammdf leaves files there
        numbers = Path(temporary) / "numbers"
        request["numbers"] = str(numbers)
        try:
            done = subprocess.run(
                [sys.executable, "-P", "-m", CHILD], input=json.dumps(request).encode(), capture_output=True,
                env=environment | {"TMPDIR": temporary, "TEMP": temporary}, timeout=WAITED * seconds, check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            raise too_slow from None
        # mapped, so that memory holds what is looked at alone; the file lives as long as its values do
        values = np.memmap(numbers, np.float64, "c") if numbers.exists() and numbers.stat().st_size else np.zeros(0)
    line = done.stdout
    if not line or done.returncode:
        code = done.returncode
        if sys.platform != "win32" and code == -signal.SIGXCPU:
            raise too_slow
        end = signal.Signals(-code).name if code < 0 and -code in set(signal.Signals) else f"exit {code}"
        raise InputError(str(path), f"the library that reads it crashed ({end})", DAMAGED)
    head = json.loads(line)
    if "wrong" in head:
        raise InputError(*head["wrong"])
    if "needs" in head:
        raise ModuleNotFoundError(name=head["needs"])
    if "memory" in head:
        raise InputError(str(path), f"needs more than {most / 1e9:.1f} GB to be read", DAMAGED)
    count = len(head["columns"])
    rows = values.reshape(count, -1 if count else 0)
    columns = [Column(name, unit, np.asarray(own)) for (name, unit), own in zip(head["columns"], rows, strict=True)]
    return Table(tuple(columns), notes=tuple(head["notes"]), others=tuple(head["others"]))


# --- Which reader takes which file

READERS: dict[str, Callable[..., Table]] = {
    ".csv": read_csv,
    ".txt": read_csv,
    ".tsv": read_csv,
    ".lvm": read_csv,
    ".mat": read_matlab,
    ".h5": read_hdf5,
    ".hdf5": read_hdf5,
    ".tdms": read_tdms,
    ".parquet": read_parquet,
    ".mf4": read_mdf,
    ".mdf": read_mdf,
    ".dat": read_mdf,
}
MAGIC: dict[bytes, Callable[..., Table]] = {
    b"MDF     ": read_mdf, b"UnFinMF ": read_mdf, b"PAR1": read_parquet, b"MATLAB 5.0": read_matlab,
    b"MATLAB 7.3": read_matlab, b"\x89HDF\r\n\x1a\n": read_hdf5, b"TDSm": read_tdms,
}  # fmt: skip


def reader_of(path: Path) -> Callable[..., Table]:
    """The reader of a file: by its first bytes, else by its suffix; a ``.dat`` or ``.mat`` that is text is a table."""
    suffix = path.suffix.lower()
    with path.open("rb") as file:
        start = file.read(16)
    found = next((reader for magic, reader in MAGIC.items() if start.startswith(magic)), None)
    if found is None and suffix == ".dat" and start and is_text(path):
        return read_csv
    return found or READERS[suffix]


def read_table(
    path: str | Path,
    used: Collection[str] | None = None,
    groups: Mapping[str, int] | None = None,
    header: int | None = None,
) -> Table:
    """Read a file by its suffix and its first bytes.

    Parameters
    ----------
    path : path
    used : collection of str, optional
        Channels to read, by their names in the file; by default all.
    groups : mapping of str to int, optional
        Of a file with groups (MDF): the group to take a channel from.
    header : int, optional
        Of a table in text: the line of its header, from 1.

    Raises
    ------
    InputError
        If the format is not known or the file cannot be read; if groups or a header are named for a format without.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix == ".toml":
        raise InputError(
            str(path), "is a model or case file, where a recording is expected", "check the order of files"
        )
    if suffix not in READERS:
        raise InputError(str(path), f"{suffix or 'no suffix'!r} is no known format", f"read are {', '.join(READERS)}")
    try:
        reader = reader_of(path)
        if groups and reader is not read_mdf:
            raise InputError(str(path), f"{suffix} files have no groups", "drop group in the channel file")
        if reader is read_csv:
            return read_csv(path, used, header)
        if header is not None:
            raise InputError(str(path), "has no header line", "drop header in the channel file")
        return read_in_child(
            path, used, {"groups": dict(groups)} if groups else {}
        )  # a damaged file may crash a library
    except FileNotFoundError:
        raise InputError(str(path), "does not exist", "name an existing file") from None
    except OSError as error:
        raise InputError(str(path), error.strerror or "cannot be read", "name a readable file") from None
    except ModuleNotFoundError as error:
        right = 'in rigmatch\'s folder: pip install -e ".[measurement]", or save as CSV'
        raise InputError(str(path), f"reading {suffix} needs the package {error.name}", right) from None
