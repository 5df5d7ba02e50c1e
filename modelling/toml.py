"""TOML tables read strictly: a misspelt key is an error with its line, never a default."""

from __future__ import annotations

import json
import math
import os
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from modelling.errors import InputError, unknown
from modelling.escape import is_control
from modelling.writing import note_input

LONGEST_TITLE = 300  # characters
LARGEST_FILE = 5_000_000  # bytes; a chain of a thousand inertias takes a fiftieth of it
LONGEST_INTEGER = 1024  # bits, as the largest floating-point number has before its point


LONGEST_TEXT = 10_000  # characters of a title, name or formula
# A key of 50 parts; tomllib takes time with the square of their number. Possessive, so that the search is linear.
_DEEP_KEY = re.compile(r"""(?<![\w-])(?:(?:"[^"\n]*+"|'[^'\n]*+'|[\w-]++)[ \t]*+\.[ \t]*+){50}""")


def read_toml(path: str | Path) -> dict[str, Any]:
    """A TOML file as a dictionary.

    Raises
    ------
    InputError
        If it is missing, too large, not UTF-8 or not TOML; with the line.
    """
    try:
        with Path(path).open("rb") as file:  # what is no regular file has no size, so at most so much is read
            content = file.read(LARGEST_FILE + 1)
        note_input(path)
        if len(content) > LARGEST_FILE:
            raise InputError(str(path), "is too large for a model or case file", "at most 5 MB are read")
        if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
            raise InputError(str(path), "is saved as UTF-16", "save the file as UTF-8 text")
        # Windows' editor begins UTF-8 with a mark of its own
        if deep := _DEEP_KEY.search(written := content.decode("utf-8-sig").replace("\r\n", "\n")):
            raise InputError(
                f"{path}, line {written.count(chr(10), 0, deep.start()) + 1}",
                "has a key of too many parts",
                "write at most 50",
            )
        tables = tomllib.loads(written)
    except FileNotFoundError:
        raise InputError(str(path), "does not exist", "name an existing file") from None
    except IsADirectoryError:
        inside = [name for name in ("case.toml", "result.json") if os.path.isfile(os.path.join(path, name))]
        right = f"name a file in it, {os.path.join(path, inside[0])}" if inside else "name a file"
        raise InputError(str(path), "is a directory", right) from None
    except OSError as fault:
        raise InputError(str(path), fault.strerror or "cannot be read", "name a readable file") from None
    except UnicodeDecodeError as fault:
        raise InputError(
            str(path),
            f"byte {fault.start} is not UTF-8",
            "save the file as UTF-8 text, or, if it is a recording, look at it with 'rigmatch explore'",
        ) from None
    except tomllib.TOMLDecodeError as fault:
        raise _not_toml(path, content, fault) from None
    except ValueError as fault:  # a number of thousands of digits, say
        raise InputError(str(path), f"cannot be read: {fault}", "write ordinary numbers") from None
    except RecursionError:
        raise InputError(str(path), "is nested too deeply", "a model file has three levels") from None
    _check_integers(tables, path)
    return tables


def _not_toml(path: str | Path, content: bytes, fault: tomllib.TOMLDecodeError) -> InputError:
    """The error for a text that is not TOML: what it is instead, or what its first wrong line lacks."""
    if os.path.splitext(path)[1].lower() in RECORDINGS:
        return InputError(
            str(path), "is a recording, where a model or case file is expected", "check the order of files"
        )
    text = content.decode("utf-8-sig", "replace")
    if text.lstrip().startswith(("{", "[")) and _is_json(text):
        right = "write TOML; a result.json of a match is read by export, excite, identify and verify"
        return InputError(str(path), "is JSON, where a model or case file (TOML) is expected", right)
    lines = text.splitlines()
    for count, line in enumerate(lines, 1):
        if comma := _DECIMAL_COMMA.search(line):
            right = f"write a decimal point: {comma[1]}.{comma[2]}"
            return InputError(f"{path}, line {count}", f"{comma[0].lstrip('= ')!r} has a decimal comma", right)
    place = _FAULTY_LINE.search(str(fault))
    number = min(int(place[1]), len(lines)) if place else len(lines)
    line = lines[number - 1].partition("#")[0].strip() if lines else ""
    if "overwrite" in str(fault) or "declare" in str(fault):
        name = line.partition("=")[0].strip()
        return InputError(f"{path}, line {number}", f"{name} is there twice", "keep one of them")
    for pattern, wrong, right in _SLIPS:
        if slip := pattern.search(line):
            return InputError(f"{path}, line {number}", wrong.format(*slip.groups()), right.format(*slip.groups()))
    return InputError(str(path), f"is not TOML: {fault}", "correct that line")


