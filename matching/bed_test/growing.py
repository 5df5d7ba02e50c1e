"""Recordings that are still being written, for a person who stands at the bed."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from modelling.common.errors import InputError
from modelling.measurement.readers import READERS

POLL_SECONDS = 0.25  # between two looks at the files
TEXT = tuple(suffix for suffix, reader in READERS.items() if reader == "comma_separated")  # written line by line


def appeared(places: Sequence[Path]) -> None:
    """Wait until there is a file at one of the places."""
    while not any(place.is_file() for place in places):
        time.sleep(POLL_SECONDS)


def snapshots(recordings: Sequence[Path], still: float, folder: Path) -> Iterator[tuple[Path, ...]]:
    """Copies of recordings now, and again each time that one has changed, until none has for ``still`` seconds.

    A copy in ``folder`` keeps its file's name. Of text, whole lines are copied. A file that is not there for a moment,
    as where a logger begins a new one, is waited for as long.

    Raises
    ------
    InputError
        If there is no such file, or it does not come back.
    """
    for path in recordings:
        if not path.is_file():
            raise InputError(str(path), "is no file", "give recordings that have been begun")
    changed = time.monotonic()
    copied: list[tuple[int, int, int] | None] = []
    while True:
        states = [_state(path) for path in recordings]
        changes = None not in states and states != copied
        copies = _copies(recordings, folder) if changes else ()
        if copies:
            copied, changed = states, time.monotonic()
            yield copies
        elif time.monotonic() - changed >= still:
            break
        else:
            time.sleep(POLL_SECONDS)
    if None in states:
        raise InputError(str(recordings[states.index(None)]), "is not there any more", "leave it where it is")


def _state(path: Path) -> tuple[int, int, int] | None:
    """What changes where a file is written to, or another takes its place; None: there is none."""
    try:
        about = path.stat()
    except FileNotFoundError:
        return None
    return about.st_ino, about.st_size, about.st_mtime_ns


def _copies(recordings: Sequence[Path], folder: Path) -> tuple[Path, ...]:
    """One of each recording; none at all where one of them is gone by now."""
    try:
        return tuple(_copy(path, folder / str(number)) for number, path in enumerate(recordings))
    except FileNotFoundError:
        return ()


def _copy(path: Path, folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    copy = folder / path.name
    shutil.copyfile(path, copy)
    if path.suffix.lower() in TEXT:
        content = copy.read_bytes()
        copy.write_bytes(content[: content.rfind(b"\n") + 1])
    return copy
