"""Readers of recordings, one a format. A reader turns a file into a :class:`Table`; all else happens once, behind it.

A reader is told which channels are used, by their names in the file: what has several sampling rates or very many
channels leaves out the others and only names them.

A further format is one module here and one line in ``READERS``.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from modelling.common.errors import InputError

READERS = {
    ".csv": "comma_separated",
    ".txt": "comma_separated",
    ".mat": "matlab",
    ".parquet": "parquet",
    ".mf4": "mdf",
    ".mdf": "mdf",
    ".dat": "mdf",
}
TIMES = {"t", "time", "zeit", "times", "timestamp", "timestamps", "time_s", "t_s"}


@dataclass(frozen=True)
class Table:
    """Columns as a file holds them: ``header`` of texts ``name [unit]``, ``values`` (t, columns), NaN where missing.

    ``place`` says where a row of values stands in the file, for error lines; ``notes`` what the reader had to do;
    ``others`` names channels that nobody asked for and that were not read.
    """

    header: list[str]
    values: np.ndarray = field(repr=False)
    place: Callable[[int], str] = field(default=lambda row: f"row {row + 1}", repr=False)
    notes: tuple[str, ...] = ()
    others: tuple[str, ...] = ()


def name_time(names: Collection[str]) -> str:
    """What to do where no column is called ``time``, with the one that may well be it."""
    likely = next((name for name in names if name.strip().lower() in TIMES), "NAME")
    return f'call it time, or write time = "{likely}" into a channel file (--channels)'


def read_table(path: str | Path, used: Collection[str] | None = None) -> Table:
    """Read a file by its suffix; at least the channels ``used`` (names in the file), or all.

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
        reader = importlib.import_module(f"{__name__}.{READERS[suffix]}")
        return reader.read(path, used)
    except FileNotFoundError:
        raise InputError(str(path), "does not exist", "name an existing file") from None
    except OSError as fault:
        raise InputError(str(path), fault.strerror or "cannot be read", "name a readable file") from None
    except ModuleNotFoundError as fault:
        right = "in rigmatch's folder: pip install -e '.[measurement]', or save as CSV"
        raise InputError(str(path), f"reading {suffix} needs the package {fault.name}", right) from None
