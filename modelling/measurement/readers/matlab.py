"""MATLAB .mat files: one vector a channel, or one struct of them; version 7.3, which is HDF5, by h5py."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat

from modelling.common.errors import InputError
from modelling.measurement.readers.table import Table


def read(path: Path, used: Collection[str] | None = None) -> Table:
    """Read a .mat file with a vector ``time`` and one a channel, of one length.

    Names in MATLAB hold no brackets, so values are in SI, unless a struct ``units`` gives a text by channel.

    Raises
    ------
    InputError
        If it is no such file, a used channel has another length than time, or h5py is missing for version 7.3.
    """
    try:
        found = {name: value for name, value in loadmat(path, simplify_cells=True).items() if not name.startswith("__")}
    except NotImplementedError:
        found = _version_7_3(path)
    except OSError:
        raise
    except Exception as fault:  # scipy raises many kinds for what is not a .mat file
        raise InputError(str(path), f"is no .mat file: {fault}", "save it with MATLAB's save -v7") from None
    known = set(used or ()) | {"time"}
    structs = [
        value for name, value in found.items() if isinstance(value, dict) and name != "units" and known & {*value}
    ]
    if not known & {*found} and len(structs) == 1:
        found = structs[0]
    given = found.get("units")
    units = (
        {name: unit for name, unit in given.items() if isinstance(unit, str) and unit}
        if isinstance(given, dict)
        else {}
    )
    sizes = [np.size(found[name]) for name in known & {*found}]
    length = np.size(found["time"]) if "time" in found else max(sizes, key=sizes.count, default=0)
    for name in sorted(known & {*found}):
        if np.size(found[name]) != length:
            raise InputError(
                f"{path}: {name!r}",
                f"has {np.size(found[name])} values, time {length}",
                "save channels of one length, or leave it out",
            )
    columns = {
        name: np.asarray(value, dtype=float).ravel()
        for name, value in found.items()
        if isinstance(value, np.ndarray)
        and np.size(value) == length
        and np.issubdtype(value.dtype, np.number)
        and value.dtype.kind != "c"
    }
    if "time" in found and "time" not in columns:
        raise InputError(str(path), "'time' holds no real numbers", "save it as a vector of seconds")
    names = sorted(columns, key=lambda name: name != "time")
    values = np.stack([columns[name] for name in names], axis=1) if names else np.empty((0, 0))
    return Table(names, [units.get(name, "") for name in names], values)


def _version_7_3(path: Path) -> dict[str, Any]:
    try:
        import h5py
    except ImportError:
        right = "in rigmatch's folder: pip install -e '.[measurement]', or save it with -v7"
        raise InputError(str(path), "is a .mat file of version 7.3, which needs h5py", right) from None
    with h5py.File(path) as file:
        return _members(file)


def _members(group: Any) -> dict[str, Any]:
    """Numbers, texts and structs of a group, as ``loadmat`` would give them; other classes are left out."""
    import h5py

    found: dict[str, Any] = {}
    for name, own in group.items():
        kind = own.attrs.get("MATLAB_class", b"")
        kind = kind.decode() if isinstance(kind, bytes) else str(kind)
        if isinstance(own, h5py.Group):
            if not name.startswith("#"):
                found[name] = _members(own)
        elif kind == "char":
            found[name] = "" if "MATLAB_empty" in own.attrs else own[()].tobytes().decode("utf-16-le")
        elif own.dtype.kind in "fiu" and "MATLAB_empty" not in own.attrs:
            found[name] = np.asarray(own)
    return found
