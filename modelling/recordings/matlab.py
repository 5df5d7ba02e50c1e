"""MATLAB's ``.mat`` files: which vectors they hold, by the names that their makers gave them.

Vectors, matrices, structs of vectors, and the structure arrays of two tools that record test beds: Structure With Time
of Simulink (``time``, ``signals(i).values``, ``.label``) and ``X``, ``Y(i).Name``, ``.Data`` of real-time recorders.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from struct import error, unpack, unpack_from
from typing import Any

import numpy as np

from modelling.errors import InputError
from modelling.recordings.table import Column, Table, check_size

MOST_COLUMNS = 64  # of a matrix that are listed; what is wider is no set of channels
NO_UNIT = {"", "-", "1"}
IN_STRUCTS = {"values", "Data", "XIndex"}  # fields that hold what a tool recorded
LEAST_SAMPLES = 2  # of a channel; a single number is a parameter of the bed


@dataclass(frozen=True)
class _Vector:
    """A channel: name, where it stands in the file, the place (``""``: top level) that it shares a time with, unit."""

    name: str
    place: str
    group: str
    unit: str
    values: np.ndarray


def read_matlab(path: Path, used: Collection[str] | None = None) -> Table:
    """Read a .mat file; its channels have one length.

    A channel has its label where it has one, else its name; where two would be the same, its place in the file, such as
    ``run2.speed``, which always names it. ``data[:,2]`` (from 0) or ``data(:,3)`` (from 1) is a column of a matrix,
    ``data[2,:]`` or ``data(3,:)`` a row. Names in MATLAB hold no brackets, so values are in SI, unless a struct
    ``units`` gives a text by channel, or a recorder a ``Unit``.

    Raises
    ------
    InputError
        If it is no such file, a used channel has another length than time, or h5py is missing for version 7.3.
    """
    known = set(used or ()) | {"time"}
    wanted = None
    if used is not None:
        wanted = known | {place[0] for name in known if (place := _line_of_matrix(name))} | IN_STRUCTS
        wanted |= {name.rpartition(".")[2] for name in known}
    try:
        variables, unread = (_version_7_3 if _is_version_7_3(path) else _version_5)(path, wanted)
    except (InputError, MemoryError):
        raise
    except Exception as fault:  # the libraries raise many kinds for what is not a .mat file
        if isinstance(fault, OSError) and fault.strerror:
            raise
        raise InputError(str(path), f"is no .mat file: {fault}", "save it with MATLAB's save -v7") from None
    variables = {name: value for name, value in variables.items() if not name.startswith("__")}
    vectors = _named([*_vectors(variables, "", "")], known)
    for name in known:
        if place := _line_of_matrix(name):
            vectors[name] = _Vector(name, name, "", "", _line(path, name, variables.get(place[0]), *place[1:]))
    if used is None:
        vectors = _lines_of_matrices(variables) | vectors
    chosen = {name: vector for name, vector in vectors.items() if used is None or name in known}
    length = _length(chosen)
    for name in sorted(known & {*chosen}):
        if len(chosen[name].values) != length:
            raise InputError(
                f"{path}: {name!r}",
                f"has {len(chosen[name].values)} values, {'time' if 'time' in chosen else 'others'} {length}",
                "save channels of one length, or leave it out",
            )
    kept = {name: vector for name, vector in chosen.items() if len(vector.values) == length}
    if "time" not in vectors and "time" in variables and not isinstance(variables["time"], dict):
        raise InputError(str(path), "'time' holds no real numbers", "save it as a vector of seconds")
    notes: tuple[str, ...] = ()
    if used is None and (short := [f"{name} ({len(v.values)})" for name, v in vectors.items() if name not in kept]):
        notes = (f"not listed, for they have another number of values: {', '.join(short)}",)
    columns = tuple(Column(name, vector.unit, vector.values) for name, vector in kept.items())
    others = [name for name in vectors if name not in kept]
    others += [name for name in (*unread, *_lines_of_matrices(variables)) if name not in kept and name not in others]
    return Table(columns, notes=notes, others=tuple(others))


def _units(struct: Any) -> dict[str, str]:
    """Unit by channel of a struct ``units``, where the file has one."""
    entries = struct.items() if isinstance(struct, dict) else ()
    return {name: unit for name, unit in entries if isinstance(unit, str) and unit}


def _vectors(value: Any, place: str, group: str) -> Iterator[_Vector]:
    """The vectors within a struct (or the whole file), by whatever way it holds them."""
    taken: set[str] = set()
    if isinstance(value.get("signals"), dict | list):  # Simulink's scopes and blocks "To Workspace"
        taken = {"signals", "blockName"}
        for at, signal in _each(value["signals"], f"{place}.signals" if place else "signals"):
            name = _text(signal, "label") or _text(signal, "blockName").rpartition("/")[2] or at
            yield from _series(signal.get("values"), name, f"{at}.values", place, "")
    axes = _each(value.get("X"), f"{place}.X" if place else "X")
    if axes and "Y" in value and all("Data" in axis for _, axis in axes):  # a real-time recorder
        taken |= {"X", "Y"}
        for at, axis in axes:
            yield from _series(axis["Data"], "time", f"{at}.Data", at, _text(axis, "Unit"))
        for at, signal in _each(value["Y"], f"{place}.Y" if place else "Y"):
            stated = np.ravel(signal.get("XIndex", 1))
            which = int(stated[0]) - 1 if len(stated) == 1 and 1 <= stated[0] <= len(axes) else 0
            yield from _series(
                signal.get("Data"), _text(signal, "Name") or at, f"{at}.Data", axes[which][0], _text(signal, "Unit")
            )
    units = _units(value.get("units"))
    for name, entry in value.items():
        at = f"{place}.{name}" if place else name
        if name in taken or (name == "units" and isinstance(entry, dict)):
            continue
        if isinstance(entry, dict):
            yield from _vectors(entry, at, at)
        elif structs := _each(entry, at) if isinstance(entry, list) or _is_objects(entry) else []:
            for each, struct in structs:
                yield from _vectors(struct, each, each)
        elif _is_real(entry) and _is_vector(entry):
            yield _Vector(name, at, group, units.get(name, ""), np.asarray(entry, dtype=float).ravel())


def _series(values: Any, name: str, place: str, group: str, unit: str) -> Iterator[_Vector]:
    """A signal of a tool: a vector, or a matrix of which every column is one."""
    if not _is_real(values):
        return
    unit = "" if unit in NO_UNIT else unit
    values = np.asarray(values, dtype=float)
    if _is_vector(values):
        yield _Vector(name, place, group, unit, values.ravel())
    elif values.ndim == 2:
        for j in range(min(values.shape[1], MOST_COLUMNS)):
            yield _Vector(f"{name}[:,{j}]", f"{place}[:,{j}]", group, unit, values[:, j])


def _each(value: Any, place: str) -> list[tuple[str, dict[str, Any]]]:
    """The structs of a structure array with their places, which count from 1 as MATLAB does."""
    if isinstance(value, dict):
        return [(place, value)]
    entries = list(value) if isinstance(value, list) or _is_objects(value) else []
    return [(f"{place}({i})", entry) for i, entry in enumerate(entries, 1) if isinstance(entry, dict)]


def _is_objects(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype == object and value.ndim == 1


def _is_real(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype.kind in "fiub" and value.size > 0


def _is_vector(value: np.ndarray) -> bool:
    return value.size == max(value.shape, default=0) and value.size >= LEAST_SAMPLES


def _text(struct: dict[str, Any], key: str) -> str:
    text = struct.get(key, "")
    return text.strip() if isinstance(text, str) else ""


def _named(found: list[_Vector], known: set[str]) -> dict[str, _Vector]:
    """The vectors by name; where several share one, it is that of the group with most of the channels that are used.

    The others are known by their places.
    """
    used = [
        vector.group for vector in found if (vector.name in known and vector.name != "time") or vector.place in known
    ]
    groups = dict.fromkeys(vector.group for vector in found)
    sizes = {group: sum(vector.group == group for vector in found) for group in groups}
    times = {vector.group for vector in found if vector.name == "time"}
    first = max(groups, key=lambda group: (used.count(group), group in times, sizes[group]), default="")
    named: dict[str, _Vector] = {}
    for vector in sorted(found, key=lambda vector: vector.group != first):
        alone = sum(other.name == vector.name for other in found) == 1
        if vector.place in known:
            named[vector.place] = vector
        elif (alone or vector.group == first) and vector.name not in named:
            named[vector.name] = vector
        else:
            named[vector.place] = vector
    return named


def _length(chosen: dict[str, _Vector]) -> int:
    """How many samples the channels have: those of time, else those that most have."""
    if "time" in chosen:
        return len(chosen["time"].values)
    sizes = [len(vector.values) for vector in chosen.values()]
    return max(sizes, key=lambda size: (sizes.count(size), size), default=0)


# --- Columns and rows of a matrix


def _line_of_matrix(name: str) -> tuple[str, int, int] | None:
    """Matrix, axis (1: a column) and number from 0 of ``data[:,2]``, ``data(:,3)``, ``data[2,:]`` or ``data(3,:)``."""
    for pattern, axis, first in (
        (r"(.+)\[ *: *, *(\d{1,6}) *\]", 1, 0), (r"(.+)\( *: *, *([1-9]\d{0,5}) *\)", 1, 1),
        (r"(.+)\[ *(\d{1,6}) *, *: *\]", 0, 0), (r"(.+)\( *([1-9]\d{0,5}) *, *: *\)", 0, 1),
    ):  # fmt: skip
        if place := re.fullmatch(pattern, name):
            return place[1].strip(), axis, int(place[2]) - first
    return None


def _line(path: Path, name: str, matrix: Any, axis: int, number: int) -> np.ndarray:
    """A column (t,) of a matrix (t, columns), or a row.

    Raises
    ------
    InputError
        If it is no matrix of real numbers, or has not so many columns or rows.
    """
    if not _is_real(matrix) or matrix.ndim != 2 or number >= matrix.shape[axis]:
        size = " × ".join(map(str, np.shape(matrix))) or "1"
        line, right = ("row", "rows are data(1,:), data(2,:), …")
        if axis:
            line, right = "column", "columns are data[:,0], data[:,1], … or data(:,1), data(:,2), …"
        raise InputError(f"{path}: {name!r}", f"is no {line} of a {size} matrix", right)
    return np.asarray(matrix.take(number, axis), dtype=float)


def _lines_of_matrices(variables: dict[str, Any]) -> dict[str, _Vector]:
    """Columns of the matrices at top level, or rows where these are longer."""
    found = {}
    for name, value in variables.items():
        if _is_real(value) and value.ndim == 2 and not _is_vector(value) and min(value.shape) > 1:
            axis = 1 if value.shape[0] >= value.shape[1] else 0
            for i in range(min(value.shape[axis], MOST_COLUMNS)):
                line = f"{name}[:,{i}]" if axis else f"{name}[{i},:]"
                found[line] = _Vector(line, line, "", "", np.asarray(value.take(i, axis), dtype=float))
    return found


# --- How much is compressed in a file of version 5 to 7.2, without inflating it.

INFLATED_HEAD = 4096  # bytes of a variable that are inflated to see its name: it stands behind flags and dimensions
_COMPRESSED, _MATRIX = 15, 14  # types of an element


def _sizes(path: Path) -> dict[str, int]:
    """Bytes that every variable of a file of version 5 to 7.2 says it has once inflated, by name."""
    sizes: dict[str, int] = {}
    with path.open("rb") as file:
        order = "<" if file.read(128)[126:128] == b"IM" else ">"
        while len(tag := file.read(8)) == 8:
            kind, length = unpack(f"{order}II", tag)
            at = file.tell()
            head = file.read(min(length, INFLATED_HEAD))
            if kind == _COMPRESSED:
                try:
                    head = zlib.decompressobj().decompress(head, INFLATED_HEAD)
                except zlib.error:
                    return sizes  # damaged: the library says where
                if len(head) < 8:
                    return sizes
                kind, size = unpack_from(f"{order}II", head)
                head = head[8:]
            else:
                size = length
            if kind == _MATRIX:
                try:
                    name = _name_of(head, order)
                except error:
                    return sizes
                sizes[name or f"variable {len(sizes) + 1}"] = size
            file.seek(at + length)
    return sizes


def _name_of(head: bytes, order: str) -> str:
    """Name of a variable: behind its flags and its dimensions."""
    at = 0
    for _ in range(2):
        _, length = unpack_from(f"{order}II", head, at)
        at += 8 + -(-length // 8) * 8
    small, length = unpack_from(f"{order}I", head, at)[0], 0
    if small >> 16:  # up to four letters stand in the tag itself
        return head[at + 4 : at + 4 + (small >> 16)].decode("latin-1")
    (length,) = unpack_from(f"{order}I", head, at + 4)
    return head[at + 8 : at + 8 + length].decode("latin-1")


# --- Versions 5 to 7.2, by SciPy, and 7.3, which is HDF5, by h5py.


def _is_version_7_3(path: Path) -> bool:
    with path.open("rb") as file:
        header = file.read(128)
    return header.startswith(b"MATLAB") and header[124:126] in (b"\x00\x02", b"\x02\x00")


def _version_5(path: Path, wanted: set[str] | None) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Values by name, structs as dicts, and the names of what is not read."""
    from scipy.io import loadmat, whosmat  # for the process that reads alone

    try:
        kinds = {name: kind for name, _, kind in whosmat(path)}
    except TypeError:  # an object (a string "…", a table, a datetime) is in the file: SciPy cannot list it
        kinds = {}
    sizes = _sizes(path)
    if not kinds:
        check_size(path, sizes)
        return _beside_objects(path, loadmat(path, simplify_cells=True)), ()
    read = [name for name, kind in kinds.items() if wanted is None or name in wanted or kind == "struct"]
    check_size(path, {name: sizes.get(name, 0) for name in read})
    variables = loadmat(path, simplify_cells=True, variable_names=read) if read else {}
    return {name: variables[name] for name in read if name in variables}, tuple(
        name for name in kinds if name not in read
    )


