"""Which column of a measurement file is probably which channel of a model, and what such a file holds."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from pathlib import Path
from typing import Any

import numpy as np

from modelling.errors import InputError, listed
from modelling.escape import toml_string
from modelling.recordings.readers import read_table
from modelling.recordings.table import TIME_NAMES, Column, time_hint, unit_in_name
from modelling.system import System
from modelling.units import SENSOR_UNITS, factor

# --- Which column, and in which unit.

LEAST_SIMILARITY = 0.45  # of two names, below which nothing is suggested
UNIT_BONUS = 0.2  # for a unit that fits
KIND_BONUS = 0.25  # for a word that means the same kind of quantity
# What test benches call the kinds of quantities, in English and German, whole words
KIND_WORDS = {
    "torque": {"torque", "trq", "tq", "m", "t", "md", "moment", "drehmoment", "mom"},
    "speed": {"speed", "spd", "n", "w", "omega", "rpm", "drehzahl", "vel", "velocity"},
    "angle": {"angle", "phi", "winkel", "ang", "pos", "position"},
    "acceleration": {"acceleration", "acc", "alpha", "accel"},
}


@dataclass(frozen=True)
class Wanted:
    """A channel of a model: an input or a sensor, its kind of quantity, and whether it must be there."""

    name: str
    kind: str
    needed: bool

    @property
    def si(self) -> str:
        """Its SI unit."""
        return SENSOR_UNITS[self.kind]


@dataclass(frozen=True)
class Suggestion:
    """A column of the file for a channel; empty where none is like it."""

    column: str
    unit: str
    similarity: float


def wanted_channels(system: System) -> list[Wanted]:
    """Inputs, which must be there, then sensors."""
    inputs = [Wanted(part.name, "torque", True) for part in system.inputs]
    return inputs + [Wanted(part.name, part.measures, False) for part in system.sensors]


def suggestions(system: System, columns: Mapping[str, str]) -> dict[str, Suggestion]:
    """The likeliest column for every channel, each column once, the likeliest pairs first.

    Parameters
    ----------
    columns : mapping of str to str
        Unit by column, empty where the file states none.
    """
    pairs = sorted(
        (
            (_similarity(wanted, column, unit), wanted, column)
            for wanted in wanted_channels(system)
            for column, unit in columns.items()
            if _fits(wanted, unit)
        ),
        key=lambda pair: -pair[0],
    )
    by_channel: dict[str, Suggestion] = {}
    used: set[str] = set()
    for similarity, wanted, column in pairs:
        if similarity >= LEAST_SIMILARITY and wanted.name not in by_channel and column not in used:
            by_name = unit_in_name(column)
            unit = columns[column] or (by_name if _fits(wanted, by_name) else "") or wanted.si
            by_channel[wanted.name] = Suggestion(column, unit, similarity)
            used.add(column)
    return {w.name: by_channel.get(w.name, Suggestion("", w.si, 0.0)) for w in wanted_channels(system)}


def time_column(columns: Sequence[str]) -> str:
    """The column that is probably time; empty where none is."""
    return next((name for name in columns if name.strip().lower() in TIME_NAMES), "")


def channel_file(chosen: Mapping[str, tuple[str, str]], time: str) -> str:
    """The text of a channel file from column and unit by channel; where no column is known, a comment to be edited."""
    rows = [
        f"{'' if column else '# '}{toml_string(name)} = "
        f"{{ channel = {toml_string(column or 'NAME')}, unit = {toml_string(unit)} }}"
        for name, (column, unit) in chosen.items()
    ]
    return "\n".join(["[channels]", f"time = {toml_string(time)}", *rows]) + "\n"


def _fits(wanted: Wanted, unit: str) -> bool:
    try:
        factor(unit, wanted.si)
    except InputError:
        return False
    return True


def _words(name: str) -> list[str]:
    parted = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)
    return [word.lower() for word in re.split(r"[^A-Za-z]+", parted) if word]


def _similarity(wanted: Wanted, column: str, unit: str) -> float:
    """Likeness of the names without the words for the kind of quantity, and bonuses for kind and unit."""
    kinds = set().union(*KIND_WORDS.values())
    mine, theirs = _words(wanted.name), _words(column)
    same_kind = bool(KIND_WORDS[wanted.kind] & set(theirs))
    other_kind = not same_kind and bool(kinds - KIND_WORDS[wanted.kind] & set(theirs)) and bool(kinds & set(theirs))
    a, b = ("".join(word for word in words if word not in kinds) for words in (mine, theirs))
    alike = 1.0 if wanted.name == column else SequenceMatcher(None, a or "".join(mine), b or "".join(theirs)).ratio()
    bonus = KIND_BONUS * (same_kind - other_kind) + (UNIT_BONUS if unit else 0.0)
    return alike + bonus


SEVERAL = "+"  # between the files of several loggers

# --- What a measurement file holds: its channels in a table, and a channel file that fits a model.


def channel_list(path: str | Path, system: System | None = None) -> dict[str, Any]:
    """Channels of a measurement file as they stand there, in the file's names and units.

    Parameters
    ----------
    path : path
        CSV, MDF, ``.mat`` or Parquet; the files of several loggers joined by ``+``.
    system : System, optional
        A model for which a channel file is suggested.

    Returns
    -------
    dict
        ``channels``: file (of several), name, unit, samples, from, to (as time stands there), least, largest; ``notes``
        of the reader; ``channel_file``: its text, empty without a model.
    """
    path = str(path)
    paths = [path] if Path(path).exists() or SEVERAL not in path else path.split(SEVERAL)
    tables = {each: read_table(each) for each in paths}
    channels: list[dict[str, Any]] = []
    notes: list[str] = []
    times: list[str] = []
    columns: dict[str, str] = {}
    for each, table in tables.items():
        if not table.columns:
            there = f"; there are {listed(list(table.others))}" if table.others else ""
            raise InputError(each, f"has no channels{there}", "a channel is a column or vector of two numbers at least")
        time = time_column(table.names)
        begin = f"{each}: " if len(tables) > 1 else ""
        notes += [f"{begin}{note}" for note in table.notes]
        if not time:
            notes.append(f"{begin}no channel is called time: {time_hint(table.names)}")
        times.append(time)
        stamps = table[time].values if time else np.arange(table.rows, dtype=float)
        own = [_channel(column, stamps) for column in table.columns]
        channels += [{"file": each, **row} for row in own] if len(tables) > 1 else own
        columns |= {column.name: column.unit for column in table.columns if column.name not in (time, *columns)}
    suggested = ""
    if system is not None:
        chosen = {name: (found.column, found.unit) for name, found in suggestions(system, columns).items()}
        suggested = channel_file(chosen, next(filter(None, times), "NAME"))
    return {"channels": channels, "notes": notes, "channel_file": suggested}


def _channel(column: Column, stamps: np.ndarray) -> dict[str, Any]:
    values = column.values
    there = np.isfinite(values)
    found: dict[str, Any] = {"name": column.name, "unit": column.unit, "samples": int(there.sum())}
    if not there.any():
        return found | dict.fromkeys(("from", "to", "least", "largest"))
    recorded = stamps[there & np.isfinite(stamps)]
    ends = (float(recorded[0]), float(recorded[-1])) if len(recorded) else (None, None)
    return found | {
        "from": ends[0], "to": ends[1], "least": float(values[there].min()), "largest": float(values[there].max()),
    }  # fmt: skip
