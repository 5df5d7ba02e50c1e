"""From a measurement file to a recording: of the channels of a model, or of signals of any kind."""

from __future__ import annotations

import io
import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from modelling.errors import InputError, listed, unknown
from modelling.recordings.channel_faults import fault
from modelling.recordings.corrections import (
    corrected_wraps,
    far_beyond_note,
    held_rows,
    jumps_note,
    magnitude_note,
    unwrapped,
    without_overrange,
)
from modelling.recordings.frames import table_of_frame
from modelling.recordings.plausible import check_columns, check_pedals, check_seconds, standstill_notes
from modelling.recordings.readers import read_table
from modelling.recordings.recording import (
    GAP_STEPS,
    Recording,
    bridge_of,
    bridged,
    longest_bridge,
    missing_note,
    own_interval,
    rows_a_value,
)
from modelling.recordings.table import TIME_NAMES, Column, Table, name_and_unit, time_hint, unit_in_name
from modelling.system import System
from modelling.toml import read_toml
from modelling.topology import joints, speed_ratios
from modelling.units import LARGEST, factor, signal_unit, to_si

# --- What channels are called in measurement files: a small file that maps them to a model's names.
#
# [channels]
# motor_torque = "T_EM_actual"                                  # name in the model = name in the measurement
# motor_speed = { channel = "n_EM", unit = "1/min" }            # a unit where the file has none, or a wrong one
# flange_torque = { channel = "M_dyno", sign = -1 }             # positive in the other direction
# load_speed = { channel = "n_load", group = 3, factor = 1.02 } # of an MDF: the group; times a factor
# time = "t"
# motor_angle = { channel = "phi", period = 360 }               # starts anew after so much, in the file's unit
#
# Above [channels] may stand ``header = 3``, the line of a table's header, and ``sampling_rate = 1000`` (Hz) of a file
# without a column of time, and ``same_clock = true`` of files joined by + that were recorded on one clock.

KEYS = ("channel", "unit", "sign", "factor", "group", "period")
FILE_KEYS = ("channels", "header", "sampling_rate", "same_clock")
CHANNEL_UNITS = ("rad/s", "N*m", "rad", "rad/s^2", "s")  # SI units of sensors, inputs and time


@dataclass(frozen=True)
class Channel:
    """A channel of a measurement file: its name there, its unit (None: as the file says), what it is multiplied by,
    the group it is in where several have it (MDF), after how much it starts anew (in the file's unit), and where the
    channel file says so: ``FILE: channels.NAME``."""

    name: str
    unit: str | None = None
    factor: float = 1.0
    group: int | None = None
    period: float | None = None
    where: str = field(default="", compare=False)


class ChannelFile(dict[str, Channel]):
    """Channel by the model's name; the line of the header and the sampling rate (Hz) where the file states them.

    ``same_clock``: joined files were recorded on one clock.
    """

    header: int | None = None
    sampling_rate: float | None = None
    same_clock: bool = False


def read_channels(path: str | PathLike[str]) -> ChannelFile:
    """Read a channel file: Channel by the model's name.

    Raises
    ------
    InputError
        Names file and key: no table ``[channels]``, a key or value that does not fit, a channel that is used twice.
    """
    path = Path(path)
    data = read_toml(path)
    for key in data:
        if key not in FILE_KEYS:
            raise unknown(key, list(FILE_KEYS), f"{path}")
    table = data.get("channels", {})
    if not isinstance(table, dict) or (not table and len(data) <= ("channels" in data)):
        raise InputError(f"{path}: channels", "is missing or empty", 'write [channels] with NAME = "channel" rows')
    channels = ChannelFile({name: _channel(value, f"{path}: channels.{name}") for name, value in table.items()})
    if "sampling_rate" in data:
        rate = to_si(data["sampling_rate"], "Hz", f"{path}: sampling_rate")
        if rate <= 0:
            raise InputError(f"{path}: sampling_rate", "is not positive", "write samples per second, in Hz")
        channels.sampling_rate = rate
    if "same_clock" in data:
        if not isinstance(data["same_clock"], bool):
            raise InputError(f"{path}: same_clock", f"{data['same_clock']!r} is neither true nor false", "write true")
        channels.same_clock = data["same_clock"]
    if "header" in data:
        header = data["header"]
        if isinstance(header, bool) or not isinstance(header, int) or not 1 <= header <= 100_000:
            raise InputError(f"{path}: header", f"{header!r} is no line", "write the number of its line, from 1")
        channels.header = header
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
    period = to_si(table["period"], "1", f"{where}.period") if "period" in table else None
    if period is not None and period <= 0:
        raise InputError(
            f"{where}.period", "is not positive", "write after how much it starts anew, in the file's unit"
        )
    return Channel(name.strip(), unit, sign * multiplier, group, period, where)


