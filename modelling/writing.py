"""Results on disk: files whole or not at all, strict JSON, no input file replaced."""

from __future__ import annotations

import contextlib
import json
import math
import os
import shutil
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any

from modelling.errors import InputError

WRITING = ".writing-"  # prefix of the hidden folder that files are written to before they are moved
PICTURES_AND_PAGES = (".svg", ".png", ".html")
LARGEST_BYTES = 50_000_000  # of a result file that is read for its list
LARGEST_RESULT = 1e100  # in SI; what is beyond comes from a division by something that rounding left of 0


def write_all(directory: str | Path | None, files: Mapping[str, str | bytes]) -> list[str]:
    """Write files into a directory, made if need be; each is there whole or not at all, and none if one cannot be.

    Returns their names, sorted; without a directory nothing is written.

    Names are relative and may hold folders, as ``figures/modes.svg``. All files are first written to a hidden folder
    inside the directory, then moved. Pictures and pages that an earlier result file of the same name lists (``files``)
    and the new one does not are removed: they belong to other results.

    Raises
    ------
    InputError
        The directory cannot be made or written to, or a file's place is taken by a folder, a link out of the
        directory or a file that the running command reads.
    ValueError
        A name would lead out of the directory.
    """
    if directory is None:
        return []
    directory = Path(directory)
    for name in files:
        if not _stays_inside(name):
            raise ValueError(f"{name!r} does not stay inside the output directory")
    check_inputs_kept(directory, files)
    made = sorted({place for name in files for place in (directory / name).parents if not place.exists()}, reverse=True)
    try:
        directory.mkdir(parents=True, exist_ok=True)
        _remove_left(directory)
        prefix = f"{WRITING}{os.getpid()}-"
        with tempfile.TemporaryDirectory(prefix=prefix, dir=directory, ignore_cleanup_errors=True) as folder:
            for name, content in files.items():
                path = Path(folder, name)
                path.parent.mkdir(parents=True, exist_ok=True)
                with path.open("wb") as file:
                    # a page may show the name of a file that is no UTF-8
                    file.write(content.encode("utf-8", "replace") if isinstance(content, str) else content)
                    file.flush()
                    os.fsync(file.fileno())
                _make_place(directory, name)
            for path in _outdated(directory, Path(folder)):
                path.unlink(missing_ok=True)
            for name in files:
                Path(folder, name).replace(directory / name)
    except BaseException as error:
        for place in made:
            with contextlib.suppress(OSError):  # not empty
                place.rmdir()
        if isinstance(error, FileExistsError | NotADirectoryError | IsADirectoryError | PermissionError):
            wrong = f"cannot be written: {(error.strerror or str(error)).lower()}"
            where = str(error.filename or directory)
            where = str(directory) if WRITING in where else where  # a name of ours says nothing to the user
            raise InputError(where, wrong, "give a directory that can be written to") from error
        if isinstance(error, OSError) and error.filename is None:  # of a write
            error.filename = str(directory)
        raise
    return sorted(files)


def _remove_left(directory: Path) -> None:
    """Remove the hidden folders of runs that were killed."""
    for left in directory.glob(f"{WRITING}*-*/"):
        number = left.name.removeprefix(WRITING).partition("-")[0]
        if number.isdecimal() and not left.is_symlink() and not _runs(int(number)):
            shutil.rmtree(left, ignore_errors=True)


def _runs(process: int) -> bool:
    if sys.platform == "win32":  # there, to ask a process ends it
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:  # somebody else's
        pass
    return True


def _make_place(directory: Path, name: str) -> None:
    """Make the folders that a file goes to.

    Raises
    ------
    OSError
        If the file's place is a folder, or a link inside ``directory`` leads out of it.
    """
    place = directory / name
    for folder in list(Path(name).parents)[-2::-1]:
        if (directory / folder).is_symlink():
            raise NotADirectoryError(0, "is a link, which may lead out of the folder", str(directory / folder))
    if place.is_dir():
        raise IsADirectoryError(0, "is a directory", str(place))
    place.parent.mkdir(parents=True, exist_ok=True)


