"""Readers of measurement files, one for each format: each turns a file into a :class:`Table`, in the file's units.

A reader is told which channels are used, by their names in the file. It need not read others, but names them. A further
format is one module here and one line in ``READERS``. A module's ``is_foreign(path)`` says whether a library in C reads
the file: then it is read in a process of its own, which may crash alone.
"""

from __future__ import annotations

import importlib
from collections.abc import Collection, Mapping
from pathlib import Path

from modelling.common.errors import InputError
from modelling.measurement.readers import apart
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
GROUPED = ("mdf",)


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
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in READERS:
        raise InputError(str(path), f"{suffix or 'no suffix'!r} is no known format", f"read are {', '.join(READERS)}")
    options = {"groups": dict(groups)} if groups else {}
    if groups and READERS[suffix] not in GROUPED:
        raise InputError(str(path), f"{suffix} files have no groups", "drop group in the channel file")
    module = f"{__name__}.{READERS[suffix]}"
    try:
        reader = importlib.import_module(module)
        table: Table = (
            apart.read(module, path, used, options) if reader.is_foreign(path) else reader.read(path, used, **options)
        )
    except FileNotFoundError:
        raise InputError(str(path), "does not exist", "name an existing file") from None
    except OSError as error:
        raise InputError(str(path), error.strerror or "cannot be read", "name a readable file") from None
    except ModuleNotFoundError as error:
        right = 'in rigmatch\'s folder: pip install -e ".[measurement]", or save as CSV'
        raise InputError(str(path), f"reading {suffix} needs the package {error.name}", right) from None
    return table