_FAULTY_LINE = re.compile(r"at line (\d+)")
_SLIPS = [  # what a line that is not TOML shows, what is wrong and what would be right
    (
        re.compile(r"""^[^"']*(?:"[^"]*"[^"']*)*(["'])[^"']*$"""),
        "a text begins with {0} and does not end",
        "write {0} behind it, too",
    ),
    (re.compile(r"[\u201c\u201d\u201e\u2018\u2019]"), "has typographic quotes", 'write straight ones: "'),
    (
        re.compile(r'("[^"]*\\[^"]*")'),
        "a backslash between double quotes begins a special character",
        "write single quotes, as 'C:\\Users\\…', or slashes: C:/Users/…",
    ),
    (
        re.compile(r"=\s*(-?[\d.]+(?:[eE][+-]?\d+)?)\s*([A-Za-z°µΩ%][^\s,}}\]]*(?: ?[*/·^] ?[^\s,}}\]]+)*)"),
        "{0} {1} is a number with a unit, which needs quotes",
        'write "{0} {1}"',
    ),
    (re.compile(r"=\s*(True|False|TRUE|FALSE)\b"), "{0} is no value of TOML", "write true or false"),
    (re.compile(r"=\s*([A-Za-z_][^\s,}}\]\"']*)"), "{0} is text, which needs quotes", 'write "{0}"'),
    (re.compile(r"^([\w.\"-]+)\s*:\s*(\S.*)$"), "a key is followed by a colon", "write {0} = {1}"),
    (re.compile(r"^([\w.\"-]+)\s*=\s*$"), "{0} has no value", "write one behind the equals sign"),
    (re.compile(r"^(\[+)([^\[\]]*)$"), "a heading is not closed", "write {0}{1}]"),
    (re.compile(r"^(//.*|;.*|%.*|/\*.*)$"), "a comment begins with #", "write # before it"),
]


def _is_json(text: str) -> bool:
    try:
        json.loads(text)
    except (ValueError, RecursionError):
        return False
    return True


def no_pipe(path: Path, where: str) -> Path:
    """The path itself, of a file that another file names.

    Raises
    ------
    InputError
        If it is a pipe, a device or a folder: reading such a thing may never end.
    """
    if os.path.exists(path) and not os.path.isfile(path):
        raise InputError(where, f"{path} is no regular file", "name one")
    return path


def _check_integers(tables: dict[str, Any], path: str | Path) -> None:
    """Raise ``InputError`` for an integer beyond all floating-point numbers; no message could show it."""
    remaining: list[Any] = [tables]
    while remaining:
        value = remaining.pop()
        if isinstance(value, dict):
            remaining += value.values()
        elif isinstance(value, list):
            remaining += value
        elif isinstance(value, int) and value.bit_length() > LONGEST_INTEGER:
            raise InputError(str(path), "has an integer of hundreds of digits", "write ordinary numbers")


