"""Recordings that are still being written, for a person who stands at the bed."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from modelling.common.errors import InputError

POLL_SECONDS = 0.25  # between two looks at the files
TEXT = (".csv", ".txt", ".tsv", ".dat")  # kinds whose last line may be half written


def appeared(path: Path) -> None:
    """Wait until there is such a file."""
    while not path.is_file():
        time.sleep(POLL_SECONDS)


def snapshots(recordings: Sequence[Path], still: float, folder: Path) -> Iterator[tuple[Path, ...]]:
    """Copies of recordings now, and again each time that one has grown, until none has for ``still`` seconds.

    A copy in ``folder`` keeps its file's name. Of text, whole lines are copied.

    Raises
    ------
    InputError
        If there is no such file.
    """
    for path in recordings:
        if not path.is_file():
            raise InputError(str(path), "is no file", "give recordings that have been begun")
    changed = time.monotonic()
    copied: list[tuple[int, int]] = []
    while True:
        present = [(path.stat().st_size, path.stat().st_mtime_ns) for path in recordings]
        if present != copied:
            copied, changed = present, time.monotonic()
            yield tuple(_copy(path, folder / str(number)) for number, path in enumerate(recordings))
        elif time.monotonic() - changed >= still:
            return
        else:
            time.sleep(POLL_SECONDS)


def _copy(path: Path, folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    copy = folder / path.name
    shutil.copyfile(path, copy)
    if path.suffix.lower() in TEXT:
        content = copy.read_bytes()
        copy.write_bytes(content[: content.rfind(b"\n") + 1])
    return copy
