"""From a measurement file to a recording: of the channels of a model, or of signals of any kind."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from difflib import get_close_matches
from pathlib import Path

import numpy as np

from modelling.common.errors import InputError, listed, unknown
from modelling.measurement.channels import Channel, groups_in_file, names_in_file, renamed
from modelling.measurement.columns import check_header, column
from modelling.measurement.gaps import bridged, longest_bridge, missing_note, rows_a_value
from modelling.measurement.readers import read_table
from modelling.measurement.readers.table import Table
from modelling.measurement.recording import Recording
from modelling.measurement.time_base import TimeBase, time_base
from modelling.measurement.time_unit import check_seconds
from modelling.model.system import System
from modelling.units import factor, signal_unit


def read_recording(path: str | Path, system: System, channels: Mapping[str, Channel] | None = None) -> Recording:
    """Read the channels of a system from a file.

    Every input of the system must be there. Sensors that are missing are unused, as are columns that the system does
    not have. Gaps are treated as :mod:`modelling.measurement.gaps` says.

    Parameters
    ----------
    path : path
        CSV, MDF, ``.mat`` or Parquet.
    system : System
    channels : mapping of str to Channel, optional
        What the channels are called in the file, where that differs; see
        :func:`modelling.measurement.channels.read_channels`.

    Raises
    ------
    InputError
        One line that names file, line or column: no header, no time, text among numbers, unknown unit, missing input,
        time that does not rise, too few rows.
    """
    source = str(path)
    names = [*_units(system), *system.input_references]
    table = read_table(path, names_in_file(names, channels), groups_in_file(channels))
    return recording_from_table(renamed(table, channels, source) if channels else table, system, source)


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
    units = {name: unit for name, unit in zip(table.names, table.units, strict=True) if name in si_units}
    scales = {name: factor(unit, si_units[name], f"{source}: column {name!r}") for name, unit in units.items()}
    scales |= _references(table, system, source)
    base = _time_base(table, source)
    columns = {name: column(table, name, base.rows, scale, source) for name, scale in scales.items()}
    notes = [*table.notes, *base.notes]
    complete = np.ones(len(base.time), dtype=bool)
    for part in system.inputs:
        columns[part.name] = _bridged_input(part.name, base.time, columns[part.name], source, notes)
        complete &= np.isfinite(columns[part.name])
    if complete.sum() < 2:
        raise InputError(source, "has fewer than two rows in which every input has a value", "record them together")
    time = base.time[complete]
    channels = {name: values[complete] for name, values in columns.items()}
    if not table.units[0]:
        check_seconds(time, channels, system, source)
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
    wanted = {name: channel for name, channel in (channels or {}).items() if name in names or name == "time"}
    table = read_table(path, {*names_in_file(names, wanted), *names, "time"}, groups_in_file(wanted))
    wanted = {
        name: channel for name, channel in wanted.items() if channel.name in table.names or name not in table.names
    }
    table = renamed(table, wanted, source) if wanted else table
    check_header(table, source)
    base = _time_base(table, source)
    notes = [*table.notes, *base.notes]
    values, units = {}, {}
    for name, unit in zip(table.names, table.units, strict=True):
        if name in names:
            scale = signal_unit(unit, f"{source}: column {name!r}").scale if unit else 1.0
            signal = column(table, name, base.rows, scale, source)
            values[name] = _bridged_signal(name, base.time, signal, source, notes)
            units[name] = unit
    return Recording(base.time, values, tuple(notes), source, units)


def _units(system: System) -> dict[str, str]:
    """SI units of the channels of a system by name."""
    return system.input_units | {part.name: part.unit for part in system.sensors}


def _references(table: Table, system: System, source: str = "") -> dict[str, float]:
    """References of controllers that were recorded, with the factor to SI: signals of any dimension."""
    wanted = system.input_references
    return {
        name: signal_unit(unit, f"{source}: column {name!r}").scale if unit else 1.0
        for name, unit in zip(table.names, table.units, strict=True)
        if name in wanted
    }


def _time_base(table: Table, source: str) -> TimeBase:
    scale = factor(table.units[0], "s", f"{source}: column 'time'")
    return time_base(table.values[:, 0] * scale, table, source)


def _check_inputs(table: Table, system: System, source: str) -> None:
    """Raise ``InputError`` for an input that was not recorded, with the most similar column."""
    known = _units(system)
    columns = (*table.names[1:], *table.others)
    for part in system.inputs:
        if part.name not in table.names:
            unused = [name for name in columns if name not in known]
            hint = unknown(part.name, unused or list(columns), source).right
            raise InputError(
                source, f"input {part.name!r} was not recorded", f"{hint}; a channel file (--channels) maps names"
            )


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
    treatment = "bridged by straight lines"
    if left:
        treatment = f"bridged by straight lines up to {longest_bridge(time):g} s, {left} rows left out"
    notes.append(missing_note(name, time, values, treatment))
    return filled


def _bridged_signal(name: str, time: np.ndarray, values: np.ndarray, source: str, notes: list[str]) -> np.ndarray:
    """A signal (t,) with short gaps bridged and the nearest value at its ends."""
    if np.isfinite(values).all():
        return values
    _check_any_value(name, values, source)
    known = np.flatnonzero(np.isfinite(values))
    longest, first = longest_bridge(time), time[np.argmin(np.isfinite(values))]
    missing = max(float(np.diff(time[known]).max(initial=0.0)), time[known[0]] - time[0], time[-1] - time[known[-1]])
    if missing > longest:
        raise InputError(
            f"{source}: column {name!r}",
            f"{missing:g} s of values are missing, first at {first:g} s",
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
    known = {*_units(system), *system.input_references}
    unused = [name for name in (*table.names[1:], *table.others) if name not in known]
    if not unused:
        return []
    notes = [f"not in the model, unused: {listed(unused)}"]
    for sensor in system.sensors:
        similar = get_close_matches(sensor.name, unused, n=1, cutoff=0.75)
        if sensor.name not in table.names and similar:
            notes.append(f"{sensor.name!r} was not recorded; is it column {similar[0]!r}? A channel file can say so")
    return notes