KINDS = {  # kinds of files: keys that only they have at the top, and a command that reads them
    "case": ({"vehicle", "rig", "targets"}, "match"),
    "model": ({"inertias", "shafts"}, "modes"),
    "budget": ({"measurand", "measurands"}, "uncertainty"),
    "fidelity case": ({"system_dynamics", "residual_vehicle_model"}, "fidelity"),
    "channel file": ({"channels"}, "diagnose --channels"),
}
RECORDINGS = {".csv", ".txt", ".dat", ".tsv", ".mf4", ".mdf", ".mat", ".parquet", ".xlsx", ".lvm"}
_DECIMAL_COMMA = re.compile(r"=\s*(-?\d+),(\d+)\s*(?:#|$)")


def kind_of(tables: Mapping[str, Any], where: str) -> str:
    """The kind of a file by the keys that only it has, as in :data:`KINDS`; raises ``InputError`` where none fits."""
    for kind, (marks, _) in KINDS.items():
        if not marks.isdisjoint(tables):
            return kind
    raise InputError(where, "is no file of rigmatch", f"a {', '.join(KINDS)} is expected")


def key_place(where: str, key: str) -> str:
    """How an error names a key: ``file.toml: key`` at the top of a file, ``file.toml: table.key`` in a table."""
    return f"{where}.{key}" if ": " in where else f"{where}: {key}"


def check_file(tables: Mapping[str, Any], known: Iterable[str], where: str, kind: str) -> None:
    """Check the keys at the top of a file of a kind (``case``, ``model``, …).

    Raises
    ------
    InputError
        If there is an unknown key; where the file is of another kind, it says so.
    """
    known = set(known)
    for other, (marks, command) in KINDS.items():
        if other != kind and not tables.keys() <= known and not marks.isdisjoint(tables):
            raise InputError(where, f"is a {other}, where a {kind} is expected", f"give it to 'rigmatch {command}'")
    check_keys(tables, known, where)


def check_keys(table: Any, known: Iterable[str], where: str) -> dict[str, Any]:
    """The table itself.

    Raises
    ------
    InputError
        If it is no table or has a key besides the known ones.
    """
    if not isinstance(table, dict):
        raise InputError(where, "is no table", f"write [{where.rsplit(': ', 1)[-1]}] and its keys below")
    known = sorted(known)
    for key in table:
        if key not in known:
            raise unknown(key, known, where)
    return table


def number(
    table: Mapping[str, Any],
    key: str,
    where: str,
    *,
    positive: bool = False,
    least: float | None = None,
    most: float = math.inf,
) -> float:
    """A finite number under a key.

    Raises
    ------
    InputError
        If it is missing, no finite number, too small or too large.
    """
    if key not in table:
        raise InputError(where, f"'{key}' is missing", f"give {key} = a number")
    value = finite(table[key])
    if value is None:
        raise InputError(key_place(where, key), f"{table[key]!r} is no finite number", "give a finite number")
    if positive and value <= 0:
        raise InputError(key_place(where, key), f"{value!r} is not positive", "give a number above 0")
    if least is not None and value < least:
        raise InputError(key_place(where, key), f"{value!r} is too small", f"give at least {least:g}")
    if value > most:
        raise InputError(key_place(where, key), f"{value!r} is too large", f"give at most {most:g}")
    return value