OBJECTS = "save plain vectors, for example time = seconds(tt.Time - tt.Time(1)); motor_torque = tt.motor_torque; …"


def _beside_objects(path: Path, variables: dict[str, Any]) -> dict[str, Any]:
    """The vectors and structs in a file that holds MATLAB objects too.

    Raises
    ------
    InputError
        If there are objects alone.
    """
    plain = {
        name: value
        for name, value in variables.items()
        if isinstance(value, dict | str) or (isinstance(value, np.ndarray) and value.dtype.kind in "fiub")
    }
    plain = {name: value for name, value in plain.items() if not name.startswith("__")}
    if not any(isinstance(value, dict) or np.size(np.asarray(value)) > 1 for value in plain.values()):
        raise InputError(str(path), "holds MATLAB objects only (timetable, table or timeseries)", OBJECTS)
    return plain


def _version_7_3(path: Path, wanted: set[str] | None) -> tuple[dict[str, Any], tuple[str, ...]]:
    try:
        import h5py
    except ImportError:
        right = 'in rigmatch\'s folder: pip install -e ".[measurement]", or save it with -v7'
        raise InputError(str(path), "is a .mat file of version 7.3, which needs h5py", right) from None
    with h5py.File(path) as file:
        others: list[str] = []
        check_size(path, sizes_in(file, wanted))
        members = _members(path, file, wanted, others)
        if not members and not others and any("MATLAB_object_decode" in item.attrs for item in file.values()):
            raise InputError(str(path), "holds MATLAB objects only (timetable, table or timeseries)", OBJECTS)
        return members, tuple(others)


