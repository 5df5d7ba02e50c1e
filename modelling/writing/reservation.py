"""One run of a command a folder at a time: a second one ends with an error and mixes nothing with the first."""

from __future__ import annotations

import hashlib
import os
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from errno import EADDRINUSE
from pathlib import Path

from modelling.common.errors import InputError


@contextmanager
def reserved(directory: str | Path, command: str) -> Iterator[None]:
    """Keep a folder for a command until the end of the block, or of the process.

    The folder need not exist, and nothing is written: a socket of Linux's abstract kind carries its name.

    Raises
    ------
    InputError
        If another process runs the same command into the same folder, or the user may not write there.
    """
    _check_access(Path(directory))
    if sys.platform != "linux":
        yield
        return
    name = hashlib.sha256(f"{Path(directory).resolve()}\0{command}".encode("utf-8", "surrogateescape")).hexdigest()
    with socket.socket(socket.AF_UNIX) as mark:
        try:
            mark.bind(f"\0rigmatch-{name}")
        except OSError as fault:
            if fault.errno == EADDRINUSE:
                wrong = f"another 'rigmatch {command}' is running that writes there"
                raise InputError(str(directory), wrong, "wait until it ends, or name another --out") from None
        yield


def _check_access(directory: Path) -> None:
    """Raise ``InputError`` before the work for a folder that can neither be written to nor made."""
    place = next((place for place in (directory, *directory.absolute().parents) if os.path.lexists(place)), directory)
    if place.is_dir() and not os.access(place, os.W_OK | os.X_OK):
        raise InputError(str(directory), "cannot be written to by this user", "give a directory that can be written to")