def finite(value: object) -> float | None:
    """The value as a float if it is a finite number, else None; an integer too large for a float is not finite."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


def numbers(values: Any, where: str, least: int = 2) -> list[float]:
    """A list of at least so many finite numbers.

    Raises
    ------
    InputError
        If it is no such list.
    """
    if not isinstance(values, list) or len(values) < least:
        raise InputError(where, "is no list of readings", f"give at least {least} numbers")
    finite_values = [finite(value) for value in values]
    for place, (value, number) in enumerate(zip(values, finite_values, strict=True), start=1):
        if number is None:
            raise InputError(where, f"reading {place} is {value!r}", "every reading must be a finite number")
    return [number for number in finite_values if number is not None]


def text(table: Mapping[str, Any], key: str, where: str, default: str | None = None) -> str:
    """A text under a key, or the default where the key is missing.

    Raises
    ------
    InputError
        If it is no text, or missing without a default.
    """
    value = table.get(key, default)
    if value is None:
        raise InputError(where, f"'{key}' is missing", f'give {key} = "…"')
    if not isinstance(value, str):
        raise InputError(key_place(where, key), f"{value!r} is no text", "put it in quotes")
    if len(value) > LONGEST_TEXT:
        raise InputError(key_place(where, key), f"has {len(value)} characters", f"at most {LONGEST_TEXT} are read")
    return value


def title(table: Mapping[str, Any], where: str, default: str = "") -> str:
    """The title of a file, one line of text.

    Raises
    ------
    InputError
        If it is no text, too long, or holds control characters or line ends.
    """
    line = text(table, "title", where, default)
    if len(line) > LONGEST_TITLE:
        raise InputError(f"{where}: title", f"has {len(line)} characters", f"at most {LONGEST_TITLE} are read")
    for place, letter in enumerate(line, 1):
        if is_control(letter):
            wrong = f"character {place} (U+{ord(letter):04X}) is a control character or a line end"
            raise InputError(f"{where}: title", wrong, "write one line of text")
    return line


def one_of(value: str, choices: Iterable[str], where: str) -> str:
    """The value itself.

    Raises
    ------
    InputError
        If it is none of the choices.
    """
    choices = list(choices)
    if value not in choices:
        raise unknown(value, choices, where)
    return value


# --- Toml lines

_HEADER = re.compile(r"\s*(\[\[?)\s*([\w.\s\"'-]+?)\s*\]\]?\s*(?:#.*)?$")
_KEY = re.compile(r"\s*([\w.\"' -]+?)\s*=")
_ELEMENT = re.compile(r"\s*[{\[\"']")  # of a list that is written over several lines
_QUOTED = re.compile(r"'([^']+)'")
LARGEST_SEARCHED = 5_000_000  # bytes; speed only


def line_of(where: str, wrong: str = "") -> int | None:
    """The line, from 1, of a place ``FILE: table.name.key``, or of the table that should hold it; None if not found.

    Parameters
    ----------
    where : str
        As in :class:`modelling.errors.InputError`; ``effects[2].gap`` is a key of the second table.
    wrong : str
        What is wrong there: a key that it quotes is looked for in the place.
    """
    file, _, place = where.partition(": ")
    path = Path(file)
    if path.suffix != ".toml" or not path.is_file() or path.stat().st_size > LARGEST_SEARCHED:
        return None
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError:  # as it may be what the error says
        return None
    wanted = _parts(re.sub(r": +", ".", place).split(" ")[0].rstrip(":")) if place else []
    lines = [*_places(text.splitlines())]
    quoted = [[*wanted, *_parts(name)] for name in _QUOTED.findall(wrong)]
    for exact in quoted:
        for here, number in lines:
            if here[: len(exact)] in (
                exact,
                [*exact[:-1], f"{exact[-1]}[1]"],
            ):  # what it holds, the first of a list, too
                return number
    within = [(len(here), -number) for here, number in lines if here == wanted[: len(here)]]
    return -max(within)[1] if within else None


def _places(lines: list[str]) -> Iterator[tuple[list[str], int]]:
    """Every table, key and element of a list over several lines, with its line."""
    table: list[str] = []
    key, element, counted = list[str](), 0, dict[str, int]()
    for number, line in enumerate(lines, 1):
        if header := _HEADER.match(line):
            table, key = _parts(header[2]), []
            if header[1] == "[[":
                counted[header[2]] = counted.get(header[2], 0) + 1
                table[-1] += f"[{counted[header[2]]}]"
            yield table, number
        elif assignment := _KEY.match(line):
            key, element = [*table, *_parts(assignment[1])], 0
            yield key, number
        elif key and _ELEMENT.match(line):
            element += 1
            yield [*key[:-1], f"{key[-1]}[{element}]"], number


def _parts(key: str) -> list[str]:
    return [part.strip().strip("\"'") for part in key.split(".")]