NUMBERS = {"", "double", "single", "logical", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64))}


def sizes_in(group: Any, wanted: set[str] | None = None) -> dict[str, int]:
    """Bytes of the numbers that would be read, by name."""
    import h5py

    sizes: dict[str, int] = {}

    def add(name: str, member: Any) -> None:
        last = name.rpartition("/")[2]
        if isinstance(member, h5py.Dataset) and (wanted is None or last in wanted or name.startswith("#")):
            sizes[name] = (member.size or 0) * member.dtype.itemsize

    group.visititems(add)
    return sizes


def _member(path: Path, group: Any, name: str) -> Any:
    """A member of a group.

    Raises
    ------
    InputError
        If its values lie outside the file: another file's content is nobody's recording.
    """
    import h5py

    link = group.get(name, getlink=True)
    if isinstance(link, h5py.ExternalLink | h5py.SoftLink):
        raise InputError(f"{path}: {name!r}", "is a link", "save the values themselves")
    member = group[name]
    if isinstance(member, h5py.Dataset) and (member.external or member.is_virtual):
        raise InputError(f"{path}: {name!r}", "has its values in another file", "save the values themselves")
    return member


def _members(path: Path, group: Any, wanted: set[str] | None, others: list[str]) -> dict[str, Any]:
    """Numbers, texts and structs of a group, as ``loadmat`` would give them; other classes are left out.

    Names of numbers that are not ``wanted`` are added to ``others``.
    """
    import h5py

    members: dict[str, Any] = {}
    for name in group:
        member = _member(path, group, name)
        kind = member.attrs.get("MATLAB_class", b"")
        kind = kind.decode() if isinstance(kind, bytes) else str(kind)
        if isinstance(member, h5py.Group):
            if not name.startswith("#"):
                array = _structs(path, member, wanted, others)
                members[name] = _members(path, member, wanted, others) if array is None else array
        elif kind == "char":
            members[name] = _chars(member)
        elif kind in NUMBERS and member.dtype.kind in "fiu" and "MATLAB_empty" not in member.attrs:
            if wanted is None or name in wanted:
                members[name] = np.asarray(member).T  # MATLAB's order is the other way round
            else:
                others.append(name)
    return members