def _stays_inside(name: str) -> bool:
    path = PurePosixPath(name)
    return bool(name) and "\0" not in name and not path.is_absolute() and ".." not in path.parts


def _outdated(directory: Path, new: Path) -> Iterator[Path]:
    """Pictures and pages in ``directory`` that its result files list and those in the folder ``new`` do not."""
    for result in sorted(new.glob("*.json")):
        for name in sorted(_listed(directory / result.name) - _listed(result)):
            path = directory / name
            if not path.is_symlink() and path.is_file() and path.resolve().is_relative_to(directory.resolve()):
                yield path


def _listed(result: Path) -> set[str]:
    """Names of pictures and pages that a result file lists; none if it is no such file."""
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
        if isinstance(name, str) and name.endswith(PICTURES_AND_PAGES) and _stays_inside(name)
    }


def check_writable(directory: str | Path) -> None:
    """Before the work: the directory can be written to or made.

    Raises
    ------
    InputError
        If not.
    """
    directory = Path(directory)
    place = next((place for place in (directory, *directory.absolute().parents) if os.path.lexists(place)), directory)
    if place.is_dir() and not os.access(place, os.W_OK | os.X_OK):
        raise InputError(str(directory), "cannot be written to by this user", "give a directory that can be written to")


# --- Inputs of a running command, which its results must not replace

_inputs: set[tuple[int, int]] | None = None  # device and inode; None: no command asked for it


@contextlib.contextmanager
def inputs_kept(files: Iterable[str]) -> Iterator[None]:
    """Until the end of the block results replace none of these files, nor any that :func:`note_input` names."""
    global _inputs
    _inputs = set()
    try:
        for file in files:
            note_input(file)
        yield
    finally:
        _inputs = None


def note_input(file: str | os.PathLike[str]) -> None:
    """Name a file, and the link that it may be, as an input of the running command."""
    if _inputs is None:
        return
    for status in (os.stat, os.lstat):
        with contextlib.suppress(OSError, ValueError):
            at = status(file)
            _inputs.add((at.st_dev, at.st_ino))


def check_inputs_kept(directory: str | os.PathLike[str], names: Iterable[str]) -> None:
    """Refuse to replace an input of the running command.

    Raises
    ------
    InputError
        Naming the first file that would be replaced.
    """
    for name in names if _inputs else ():
        place = Path(directory) / name
        try:
            at = os.lstat(place)
        except (OSError, ValueError):
            continue
        if (at.st_dev, at.st_ino) in (_inputs or ()):
            raise InputError(str(place), "is read by this command and would be replaced", "name another --out")


# --- Results as strict JSON


def strict_json(value: Any) -> str:
    """JSON text of a result object; NumPy scalars and arrays become numbers and lists.

    Raises
    ------
    FloatingPointError
        A number is not finite or beyond 1e100; the message names where it sits, e.g. ``modes[2].frequency``.
    TypeError
        A value has no counterpart in JSON.
    """
    plain = _plain(value, "")
    text = json.dumps(plain, allow_nan=False, ensure_ascii=False, indent=2) + "\n"
    # half of a pair, as in the name of a file that is no UTF-8: JSON's own escape, for UTF-8 has none
    return text.encode("utf-8", "backslashreplace").decode()


def write_results(
    directory: str | Path | None, name: str, result: Mapping[str, Any], files: Mapping[str, str | bytes]
) -> dict[str, Any]:
    """Write a result file and others as :func:`write_all` does; returns the result with the names written as ``files``.

    Pictures and pages listed by the result file of that name that was there before, and not written again, are removed.

    Raises
    ------
    InputError, FloatingPointError, TypeError, ValueError
        As :func:`write_all` and :func:`strict_json`.
    """
    listed = {**result, "files": sorted(set(files) | {name}) if directory else []}
    write_all(directory, {name: strict_json(listed), **files})
    return listed


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
    if isinstance(value, int | float) and abs(value) > LARGEST_RESULT:
        raise FloatingPointError(f"{where or 'the result'} is {float(value):.3g}, no result of a drivetrain")
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
