"""Manoeuvres from the entries of a case file: a shape by name, a list of segments, or a file with a recorded torque."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from modelling.bed.manoeuvres.sequence import RecordedTorque, Segments
from modelling.bed.manoeuvres.shapes import KINDS, UNITS, Manoeuvre, TipIn
from modelling.common.errors import InputError, unknown
from modelling.common.tables import no_pipe
from modelling.measurement.read import read_signals
from modelling.units import in_unit, to_si

RAMP = {"to": "N*m", "over": "s", "hold": "s"}


def read_manoeuvre(entry: Any, name: str, where: str, folder: Path, held: float = 0.0) -> Manoeuvre:
    """A manoeuvre on the input ``name``.

    Parameters
    ----------
    entry : mapping or list
        A table with ``kind``; a list of such tables and of ramps ``{ to, over, hold }`` that follow one another; or
        ``{ file, absolute }``.
    folder : Path
        Where the case file stands.
    held : float
        N·m, the input's torque at the operating point: subtracted from a recorded torque that is absolute.

    Raises
    ------
    InputError
        Naming the key that is wrong.
    """
    if isinstance(entry, Sequence) and not isinstance(entry, str):
        return _segments(entry, where)
    if isinstance(entry, Mapping) and "file" in entry:
        return _recorded(entry, name, where, folder, held)
    return from_table(entry, where)


def from_table(table: Mapping[str, Any], where: str) -> Manoeuvre:
    """A manoeuvre from a table of a case file: ``kind``, ``amplitude`` and what else the kind has.

    Raises
    ------
    InputError
        Naming the key that is wrong.
    """
    if not isinstance(table, Mapping):
        raise InputError(
            where, f"{type(table).__name__} where a table is expected", 'write kind = "tip_in", amplitude = 100, …'
        )
    if "kind" not in table:
        raise InputError(f"{where}.kind", "is missing", f"write one of {', '.join(KINDS)}")
    kind = table["kind"]
    if not isinstance(kind, str) or kind not in KINDS:
        raise unknown(str(kind), list(KINDS), f"{where}.kind")
    cls = KINDS[kind]
    known = {entry.name: entry for entry in dataclasses.fields(cls)}
    for key in table:
        if key != "kind" and key not in known:
            raise unknown(str(key), list(known), f"{where} ({kind})")
    for key, entry in known.items():
        if entry.default is dataclasses.MISSING and key not in table:
            raise InputError(f"{where} ({kind})", f"{key!r} is missing", f"give a number{in_unit(UNITS[key])}")
    values = {key: to_si(value, UNITS[key], f"{where}.{key}") for key, value in table.items() if key != "kind"}
    try:
        return cls(**values)
    except InputError as fault:
        raise InputError(f"{where}.{fault.where}", fault.wrong, fault.right) from None


def _segments(entries: Sequence[Any], where: str) -> Segments:
    """Segments one after the other; a ramp begins at the torque where the segment before it ends."""
    if not entries:
        raise InputError(
            where, "has no segments", 'write { to = 120, over = 0.05, hold = 2 } or { kind = "tip_in", … }'
        )
    made: list[Manoeuvre] = []
    for number, entry in enumerate(entries, 1):
        place = f"{where}[{number}]"
        if isinstance(entry, Mapping) and "kind" not in entry:
            made.append(_ramp(entry, made[-1].end if made else 0.0, place))
        else:
            made.append(from_table(entry, place))
    return Segments.of(made)


def _ramp(entry: Mapping[str, Any], begin: float, where: str) -> TipIn:
    for key in entry:
        if key not in RAMP:
            raise unknown(str(key), [*RAMP, "kind"], where)
    if "to" not in entry:
        raise InputError(where, "'to' is missing", "give the torque in N*m that the ramp ends at")
    to, over, hold = (to_si(entry.get(key, 0.0), unit, f"{where}.{key}") for key, unit in RAMP.items())
    if min(over, hold) < 0 or not over + hold > 0:
        raise InputError(where, "takes no time", "give over and hold in s")
    return TipIn(amplitude=to - begin, offset=begin, at=0.0, rise_time=over, duration=over + hold)


def _recorded(entry: Mapping[str, Any], name: str, where: str, folder: Path, held: float) -> RecordedTorque:
    for key in entry:
        if key not in ("file", "absolute"):
            raise unknown(str(key), ["file", "absolute"], where)
    file, absolute = entry["file"], entry.get("absolute", False)
    if not isinstance(file, str) or not file:
        raise InputError(f"{where}.file", "is no text", f'write file = "trace.csv" with columns time and {name}')
    if not isinstance(absolute, bool):
        raise InputError(f"{where}.absolute", "is no true or false", "true where the operating point is in the record")
    recording = read_signals(no_pipe(folder / file, where), [name])
    if name not in recording.channels:
        raise InputError(f"{where}.file", f"{file} has no column {name!r}", "call its torque as the input is called")
    if unit := recording.units.get(name):
        to_si(f"1 {unit}", "N*m", f"{where}.file: {name}")
    return RecordedTorque.of(recording.time, recording[name] - (held if absolute else 0.0))
