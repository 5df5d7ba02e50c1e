"""Files that the finished parts of a study are appended to, a line each with its checksum."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from modelling.common.errors import InputError

CHECKSUM = "sha256"  # key of a line's last entry: checksum of the line without it


def append(record: Path, row: dict[str, Any]) -> None:
    """Append a row of plain values and force it to the disk.

    Raises
    ------
    InputError
        If a pipe, a folder or a link stands in its place.
    """
    record.parent.mkdir(parents=True, exist_ok=True)
    _check_place(record)
    with record.open("a", encoding="utf-8") as file:
        file.write(json.dumps(row | {CHECKSUM: _checksum(row)}, allow_nan=False) + "\n")
        file.flush()
        os.fsync(file.fileno())


def rows(record: Path, kinds: Mapping[str, type]) -> list[dict[str, Any]]:
    """The rows of a record; a line that is damaged, or that a kill left half written, counts as not written.

    ``kinds`` are what every row holds by key; a row of another build is none of this record's. Raises as
    :func:`append` does.
    """
    whole = []
    for line in whole_lines(record):
        try:
            row = json.loads(line)
            as_built = all(isinstance(row[key], kind) for key, kind in kinds.items())
            if row.pop(CHECKSUM) == _checksum(row) and as_built:
                whole.append(row)
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            continue
    return whole


def whole_lines(record: Path) -> list[str]:
    """Lines of a file that rows are appended to; one that a kill left half written is cut off, in the file too.

    Raises as :func:`append` does.
    """
    _check_place(record)
    if not record.exists():
        return []
    text = record.read_bytes()
    whole = text[: text.rfind(b"\n") + 1]
    if len(whole) < len(text):
        with record.open("r+b") as file:
            file.truncate(len(whole))
    return whole.decode("utf-8", "replace").split("\n")[:-1]


def _check_place(record: Path) -> None:
    """Raise ``InputError`` for a pipe, a folder, or a link, which would be written to wherever it leads."""
    if record.is_symlink() or (record.exists() and not record.is_file()):
        raise InputError(str(record), "is no file of ours", "remove it, or name another --out")


def _checksum(row: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(row).encode()).hexdigest()[:32]