def _chars(member: Any) -> str:
    return "" if "MATLAB_empty" in member.attrs else member[()].tobytes().decode("utf-16-le")


def _structs(path: Path, group: Any, wanted: set[str] | None, others: list[str]) -> list[dict[str, Any]] | None:
    """A structure array, whose fields are lists of references to their values; None if the group is one struct."""
    import h5py

    fields = {name: _member(path, group, name) for name in group}
    if not fields or not all(
        isinstance(field, h5py.Dataset) and h5py.check_ref_dtype(field.dtype) is h5py.Reference
        for field in fields.values()
    ):
        return None
    structs: list[dict[str, Any]] = []
    for i in range(min(field.size for field in fields.values())):
        struct: dict[str, Any] = {}
        for name, field in fields.items():
            member = group.file[np.ravel(field[()])[i]]
            if isinstance(member, h5py.Group):
                struct[name] = _members(path, member, None, others)
            elif member.external or member.is_virtual:
                raise InputError(f"{path}: {name!r}", "has its values in another file", "save the values themselves")
            elif member.attrs.get("MATLAB_class", b"") in (b"char", "char"):
                struct[name] = _chars(member)
            elif member.dtype.kind in "fiu" and "MATLAB_empty" not in member.attrs:
                struct[name] = np.asarray(member).T
        structs.append(struct)
    return structs
