"""What a command reads is not replaced by what it writes, where both lie in one folder."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from modelling.common.errors import InputError

_inputs: set[tuple[int, int]] | None = None  # device and number of the files of a running command; None: not asked for


@contextlib.contextmanager
def protected(files: Iterable[str]) -> Iterator[None]:
    """Until the end of the block results replace none of these files, nor any that is read in it by :func:`note`."""
    global _inputs
    _inputs = set()
    try:
        for file in files:
            note(file)
        yield
    finally:
        _inputs = None


def note(file: str | os.PathLike[str]) -> None:
    """Protect a file, and the link that it may be, where the running command asked for it."""
    if _inputs is None:
        return
    for status in (os.stat, os.lstat):
        with contextlib.suppress(OSError, ValueError):
            at = status(file)
            _inputs.add((at.st_dev, at.st_ino))


def check(directory: str | os.PathLike[str], names: Iterable[str]) -> None:
    """Refuse files of these names in a folder if one of them is an input of this command.

    Raises
    ------
    InputError
        Naming the first that is.
    """
    for name in names if _inputs else ():
        place = Path(directory) / name
        try:
            at = os.lstat(place)
        except (OSError, ValueError):
            continue
        if (at.st_dev, at.st_ino) in (_inputs or ()):
            raise InputError(str(place), "is read by this command and would be replaced", "name another --out")
