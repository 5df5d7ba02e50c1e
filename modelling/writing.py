"""Results on disk: written whole, moved together, what is outdated removed."""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import shutil
import socket
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from errno import EADDRINUSE, EISDIR, ENOTDIR
from pathlib import Path, PurePosixPath
from typing import Any

from modelling import interruption
from modelling.errors import InputError

# --- Pictures and pages of an earlier run that a new one does not make again.
#
# A result file lists the files written with it (``files``). Where the new one no longer lists a picture or page that
# the
# old one did, it would stand beside results it does not belong to. Other kinds of files are never removed: a user may
# have gone on with a model that a run wrote.

REMOVED_KINDS = (".svg", ".png", ".html")
LARGEST_BYTES = 50_000_000  # of a result file that is read for its list


def outdated(directory: Path, new: Path) -> Iterator[Path]:
    """The pictures and pages in ``directory`` that its result files list and those in the folder ``new`` do not."""
    for result in sorted(new.glob("*.json")):
        for name in sorted(_listed(directory / result.name) - _listed(result)):
            path = directory / name
            if not path.is_symlink() and path.is_file() and path.resolve().is_relative_to(directory.resolve()):
                yield path


def _listed(result: Path) -> set[str]:
    """Names of pictures and pages that a result file lists; none where it is no such file."""
    try:
        if not result.is_file() or result.stat().st_size > LARGEST_BYTES:
            return set()
        content = json.loads(result.read_bytes())
    except (OSError, ValueError, RecursionError):
        return set()
    names = content.get("files") if isinstance(content, dict) else None
    return {
        name
        for name in (names if isinstance(names, list) else [])
        if isinstance(name, str) and name.endswith(REMOVED_KINDS) and _stays_inside(name)
    }


def _stays_inside(name: str) -> bool:
    path = PurePosixPath(name)
    return "\0" not in name and not path.is_absolute() and ".." not in path.parts


# --- Files that come into a folder together: written beside their places, then all moved there.
#
# While they are written the hidden folder ``.writing-…`` holds them. When all are on the disk it is renamed to
# ``unfinished-…``, the files are moved, and it is removed. A kill leaves one of the two: what was not whole is
# removed by
# the next run that writes there, what was whole is moved to its places. Until then ``unfinished-…`` marks the folder.
# Pictures and pages that belonged to the results that are replaced are removed, see :mod:`modelling.writing`.

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


# --- Results as strict JSON, and files that are written whole or not at all.


def strict_json(value: Any) -> str:
    """JSON text of a result object; NumPy scalars and arrays become numbers and lists.

    Raises
    ------
    FloatingPointError
        A number is not finite; the message names where it sits, e.g. ``modes[2].frequency``.
    TypeError
        A value has no counterpart in JSON.
    """
    plain = _plain(value, "")
    text = json.dumps(plain, allow_nan=False, ensure_ascii=False, indent=2) + "\n"
    # half of a pair, as in the name of a file that is no UTF-8: JSON's own escape, for UTF-8 has none
    return text.encode("utf-8", "backslashreplace").decode()


def write_all(directory: str | Path, files: Mapping[str, str | bytes]) -> None:
    """Write all files into a directory, made if need be; none is left half written, and none if one cannot be.

    Names are relative and may hold folders, as ``figures/modes.svg``. Everything is first written in a hidden folder
    inside the directory, then all files are moved to their places, see :mod:`modelling.writing`.

    Raises
    ------
    InputError
        The directory cannot be made or written to, or a file's place is taken by a folder or a file that is read.
    ValueError
        A name would lead out of the directory.
    """
    directory = Path(directory)
    for name in files:
        if not name or PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts:
            raise ValueError(f"{name!r} does not stay inside the output directory")
    interruption.raise_if_asked()
    interruption.check_protected(directory, files)
    folders = {folder for name in files for folder in (directory / name).parents if not folder.exists()}
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with staging(directory) as folder:
            write(folder, files)
            check_places(directory, files)
            with interruption.put_off():
                move(folder, directory)
    except BaseException as error:
        _remove_if_empty(sorted(folders, reverse=True))
        if isinstance(error, FileExistsError | NotADirectoryError | IsADirectoryError | PermissionError):
            wrong = f"cannot be written: {(error.strerror or str(error)).lower()}"
            where = str(error.filename or directory)
            if WRITING in where:  # a name of our own, which says nothing to the user
                where = str(directory)
            raise InputError(where, wrong, "give a directory that can be written to") from error
        if isinstance(error, OSError) and error.filename is None:  # of a write
            error.filename = str(directory)
        raise


def write_results(
    directory: str | Path, name: str, result: Mapping[str, Any], files: Mapping[str, str | bytes]
) -> dict[str, Any]:
    """Write a result file and others as :func:`write_all` does; returns the result with all their names as ``files``.

    Pictures and pages listed by the result file of that name that was there before, and not written again, are removed.

    Raises
    ------
    InputError, FloatingPointError, TypeError, ValueError
        As :func:`write_all` and :func:`strict_json`.
    """
    listed = {**result, "files": sorted(set(files) | {name})}
    write_all(directory, {name: strict_json(listed), **files})
    return listed


def _remove_if_empty(folders: list[Path]) -> None:
    for folder in folders:
        try:
            folder.rmdir()
        except OSError:
            return


def _plain(value: Any, where: str) -> Any:
    """The value in Python's built-in types, every number finite; ``where`` is its path in the result."""
    if hasattr(value, "tolist"):  # NumPy scalars and arrays, without importing NumPy
        value = value.tolist()
    if isinstance(value, Mapping):
        return {_key(key, where): _plain(each, f"{where}.{key}" if where else str(key)) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each, f"{where}[{number}]") for number, each in enumerate(value)]
    if isinstance(value, float) and not math.isfinite(value):
        raise FloatingPointError(f"{where or 'the result'} is {value}, not a finite number")
    if value is None or isinstance(value, str | bool | int | float):
        return value
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    raise TypeError(f"{where or 'the result'} is a {type(value).__name__}, which JSON cannot hold")


def _key(key: Any, where: str) -> str:
    if not isinstance(key, str):
        raise TypeError(f"{where or 'the result'} has the key {key!r}, but keys are text")
    return key


def file_stem(name: str) -> str:
    """A name of a user's as part of a file's name: letters, digits, ``_`` and ``-`` stay, 60 characters at the most."""
    return "".join(letter if letter.isalnum() or letter in "_-" else "_" for letter in name)[:60]


# --- One run of a command a folder at a time: a second one ends with an error and mixes nothing with the first.


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
