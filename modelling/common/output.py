"""Results as strict JSON, and files that are written whole or not at all."""

import json
import math
import os
import shutil
import tempfile
from collections.abc import Mapping
from errno import EISDIR
from pathlib import Path, PurePosixPath
from typing import Any

from modelling.common.errors import InputError


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
    return json.dumps(plain, allow_nan=False, ensure_ascii=False, indent=2) + "\n"


def write_all(directory: str | Path, files: Mapping[str, str | bytes]) -> None:
    """Write all files into a directory, made if need be; none is left half written, and none if one cannot be.

    Names are relative and may hold folders, as ``figures/modes.svg``. Everything is first written in a hidden folder
    inside the directory, then each file is moved to its place, which the operating system does in one step.

    Raises
    ------
    InputError
        The directory cannot be made or written to, or a file's place is taken by a folder.
    ValueError
        A name would lead out of the directory.
    """
    directory = Path(directory)
    for name in files:
        if not name or PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts:
            raise ValueError(f"{name!r} does not stay inside the output directory")
    new_folders = [folder for folder in (directory, *directory.parents) if not folder.exists()]
    try:
        directory.mkdir(parents=True, exist_ok=True)
        staging = Path(tempfile.mkdtemp(prefix=".writing-", dir=directory))
        try:
            _stage(staging, files)
            _move(staging, directory, files)
        finally:
            shutil.rmtree(staging, ignore_errors=True)
    except BaseException as error:
        _remove_if_empty(new_folders)
        if isinstance(error, FileExistsError | NotADirectoryError | IsADirectoryError | PermissionError):
            wrong = f"cannot be written: {(error.strerror or str(error)).lower()}"
            raise InputError(
                str(error.filename or directory), wrong, "give a directory that can be written to"
            ) from error
        raise


def _stage(staging: Path, files: Mapping[str, str | bytes]) -> None:
    for name, content in files.items():
        path = staging / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
            file.flush()
            os.fsync(file.fileno())


def _move(staging: Path, directory: Path, files: Mapping[str, str | bytes]) -> None:
    for name in files:  # every target is checked before the first file is moved
        if (directory / name).is_dir():
            raise IsADirectoryError(EISDIR, "is a directory", str(directory / name))
        (directory / name).parent.mkdir(parents=True, exist_ok=True)
    for name in files:
        (staging / name).replace(directory / name)


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
