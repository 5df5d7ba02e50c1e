"""In which line of a TOML file a key stands, for error messages; a guide for the reader, not a parser."""

from __future__ import annotations

import re
from pathlib import Path

_HEADER = re.compile(r"\s*(\[\[?)\s*([\w.\s\"'-]+?)\s*\]\]?\s*(?:#.*)?$")
_KEY = re.compile(r"\s*([\w.\"' -]+?)\s*=")
LARGEST_SEARCHED = 5_000_000  # bytes


def line_of(where: str) -> int | None:
    """The line, from 1, of a place ``FILE: table.name.key``, or of the table that should hold it; None if not found.

    Parameters
    ----------
    where : str
        As in :class:`modelling.common.errors.InputError`; ``effects[2].gap`` is a key of the second table.
    """
    file, colon, place = where.partition(": ")
    path = Path(file)
    if not colon or path.suffix != ".toml" or not path.is_file() or path.stat().st_size > LARGEST_SEARCHED:
        return None
    wanted = place.split(" ")[0].rstrip(":").split(".")
    table: list[str] = []
    found, length, counted = None, 0, dict[str, int]()
    for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), 1):
        if header := _HEADER.match(line):
            table = _parts(header[2])
            if header[1] == "[[":
                counted[header[2]] = counted.get(header[2], 0) + 1
                table[-1] += f"[{counted[header[2]]}]"
            here = table
        elif key := _KEY.match(line):
            here = [*table, *_parts(key[1])]
        else:
            continue
        if here == wanted[: len(here)] and len(here) > length:
            found, length = number, len(here)
    return found


def _parts(key: str) -> list[str]:
    return [part.strip().strip("\"'") for part in key.split(".")]
