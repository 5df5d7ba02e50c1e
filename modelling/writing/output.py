"""Results as strict JSON, and files that are written whole or not at all."""

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import Any

from modelling.common import interruption, protection
from modelling.common.errors import InputError
from modelling.writing import staging


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
    inside the directory, then all files are moved to their places, see :mod:`modelling.writing.staging`.

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
    protection.check(directory, files)
    folders = {folder for name in files for folder in (directory / name).parents if not folder.exists()}
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with staging.staging(directory) as folder:
            staging.write(folder, files)
            staging.check_places(directory, files)
            with interruption.put_off():
                staging.move(folder, directory)
    except BaseException as error:
        _remove_if_empty(sorted(folders, reverse=True))
        if isinstance(error, FileExistsError | NotADirectoryError | IsADirectoryError | PermissionError):
            wrong = f"cannot be written: {(error.strerror or str(error)).lower()}"
            where = str(error.filename or directory)
            if staging.WRITING in where:  # a name of our own, which says nothing to the user
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
