"""Reading TOML tables strictly: a misspelt key is an error, never a default."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from modelling.common.errors import InputError


def read_toml(path: Path | str) -> dict[str, Any]:
    """The file's tables; raises ``InputError`` where it is missing or no TOML."""
    try:
        return tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise InputError(str(path), "no such file", "give the path of a TOML file") from error
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(str(path), f"cannot be read: {error}", "give a readable UTF-8 TOML file") from error
    except tomllib.TOMLDecodeError as error:
        raise InputError(str(path), f"no valid TOML: {error}", "correct the line") from error


def check_keys(table: Any, known: Iterable[str], where: str) -> dict[str, Any]:
    """The table itself when it is one and has no key besides the known ones."""
    if not isinstance(table, dict):
        raise InputError(where, f"{table!r} is no table", f"write [{where.rsplit(': ', 1)[-1]}] and its keys")
    known = list(known)
    for key in table:
        if key not in known:
            raise InputError(where, f"unknown key '{key}'", f"known are {', '.join(known)}")
    return table


def number(table: dict[str, Any], key: str, where: str, *, positive: bool = False, least: float | None = None) -> float:
    """A finite number under a key."""
    if key not in table:
        raise InputError(where, f"'{key}' is missing", f"give {key} = a number")
    value = table[key]
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"{where}.{key}", f"{value!r} is no finite number", "give a finite number")
    if positive and value <= 0:
        raise InputError(f"{where}.{key}", f"{value!r} is not positive", "give a number above 0")
    if least is not None and value < least:
        raise InputError(f"{where}.{key}", f"{value!r} is too small", f"give at least {least:g}")
    return float(value)


def numbers(values: Any, where: str, least: int = 2) -> list[float]:
    """A list of at least so many finite numbers."""
    if not isinstance(values, list) or len(values) < least:
        raise InputError(where, "is no list of readings", f"give at least {least} numbers")
    for place, value in enumerate(values, start=1):
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise InputError(where, f"reading {place} is {value!r}", "every reading must be a finite number")
    return [float(value) for value in values]


def text(table: dict[str, Any], key: str, where: str, default: str | None = None) -> str:
    """A text under a key."""
    value = table.get(key, default)
    if value is None:
        raise InputError(where, f"'{key}' is missing", f'give {key} = "…"')
    if not isinstance(value, str):
        raise InputError(f"{where}.{key}", f"{value!r} is no text", "put it in quotes")
    return value


def one_of(value: str, choices: Iterable[str], where: str) -> str:
    """The value when it is one of the choices."""
    choices = list(choices)
    if value not in choices:
        raise InputError(where, f"'{value}' is not known", f"choose {' | '.join(choices)}")
    return value
