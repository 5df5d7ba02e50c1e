"""MATLAB .mat files up to version 7: one vector a channel, or one struct of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from modelling.errors import InputError
from modelling.readers import Table


def read(path: Path) -> Table:
    """Read a .mat file with a vector ``time`` and one a channel, of one length.

    Names in MATLAB hold no brackets, so values are in SI, unless a struct ``units`` gives a text by channel.

    Raises
    ------
    InputError
        If it is no such file or has no ``time``.
    """
    from scipy.io import loadmat

    try:
        found = {name: value for name, value in loadmat(path, simplify_cells=True).items() if not name.startswith("__")}
    except NotImplementedError:
        raise InputError(str(path), "is a .mat file of version 7.3", "save it with -v7") from None
    except OSError:
        raise
    except Exception as fault:  # scipy raises many kinds for what is not a .mat file
        raise InputError(str(path), f"is no .mat file: {fault}", "save it with MATLAB's save -v7") from None
    structs = [
        value for name, value in found.items() if isinstance(value, dict) and name != "units" and "time" in value
    ]
    if "time" not in found and len(structs) == 1:
        found = structs[0]
    units: dict = given if isinstance(given := found.get("units"), dict) else {}
    if "time" not in found:
        raise InputError(str(path), "has no vector 'time'", "save time and channels as vectors of one length")
    length = np.size(found["time"])
    columns = {
        name: np.asarray(value, dtype=float).ravel()
        for name, value in found.items()
        if isinstance(value, np.ndarray)
        and np.size(value) == length
        and np.issubdtype(value.dtype, np.number)
        and value.dtype.kind != "c"
    }
    if "time" not in columns:
        raise InputError(str(path), "'time' holds no real numbers", "save it as a vector of seconds")
    header = [
        f"{name} [{units[name]}]" if name in units else name
        for name in sorted(columns, key=lambda name: name != "time")
    ]
    values = np.stack([columns[name.split(" [")[0]] for name in header], axis=1)
    return Table(header, values)