def _same_unit(first: str, second: str) -> bool:
    """Whether two units of a sensor or input are the same, as rpm and 1/min."""
    for si in CHANNEL_UNITS:
        try:
            return factor(first, si) == factor(second, si)
        except InputError:
            continue
    return first == second


def names_in_file(names: Iterable[str], channels: Mapping[str, Channel] | None) -> set[str]:
    """What channels of the model, and time, are called in the file, also without the unit that a name may end in."""
    called = {channels[name].name if channels and name in channels else name for name in [*names, "time"]}
    return called | {name_and_unit(name)[0] for name in called}


def read_columns(path: str | Path, used: set[str], channels: Mapping[str, Channel] | None) -> Table:
    """The columns of a file that are used, as :func:`read_table`; with what a channel file says of the file."""
    groups = {channel.name: channel.group for channel in (channels or {}).values() if channel.group is not None}
    stated = channels if isinstance(channels, ChannelFile) else ChannelFile()
    table = read_table(path, used, groups, stated.header)
    if stated.sampling_rate is None:
        if "time" in table or "time" in stated or (called := time_column((*table.names, *table.others), used)) is None:
            return table
        if called in table.others:
            table = read_table(path, {*used, called}, groups, stated.header)
        columns = (replace(column, name="time") if column.name == called else column for column in table.columns)
        return replace(table, columns=tuple(columns))
    if "time" in table or not table.rows:
        wrong = "has a column 'time'" if "time" in table else "has none of the channels that are asked for"
        raise InputError(str(path), wrong, "drop sampling_rate in the channel file" if "time" in table else "")
    time = Column("time", "s", np.arange(table.rows) / stated.sampling_rate)
    return replace(table, columns=(time, *table.columns))


def time_column(columns: Iterable[str], used: Collection[str]) -> str | None:
    """The one column that is called like a time, in any case, and is no channel of the model; None without it."""
    found = [name for name in columns if name.strip().lower() in TIME_NAMES and name not in used]
    return found[0] if len(found) == 1 else None


def renamed(table: Table, channels: Mapping[str, Channel], source: str) -> Table:
    """A table with the model's names and signs; columns without an entry in ``channels`` keep theirs.

    Raises
    ------
    InputError
        If a channel is not in the file; with what it might be.
    """
    time, others, notes = channels.get("time"), table.others, list(table.notes)
    own_time = time is not None and time.name != "time" and time.name in table and "time" in table
    if own_time:  # another column is to be the time
        table, others = replace(table, columns=tuple(c for c in table.columns if c.name != "time")), ("time", *others)
    columns = dict(enumerate(table.columns))
    for name, channel in channels.items():
        called = channel.name if channel.name in table else name_and_unit(channel.name)[0]
        index = next((i for i, column in enumerate(table.columns) if column.name == called), None)
        if index is None:
            if channel.name in others:  # of which no numbers could be read
                others = tuple(name if each == channel.name else each for each in others)
                continue
            if name == "time" and name in table:
                continue
            fault = unknown(channel.name, [*table.names, *others], channel.where or f"channels.{name}")
            raise InputError(fault.where, f"{channel.name!r} does not exist in {source}", fault.right)
        if name in table and name != called:
            wrong = f"has a column {name!r} beside {channel.name!r}, which is to be {name!r}"
            raise InputError(source, wrong, "drop one")
        stated = table.columns[index].unit
        unit, by_name = channel.unit if channel.unit is not None else stated, unit_in_name(called)
        if stated and not _same_unit(stated, unit):
            notes.append(f"{channel.name} is in {stated} by the file, taken in {unit or 'SI'} by the channel file")
        if not stated and by_name and not unit:
            unit = by_name
            notes.append(f"{channel.name} is taken in {by_name}, as its name says")
        elif not stated and by_name and not _same_unit(by_name, unit):
            notes.append(f"{channel.name} is in {by_name} by its name, taken in {unit} by the channel file")
        values = table.columns[index].values
        if channel.period is not None:
            values = unwrapped(values, channel.period)
            notes.append(f"{name} is unwrapped: it starts anew after {channel.period:g} by the channel file")
        columns[index] = Column(name, unit, values * channel.factor)
    return replace(table, columns=tuple(columns.values()), notes=tuple(notes), others=others)


