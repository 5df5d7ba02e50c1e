"""MATLAB .mat files: one vector a channel, or one struct of them; version 7.3, which is HDF5, by h5py."""

from __future__ import annotations

import re
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from modelling.common.errors import InputError
from modelling.measurement.readers.table import Table


def is_foreign(_: Path) -> bool:
    """A damaged file may crash SciPy's reader of version 5 as well as the HDF5 library of version 7.3."""
    return True


def _is_version_7_3(path: Path) -> bool:
    with path.open("rb") as file:
        header = file.read(128)
    return header.startswith(b"MATLAB") and header[124:126] in (b"\x00\x02", b"\x02\x00")


def read(path: Path, used: Collection[str] | None = None) -> Table:
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
    names = sorted(columns, key=lambda name: name != "time")
    values = np.stack([columns[name] for name in names], axis=1) if names else np.empty((0, 0))
    others = tuple(name for name in (*others, *variables) if name not in names and name != "units")
    return Table(names, [units.get(name, "") for name in names], values, others=others)


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
