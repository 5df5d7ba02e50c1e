"""Readers of measurement files, one for each format: each turns a file into a :class:`Table`, in the file's units.

A reader is told which channels are used, by their names in the file. It need not read others, but names them. A further
format is one module here and one line in ``READERS``.
"""

from __future__ import annotations

import importlib
from collections.abc import Collection
from pathlib import Path

from modelling.common.errors import InputError
from modelling.measurement.readers.table import Table

READERS = {
    ".csv": "comma_separated",
    ".txt": "comma_separated",
    ".mat": "matlab",
    ".parquet": "parquet",
    ".mf4": "mdf",
    ".mdf": "mdf",
    ".dat": "mdf",
}


def read_table(path: str | Path, used: Collection[str] | None = None) -> Table:
    """Read a file by its suffix.

    Parameters
    ----------
    path : path
    used : collection of str, optional
        Channels to read, by their names in the file; by default all.

    Raises
    ------
    InputError
        If the format is not known or the file cannot be read.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in READERS:
        raise InputError(str(path), f"{suffix or 'no suffix'!r} is no known format", f"read are {', '.join(READERS)}")
    try:
        table: Table = importlib.import_module(f"{__name__}.{READERS[suffix]}").read(path, used)
    except FileNotFoundError:
        raise InputError(str(path), "does not exist", "name an existing file") from None
    except OSError as error:
        raise InputError(str(path), error.strerror or "cannot be read", "name a readable file") from None
    except ModuleNotFoundError as error:
        right = "in rigmatch's folder: pip install -e '.[measurement]', or save as CSV"
        raise InputError(str(path), f"reading {suffix} needs the package {error.name}", right) from None
    return table