# --- Columns of a file: found by name, converted to SI.


def check_header(table: Table, source: str) -> None:
    """Check that there is a column of time, that names differ, and that there are rows.

    Raises
    ------
    InputError
        Otherwise.
    """
    columns = (*table.names, *table.others)
    if not columns:
        raise InputError(source, "has no columns", "'time [s]' and the inputs are needed")
    if "time" not in table:
        raise InputError(source, f"has no column 'time'; there are {listed(list(columns))}", time_hint(columns))
    for i, name in enumerate(table.names):
        if name in table.names[:i]:
            raise InputError(f"{source}: line 1", f"column {name!r} is there twice", "names must differ")
    if table.rows < 2:
        rows = table.rows
        if table.others and len(table.names) == 1:
            there = f"has none of the channels that are asked for; there are {listed(list(table.others))}"
            raise InputError(source, there, "a channel file (--channels) maps names")
        raise InputError(source, f"has {rows} row{'s' * (rows != 1)} of numbers", "at least two are needed")


def column(
    table: Table, name: str, rows: np.ndarray, scale: float, source: str, notes: list[str] | None = None
) -> np.ndarray:
    """Values (t,) of a column in the rows (t,), times ``scale``; NaN where missing or overrange (noted).

    Raises
    ------
    InputError
        If a value is larger than any quantity.
    """
    read, over = without_overrange(table[name].values[rows])
    if over and notes is not None:
        first = table.place(int(rows[np.argmax(np.isnan(read) & ~np.isnan(table[name].values[rows]))]))
        notes.append(f"{name}: {over} numbers of 1e30 or more stand for missing values, first in {first}")
    values = read * scale
    if (np.abs(values) > LARGEST).any():
        row = int(rows[np.nanargmax(np.abs(values))])
        wrong = f"{name!r} is {table[name].values[row]:g}"
        raise InputError(f"{source}: {table.place(row)}", wrong, f"at most {LARGEST:g} (SI) is read: leave it empty")
    return values


# --- What a recording holds, in words.


def contents_of(recording: Recording, system: System) -> str:
    """Samples, length, inputs and sensors of a system's recording, and what is to note of it, in one line."""
    inputs, sensors = [part.name for part in system.inputs], recording.sensors(system)
    notes = "".join(f"; note: {note}" for note in recording.notes)
    return (
        f"a recording: {len(recording.time)} samples over {recording.time[-1] - recording.time[0]:g} s, "
        f"inputs {', '.join(inputs) or 'none'}, sensors {', '.join(sensors) or 'none'}{notes}"
    )


# --- The time base of a recording: which rows count, and when they were sampled.

ON_GRID = 0.01  # of a step: time stamps that deviate less from a regular grid are put on it
MOST_REPEATED = 0.05  # of the rows: with more repeated time stamps, time has too few digits
LARGEST_START = 1e5  # s: a time that starts later counts from a date; it is made to start at 0


@dataclass(frozen=True)
class TimeBase:
    """Rows (t,) of a table that count, their times (t,) in s, and notes of what was corrected."""

    rows: np.ndarray
    time: np.ndarray
    notes: tuple[str, ...]


def time_base(seconds: np.ndarray, table: Table, source: str) -> TimeBase:
    """Check the times (t,) of a table's rows in s, and put them on a regular grid where they are near one.

    Raises
    ------
    InputError
        If a time is missing or not finite, time falls, all rows have the same time, or so many time stamps are repeated
        that their digits must be too few.
    """
    if not np.isfinite(seconds).all():
        row = int(np.argmin(np.isfinite(seconds)))
        raise InputError(f"{source}: {table.place(row)}", "time is missing or not finite", "every row needs its time")
    step = np.diff(seconds)
    if (step < 0).any():
        row = int(np.argmax(step < 0)) + 1
        raise InputError(
            f"{source}: {table.place(row)}",
            f"time falls from {seconds[row - 1]:.10g} to {seconds[row]:.10g} s",
            "time must rise",
        )
    rows = np.flatnonzero(np.append(True, step > 0))
    notes = _repeated(seconds, rows, source)
    time, shifted = seconds[rows], abs(seconds[0]) > LARGEST_START
    if shifted:
        time = time - time[0]
        notes.append(f"time starts at {seconds[0]:.15g} s in the file, at 0 here")
    on_grid, more = _on_grid(time)
    return TimeBase(rows, on_grid, (*notes, *more))


