"""In which line of a TOML file a key stands, for error messages; a guide for the reader, not a parser."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

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
        As in :class:`modelling.common.errors.InputError`; ``effects[2].gap`` is a key of the second table.
    wrong : str
        What is wrong there: a key that it quotes is looked for in the place.
    """
    file, _, place = where.partition(": ")
    path = Path(file)
    if path.suffix != ".toml" or not path.is_file() or path.stat().st_size > LARGEST_SEARCHED:
        return None
    wanted = _parts(re.sub(r": +", ".", place).split(" ")[0].rstrip(":")) if place else []
    lines = [*_places(path.read_text(encoding="utf-8", errors="replace").splitlines())]
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
