"""What channels are called in somebody's measurement files: a small file that maps them to a model's names.

[channels]
motor_torque = "T_EM_actual"                                  # name in the model = name in the measurement
motor_speed = { channel = "n_EM", unit = "1/min" }            # a unit where the file has none, or a wrong one
flange_torque = { channel = "M_dyno", sign = -1 }             # counted the other way round
time = "t"
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from modelling.common.errors import InputError, unknown
from modelling.common.tables import read_toml
from modelling.measurement.readers import Table
from modelling.units import factor

KEYS = ("channel", "unit", "sign")


@dataclass(frozen=True)
class Channel:
    """A channel of a measurement file: name there, unit (None: as the file says), and the sign it is counted by."""

    name: str
    unit: str | None = None
    sign: float = 1.0


def read_channels(path: str | PathLike[str]) -> dict[str, Channel]:
    """Read a channel file: Channel by the model's name.

    Raises
    ------
    InputError
        Names file and key: no table ``[channels]``, a key or value that does not fit, a channel that is used twice.
    """
    path = Path(path)
    data = read_toml(path)
    for key in data:
        if key != "channels":
            raise unknown(key, ["channels"], f"{path}")
    table = data.get("channels")
    if not isinstance(table, dict) or not table:
        raise InputError(f"{path}: channels", "is missing or empty", 'write [channels] with NAME = "channel" rows')
    found = {name: _channel(value, f"{path}: channels.{name}") for name, value in table.items()}
    used: dict[str, str] = {}
    for name, own in found.items():
        if own.name in used:
            raise InputError(
                f"{path}: channels.{name}", f"{own.name!r} is {used[own.name]!r} already", "name another channel"
            )
        used[own.name] = name
    return found


def _channel(value: Any, where: str) -> Channel:
    given = value if isinstance(value, dict) else {"channel": value}
    for key in given:
        if key not in KEYS:
            raise unknown(key, list(KEYS), where)
    name, unit, sign = given.get("channel"), given.get("unit"), given.get("sign", 1)
    if not isinstance(name, str) or not name.strip():
        raise InputError(where, "names no channel", 'write "channel" or { channel = "…", unit = "…", sign = -1 }')
    if unit is not None and not isinstance(unit, str):
        raise InputError(f"{where}.unit", f"{unit!r} is no unit", 'write a text such as "N*m" or "1/min"')
    if isinstance(sign, bool) or sign not in (1, -1):
        raise InputError(f"{where}.sign", f"{sign!r} is no sign", "write 1 or -1")
    return Channel(name.strip(), unit, float(sign))


def _same(unit: str, other: str) -> bool:
    """Whether two units of a sensor or input are one, as rpm and 1/min."""
    for si in ("rad/s", "N*m", "rad", "rad/s^2", "s"):
        try:
            return factor(unit, si) == factor(other, si)
        except InputError:
            continue
    return unit == other


def called(names: Iterable[str], channels: Mapping[str, Channel] | None) -> set[str]:
    """What names of the model are called in the file; time under its own name too."""
    return {channels[name].name if channels and name in channels else name for name in [*names, "time"]}


def renamed(table: Table, channels: Mapping[str, Channel], source: str) -> Table:
    """A table with its columns named, and signed, as the model counts them; columns nobody names stay.

    Raises
    ------
    InputError
        If a channel is not in the file; with what it might be.
    """
    header, values, notes = list(table.header), table.values.copy(), list(table.notes)
    names = [text.partition("[")[0].strip() for text in header]
    for name, own in channels.items():
        if own.name not in names:
            if own.name in table.others or (name == "time" and names[0] == "time"):
                continue  # nobody asked for it; or a format whose time has no name of its own
            raise unknown(own.name, [*names, *table.others], f"{source}: channel of {name!r}")
        if name in names and name != own.name:
            raise InputError(source, f"has a column {name!r} beside {own.name!r}, which is to be {name!r}", "drop one")
        column = names.index(own.name)
        there = table.header[column].partition("[")[2].rpartition("]")[0]
        unit = own.unit if own.unit is not None else there
        if there and not _same(there, unit):
            notes.append(f"{own.name} is in {there} by the file, taken in {unit or 'SI'} by the channel file")
        header[column] = f"{name} [{unit}]" if unit else name
        if own.sign < 0:
            values[:, column] = -values[:, column]
    if "time" in channels:
        first = names.index(channels["time"].name)
        order = [first, *(i for i in range(len(header)) if i != first)]
        header, values = [header[i] for i in order], values[:, order]
    return replace(table, header=header, values=np.ascontiguousarray(values), notes=tuple(notes))