def _repeated(seconds: np.ndarray, rows: np.ndarray, source: str) -> list[str]:
    """A note of time stamps that are repeated; ``rows`` are the first of each."""
    repeated = len(seconds) - len(rows)
    if len(rows) < 2:
        raise InputError(
            source,
            f"all rows have the same time, {seconds[0]:.10g} s",
            "write time with more digits, or from the start of the recording",
        )
    first = seconds[int(np.argmax(np.diff(seconds) == 0))]
    if repeated > max(1.0, MOST_REPEATED * len(seconds)):
        raise InputError(
            source,
            f"{repeated} of {len(seconds)} time stamps are repeated, first at {first:.10g} s",
            "write time with more digits, or from the start of the recording",
        )
    if repeated:
        return [f"{repeated} time stamps are repeated, first at {first:g} s: the first row of each is kept"]
    return []


def _on_grid(time: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Times (t,) on a regular grid where they are near one, and notes of gaps and uneven steps."""
    step = np.diff(time)
    if notes := gap_notes(time):
        return time, notes
    grid = time[0] + np.arange(len(time)) * (time[-1] - time[0]) / (len(time) - 1)
    if np.abs(time - grid).max() <= ON_GRID * np.median(step):
        return grid, []
    return time, [f"uneven time steps, {step.min():.4g} to {step.max():.4g} s"]


def gap_notes(time: np.ndarray) -> list[str]:
    """A note of the gaps in time (t,), s, if there are any."""
    step = np.diff(time)
    gaps = np.flatnonzero(step > GAP_STEPS * np.median(step))
    if not len(gaps):
        return []
    where = ", ".join(f"{step[i]:g} s at {time[i]:g} s" for i in gaps[:3])
    more = f" and {len(gaps) - 3} more" if len(gaps) > 3 else ""
    longest = longest_bridge(time)
    if (step[gaps] <= longest).all():
        return [f"gaps in time ({where}{more}): inputs vary linearly across them"]
    return [f"gaps in time ({where}{more}): inputs vary linearly across those up to {longest:g} s, others divide it"]


# --- Read


def read_recording(
    path: str | Path, system: System, channels: Mapping[str, Channel] | None = None, *, absent_is_zero: bool = False
) -> Recording:
    """Read the channels of a system from a file.

    Every input of the system must be there; ``absent_is_zero`` takes a torque that no channel holds as zero, with a
    note (:func:`absent_inputs`). Sensors that are missing are unused, as are columns that the system does
    not have. Gaps are treated as :mod:`modelling.recordings.recording` says.

    Parameters
    ----------
    path : path
        CSV, MDF, ``.mat`` or Parquet.
    system : System
    channels : mapping of str to Channel, optional
        What the channels are called in the file, where that differs; see
        :func:`modelling.recordings.read.read_channels`.

    Raises
    ------
    InputError
        One line that names file, line or column: no header, no time, text among numbers, unknown unit, missing input,
        time that does not rise, too few rows.
    """
    source = str(path)
    names = [*_units(system), *system.further_signals]
    table = read_columns(path, names_in_file(names, channels), channels)
    return _as_called(table, system, channels, source, absent_is_zero)


def recording_of_frame(frame: Any, system: System, channels: Mapping[str, Channel] | None = None) -> Recording:
    """Read the channels of a system from a pandas DataFrame, with the units that its columns name.

    Time is a column, or the index: durations, dates, or seconds.

    Raises
    ------
    InputError
        As :func:`read_recording`.
    """
    source, used = "the DataFrame", names_in_file([*_units(system), *system.further_signals], channels)
    table = table_of_frame(frame)
    if "time" not in table and "time" not in (channels or {}):
        called = time_column(table.names, used)
        columns = (replace(column, name="time") if column.name == called else column for column in table.columns)
        table = replace(table, columns=tuple(columns))
    return _as_called(table, system, channels, source, absent_is_zero=True)


def _as_called(
    table: Table, system: System, channels: Mapping[str, Channel] | None, source: str, absent_is_zero: bool
) -> Recording:
    """The channels of a system from a table with the file's names."""
    table = renamed(table, channels, source) if channels else table
    notes: list[str] = []
    if absent_is_zero and table.rows and table.names != ["time"]:
        for name in absent_inputs(table.names, table.others, system, bool(channels)):
            notes.append(absent_note(name))
            table = replace(table, columns=(*table.columns, Column(name, "", np.zeros(table.rows))))
    return recording_from_table(replace(table, notes=(*table.notes, *notes)), system, source)


MAY_BE_IT = 0.75  # similarity of two names (difflib), from which a column may be an input that was written otherwise
_LIKE_A_TORQUE = re.compile(r"torque|moment|trq|n\W?m\b|^t?m[_ ]|^t?m$|(^|[_ ])t?q([_ ]|$)", re.IGNORECASE)


def absent_inputs(columns: Collection[str], others: Collection[str], system: System, mapped: bool) -> list[str]:
    """Torques of a system that were not recorded, by all that is known of the columns.

    Not those that an unused column may hold: by its similar name, or, where no channel file says which column is which
    (``mapped``), because it is called like a torque. None where no input was recorded, and no imposed motion.
    """
    known, inputs = {*_units(system), *system.further_signals, "time"}, [part.name for part in system.inputs]
    unused = [name for name in (*columns, *others) if name not in known]
    missing = [name for name in inputs if name not in columns and name not in others]
    if len(missing) == len(inputs) or (not mapped and any(_LIKE_A_TORQUE.search(name) for name in unused)):
        return []
    return [
        name
        for name in missing
        if system.input_quantities[name] == "torque"
        and name not in system.capacities
        and not get_close_matches(name, unused, 1, MAY_BE_IT)
    ]


def absent_note(name: str) -> str:
    """What is said of a torque that was not recorded."""
    return f"no channel holds {name}: it is taken as zero"


def recording_from_table(table: Table, system: System, source: str) -> Recording:
    """The channels of a system in SI from a table with the model's names; see :func:`read_recording`.

    Raises
    ------
    InputError
        One line that names file, column or row.
    """
    if table.names == ["time"]:  # a missing input says more than that nothing was read
        _check_inputs(table, system, source)
    check_header(table, source)
    _check_inputs(table, system, source)
    si_units = _units(system)
    units = {each.name: each.unit for each in table.columns if each.name in si_units}
    scales = {name: factor(unit, si_units[name], f"{source}: column {name!r}") for name, unit in units.items()}
    scales |= _references(table, system, source)
    base = _time_base(table, source)
    notes = [*table.notes, *base.notes]
    columns = {name: column(table, name, base.rows, scale, source, notes) for name, scale in scales.items()}
    notes += _corrected(base.time, columns, system)
    complete = np.ones(len(base.time), dtype=bool)
    for part in system.inputs_to_record(table.names):
        columns[part.name] = _bridged_input(part.name, base.time, columns[part.name], source, notes)
        complete &= np.isfinite(columns[part.name])
    if complete.sum() < 2:
        raise InputError(source, "has fewer than two rows in which every input has a value", "record them together")
    time = base.time[complete]
    channels = {name: values[complete] for name, values in columns.items()}
    notes += check_seconds(time, channels, system, source, table["time"].unit)
    check_columns(time, channels, system, source)
    check_pedals(system, time, channels, source)
    notes += standstill_notes(channels, system)
    for name in dict.fromkeys([*(sensor.name for sensor in system.sensors), *_references(table, system)]):
        if name in channels:
            _note_missing_sensor(name, time, channels, notes)
    notes += _unused_notes(table, system)
    return Recording(time, channels, tuple(notes), source, units)


def read_signals(path: Path, names: Collection[str], channels: Mapping[str, Channel] | None = None) -> Recording:
    """Read signals of any dimension by name, complete, in SI.

    Names that the file does not have are left out. A column without a unit is taken to be in SI.

    Parameters
    ----------
    channels : mapping of str to Channel, optional
        What the signals are called in the file. Where the file has the name itself and not that channel, it is used.

    Raises
    ------
    InputError
        As :func:`read_recording`; and if a gap in a signal is too long to bridge.
    """
    source = str(path)
    wanted = ChannelFile({name: own for name, own in (channels or {}).items() if name in names or name == "time"})
    if isinstance(channels, ChannelFile):
        wanted.header, wanted.sampling_rate = channels.header, channels.sampling_rate
    table = read_columns(path, {*names_in_file(names, wanted), *names, "time"}, wanted)
    present = {name: channel for name, channel in wanted.items() if channel.name in table or name not in table}
    table = renamed(table, present, source) if present else table
    check_header(table, source)
    base = _time_base(table, source)
    notes = [*table.notes, *base.notes]
    values, units = {}, {}
    for name, unit in ((each.name, each.unit) for each in table.columns):
        if name in names:
            scale = signal_unit(unit, f"{source}: column {name!r}").scale if unit else 1.0
            signal = column(table, name, base.rows, scale, source, notes)
            signal, _, more = corrected_wraps(name, signal, angle=False)
            notes += more
            values[name] = _bridged_signal(name, base.time, signal, source, notes)
            units[name] = unit
    return Recording(base.time, values, tuple(notes), source, units)


def _corrected(time: np.ndarray, columns: dict[str, np.ndarray], system: System) -> list[str]:
    """Correct in place what loggers do to channels (t,) in SI, and say so."""
    notes: list[str] = []
    inputs = {part.name for part in system.inputs}
    for name, unit in _units(system).items():
        if name not in columns:
            continue
        columns[name], period, more = corrected_wraps(name, columns[name], angle=unit == "rad")
        if unit == "rad" and not more:
            more = jumps_note(name, columns[name])
        if unit == "rad/s":
            more += magnitude_note(name, columns[name])
        if period:
            _shift_by_turns(name, period, columns, system)
        notes += more
        columns[name], every = held_rows(columns[name], input_torque=name in inputs)
        if every:
            notes.append(f"{fault('held', name, size=str(every)).sentence}: it is taken as sampled slower")
        notes += far_beyond_note(name, time, columns[name])
    return notes


def _shift_by_turns(name: str, period: float, columns: dict[str, np.ndarray], system: System) -> None:
    """Shift an angle that was unwrapped by whole periods: near another angle of the drivetrain, else near 0."""
    of = {sensor.name: sensor.of for sensor in system.sensors if sensor.measures == "angle"}
    values = columns[name]
    if name not in of:
        return
    near = 0.0
    first = int(np.argmax(np.isfinite(values)))
    for other, place in of.items():
        if other == name:
            break
        ratio = speed_ratios(of[name], joints(system)).get(place)
        if other in columns and ratio and np.isfinite(columns[other][first]):
            near = float(columns[other][first]) / ratio
            break
    columns[name] = values - period * round((float(values[first]) - near) / period)


def _units(system: System) -> dict[str, str]:
    """SI units of the channels of a system by name."""
    return system.input_units | {part.name: part.unit for part in system.sensors}


def _references(table: Table, system: System, source: str = "") -> dict[str, float]:
    """Signals of any dimension that were recorded, with the factor to SI: references of controllers, gears."""
    wanted = system.further_signals
    return {
        name: signal_unit(unit, f"{source}: column {name!r}").scale if unit else 1.0
        for name, unit in ((each.name, each.unit) for each in table.columns)
        if name in wanted
    }


def _time_base(table: Table, source: str) -> TimeBase:
    scale = factor(table["time"].unit, "s", f"{source}: column 'time'")
    return time_base(without_overrange(table["time"].values)[0] * scale, table, source)


def _check_inputs(table: Table, system: System, source: str) -> None:
    """Raise ``InputError`` for an input that was not recorded, with the most similar column."""
    known = _units(system)
    columns = [name for name in (*table.names, *table.others) if name != "time"]
    for part in system.inputs_to_record(table.names):
        if part.name in table.others and part.name not in table:
            raise InputError(f"{source}: column {part.name!r}", "holds no numbers", "write it as numbers")
        if part.name not in table.names:
            unused = [name for name in columns if name not in known]
            hint = unknown(part.name, unused or list(columns), source).right
            for box in system.gearboxes:
                if part.name in box.capacities:
                    hint += f"; for a diagnosis a channel {box.name!r} with the number of the gear does as well"
            raise InputError(
                source, f"input {part.name!r} was not recorded",
                f"{hint}; a channel file (--channels) maps names, and says by leaving a torque out that it was zero",
            )  # fmt: skip


def _check_any_value(name: str, values: np.ndarray, source: str) -> None:
    if not np.isfinite(values).any():
        raise InputError(f"{source}: column {name!r}", "has no value", "it must be recorded")


def _bridged_input(name: str, time: np.ndarray, values: np.ndarray, source: str, notes: list[str]) -> np.ndarray:
    """An input (t,) with short gaps bridged; NaN where rows have to be left out."""
    if np.isfinite(values).all():
        return values
    _check_any_value(name, values, source)
    filled = bridged(time, values)
    left = int(np.isnan(filled).sum())
    own, longest = own_interval(time, values), bridge_of(time, values)
    if own > longest_bridge(time):
        lost = f", {left} rows left out" if left else ""
        notes.append(
            f"{name} is sampled slower: one value in {own:g} s; straight lines between them{lost}, and nothing above "
            f"{0.5 / own:.3g} Hz is known of it"
        )
        return filled
    treatment = "bridged by straight lines"
    if left:
        treatment = f"bridged by straight lines up to {longest:g} s, {left} rows left out"
    notes.append(missing_note(name, time, values, treatment))
    return filled


def _bridged_signal(name: str, time: np.ndarray, values: np.ndarray, source: str, notes: list[str]) -> np.ndarray:
    """A signal (t,) with short gaps bridged and the nearest value at its ends."""
    if np.isfinite(values).all():
        return values
    _check_any_value(name, values, source)
    known = np.flatnonzero(np.isfinite(values))
    longest, first = bridge_of(time, values), time[np.argmin(np.isfinite(values))]
    missing = max(float(np.diff(time[known]).max(initial=0.0)), time[known[0]] - time[0], time[-1] - time[known[-1]])
    if missing > longest:
        raise InputError(
            f"{source}: column {name!r}",
            fault("dropouts", name, f"at {first:g} s", size=f"{missing:g} s of values").words,
            f"it may lack {longest:g} s at a time: cut the recording",
        )
    notes.append(missing_note(name, time, values, "bridged by straight lines"))
    return np.interp(time, time[known], values[known])


def _note_missing_sensor(name: str, time: np.ndarray, channels: dict[str, np.ndarray], notes: list[str]) -> None:
    """Note missing values of a sensor; a sensor without any value is taken out of the channels."""
    missing = ~np.isfinite(channels[name])
    if missing.all():
        notes.append(f"{name} has no value and is unused")
        del channels[name]
    elif every := rows_a_value(channels[name]):
        notes.append(f"{name} is sampled slower: one value in {every} rows; it is compared where it has one")
    elif missing.any():
        notes.append(missing_note(name, time, channels[name], "left out"))


def _unused_notes(table: Table, system: System) -> list[str]:
    """Notes of columns that the model does not have, and of sensors that may be among them."""
    known = {*_units(system), *system.further_signals}
    unused = [name for name in (*table.names, *table.others) if name not in known and name != "time"]
    notes = [
        f"{name} is unused: its column holds no numbers" for name in table.others if name in known and name not in table
    ]
    if not unused:
        return notes
    notes.append(f"not in the model, unused: {listed(unused)}")
    for sensor in system.sensors:
        similar = get_close_matches(sensor.name, unused, n=1, cutoff=0.75)
        if sensor.name not in table.names and similar:
            notes.append(f"{sensor.name!r} was not recorded; is it column {similar[0]!r}? A channel file can say so")
    return notes


# --- Writing a recording as CSV.


def csv_text(time: np.ndarray, columns: Mapping[str, np.ndarray], units: Mapping[str, str]) -> str:
    """Text of a CSV recording: ``time [s]``, then ``name [unit]``; nine digits, of time twelve.

    Parameters
    ----------
    time : ndarray (t,)
    columns : mapping of str to ndarray (t,)
    units : mapping of str to str
        By column.
    """
    text = io.StringIO()
    header = ",".join(["time [s]", *(f"{name} [{units[name]}]" for name in columns)])
    formats = ["%.12g", *["%.9g"] * len(columns)]  # twelve: milliseconds of an absolute time stay apart
    np.savetxt(text, np.column_stack([time, *columns.values()]), formats, ",", header=header, comments="")
    return text.getvalue()
