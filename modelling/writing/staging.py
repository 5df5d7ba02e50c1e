"""Files that come into a folder together: written beside their places, then all moved there.

While they are written the hidden folder ``.writing-…`` holds them. When all are on the disk it is renamed to
``unfinished-…``, the files are moved, and it is removed. A kill leaves one of the two: what was not whole is removed by
the next run that writes there, what was whole is moved to its places. Until then ``unfinished-…`` marks the folder.
Pictures and pages that belonged to the results that are replaced are removed, see :mod:`modelling.writing.outdated`.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from errno import EISDIR, ENOTDIR
from pathlib import Path

from modelling.writing.outdated import outdated

try:
    import fcntl
except ImportError:  # Windows, where a folder cannot be locked
    fcntl = None  # type: ignore[assignment]

WRITING, UNFINISHED = ".writing-", "unfinished-"
EMPTY_SECONDS = 60.0  # for which an empty folder may be one that another process has just made


@contextmanager
def staging(directory: Path) -> Iterator[Path]:
    """A hidden folder in ``directory`` to write to, which is removed at the end; those of dead runs are, too."""
    recover(directory)
    folder = Path(tempfile.mkdtemp(prefix=WRITING, dir=directory))
    try:
        with contextlib.ExitStack() as stack:
            with contextlib.suppress(OSError):  # without locks nobody takes it for one that a dead run left, either
                stack.enter_context(_held(folder))
            yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def write(folder: Path, files: Mapping[str, str | bytes]) -> None:
    """Write files and force them to the disk."""
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("wb") as file:
            # a page may show the name of a file that is no UTF-8
            file.write(content.encode("utf-8", "replace") if isinstance(content, str) else content)
            file.flush()
            os.fsync(file.fileno())


def check_places(directory: Path, files: Mapping[str, str | bytes]) -> None:
    """Make the folders that files go to.

    Raises
    ------
    OSError
        If that cannot be, a file's place is taken by a folder, or a link inside ``directory`` leads out of it.
    """
    for name in files:
        if link := _link_above(directory, Path(name)):
            raise NotADirectoryError(ENOTDIR, "is a link, which may lead out of the folder that is written to", link)
        if (directory / name).is_dir():
            raise IsADirectoryError(EISDIR, "is a directory", str(directory / name))
        (directory / name).parent.mkdir(parents=True, exist_ok=True)


def move(folder: Path, directory: Path) -> None:
    """Move all files to their places; a kill in the middle leaves the rest in a folder that says so by its name."""
    marked = folder.with_name(UNFINISHED + folder.name.removeprefix(WRITING))
    folder.rename(marked)
    _sync(directory)
    _finish(marked, directory)


def unfinished(directory: Path) -> bool:
    """Whether a run was killed while it moved results into a folder, which now holds old and new ones."""
    return any(directory.glob(f"{UNFINISHED}*/"))


def recover(directory: Path) -> None:
    """Finish or remove what runs left that were killed; what belongs to a run that goes on is left alone."""
    for folder in [*directory.glob(f"{WRITING}*/"), *directory.glob(f"{UNFINISHED}*/")]:
        if folder.is_symlink():  # no run makes one: what it leads to is somebody's own
            continue
        with contextlib.suppress(OSError), _held(folder, wait=False):
            if folder.name.startswith(UNFINISHED):
                _finish(folder, directory)
            elif any(folder.iterdir()) or time.time() - folder.stat().st_mtime > EMPTY_SECONDS:
                shutil.rmtree(folder)


def _finish(marked: Path, directory: Path) -> None:
    for path in list(outdated(directory, marked)):  # first: afterwards the old list is gone
        path.unlink(missing_ok=True)
    for path in sorted(marked.rglob("*")):
        if not path.is_dir() and not _link_above(directory, path.relative_to(marked)):
            (directory / path.relative_to(marked)).parent.mkdir(parents=True, exist_ok=True)
            path.replace(directory / path.relative_to(marked))
    shutil.rmtree(marked)
    _sync(directory)


def _link_above(directory: Path, name: Path) -> str:
    """The first link among the folders between ``directory`` and the file of a relative name, or an empty text."""
    folders = [directory / folder for folder in list(name.parents)[-2::-1]]
    return next((str(folder) for folder in folders if folder.is_symlink()), "")


@contextmanager
def _held(folder: Path, wait: bool = True) -> Iterator[None]:
    """Hold a folder against other processes until the end, also by a kill.

    Raises
    ------
    OSError
        If another process holds it and this one shall not wait, or the system knows no locks on folders.
    """
    if fcntl is None:
        raise OSError("no locks on folders")
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        yield
    finally:
        os.close(handle)


def _sync(directory: Path) -> None:
    """Force the names in a folder to the disk, where its file system can."""
    with contextlib.suppress(OSError):
        handle = os.open(directory, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
