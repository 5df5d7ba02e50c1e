"""What channels are called in measurement files: a small file that maps them to a model's names.

[channels]
motor_torque = "T_EM_actual"                                  # name in the model = name in the measurement
motor_speed = { channel = "n_EM", unit = "1/min" }            # a unit where the file has none, or a wrong one
flange_torque = { channel = "M_dyno", sign = -1 }             # positive in the other direction
load_speed = { channel = "n_load", group = 3, factor = 1.02 } # of an MDF: the group; times a factor
time = "t"
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from modelling.common.errors import InputError, unknown
from modelling.common.tables import read_toml
from modelling.measurement.readers.table import Table
from modelling.units import factor, to_si

KEYS = ("channel", "unit", "sign", "factor", "group")
CHANNEL_UNITS = ("rad/s", "N*m", "rad", "rad/s^2", "s")  # SI units of sensors, inputs and time


@dataclass(frozen=True)
class Channel:
    """A channel of a measurement file: its name there, its unit (None: as the file says), what it is multiplied by, and
    the group it is in where several have it (MDF), and where the channel file says so: ``FILE: channels.NAME``."""

    name: str
    unit: str | None = None
    factor: float = 1.0
    group: int | None = None
    where: str = field(default="", compare=False)


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
    channels = {name: _channel(value, f"{path}: channels.{name}") for name, value in table.items()}
    first_use: dict[str, str] = {}
    for name, channel in channels.items():
        if channel.name in first_use:
            raise InputError(
                f"{path}: channels.{name}",
                f"{channel.name!r} is {first_use[channel.name]!r} already",
                "name another channel",
            )
        first_use[channel.name] = name
    return channels


def _channel(value: Any, where: str) -> Channel:
    table = value if isinstance(value, dict) else {"channel": value}
    for key in table:
        if key not in KEYS:
            raise unknown(key, list(KEYS), where)
    name, unit, sign, group = table.get("channel"), table.get("unit"), table.get("sign", 1), table.get("group")
    if not isinstance(name, str) or not name.strip():
        raise InputError(where, "names no channel", 'write "channel" or { channel = "…", unit = "…", sign = -1 }')
    if unit is not None and not isinstance(unit, str):
        raise InputError(f"{where}.unit", f"{unit!r} is no unit", 'write a text such as "N*m" or "1/min"')
    if isinstance(sign, bool) or sign not in (1, -1):
        raise InputError(f"{where}.sign", f"{sign!r} is no sign", "write 1 or -1")
    multiplier = to_si(table.get("factor", 1.0), "1", f"{where}.factor")
    if multiplier == 0:
        raise InputError(f"{where}.factor", "is 0", "write what the channel is to be multiplied by")
    if group is not None and (isinstance(group, bool) or not isinstance(group, int) or group < 0):
        raise InputError(f"{where}.group", f"{group!r} is no group", "write its number, counted from 0")
    return Channel(name.strip(), unit, sign * multiplier, group, where)


def _same_unit(first: str, second: str) -> bool:
    """Whether two units of a sensor or input are the same, as rpm and 1/min."""
    for si in CHANNEL_UNITS:
        try:
            return factor(first, si) == factor(second, si)
        except InputError:
            continue
    return first == second


def names_in_file(names: Iterable[str], channels: Mapping[str, Channel] | None) -> set[str]:
    """What channels of the model, and time, are called in the file."""
    return {channels[name].name if channels and name in channels else name for name in [*names, "time"]}


def groups_in_file(channels: Mapping[str, Channel] | None) -> dict[str, int]:
    """The group of every channel for which one is named, by the channel's name in the file."""
    return {channel.name: channel.group for channel in (channels or {}).values() if channel.group is not None}


def renamed(table: Table, channels: Mapping[str, Channel], source: str) -> Table:
    """A table with the model's names and signs; columns without an entry in ``channels`` keep theirs.

    Raises
    ------
    InputError
        If a channel is not in the file; with what it might be.
    """
    if "time" in channels and channels["time"].name in table.names and table.names[0] != channels["time"].name:
        table = _time_first(table, channels["time"].name)
    names, units, values, notes = list(table.names), list(table.units), table.values.copy(), list(table.notes)
    for name, channel in channels.items():
        if channel.name not in table.names:
            time_has_no_name = name == "time" and table.names[:1] == ["time"]
            if channel.name in table.others or time_has_no_name:
                continue
            fault = unknown(channel.name, [*table.names, *table.others], channel.where or f"channels.{name}")
            raise InputError(fault.where, f"{channel.name!r} does not exist in {source}", fault.right)
        if name in table.names and name != channel.name:
            wrong = f"has a column {name!r} beside {channel.name!r}, which is to be {name!r}"
            raise InputError(source, wrong, "drop one")
        index = table.names.index(channel.name)
        stated, unit = table.units[index], channel.unit if channel.unit is not None else table.units[index]
        if stated and not _same_unit(stated, unit):
            notes.append(f"{channel.name} is in {stated} by the file, taken in {unit or 'SI'} by the channel file")
        names[index], units[index] = name, unit
        values[:, index] *= channel.factor
    return replace(table, names=names, units=units, values=values, notes=tuple(notes))


def _time_first(table: Table, time: str) -> Table:
    """The column that is to be time in front; another one called ``time`` is left out."""
    first = table.names.index(time)
    order = [first, *(i for i, name in enumerate(table.names) if name not in (time, "time"))]
    left_out = ("time",) if "time" in table.names else ()
    return replace(
        table,
        names=[table.names[i] for i in order],
        units=[table.units[i] for i in order],
        values=np.ascontiguousarray(table.values[:, order]),
        others=(*left_out, *table.others),
    )
