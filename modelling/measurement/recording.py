"""Recordings: channels in SI on one time base, with notes of what was not as it should be."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from pathlib import Path

import numpy as np

from modelling.common.errors import InputError, listed, unknown
from modelling.measurement.channels import Channel, called, renamed
from modelling.measurement.readers import Table, name_time, read_table
from modelling.model.system import System
from modelling.units import factor

_COLUMN = re.compile(r"\s*(.*?)\s*(?:\[([^\[\]]*)\])?\s*", re.DOTALL)
LONGEST_FILL = 0.1  # s of missing input that are bridged
EVEN = 0.01  # of a sample: time stamps that near to a grid are on it
GAP = 1.6  # samples


@dataclass(frozen=True)
class Recording:
    """What was measured.

    Attributes
    ----------
    time : ndarray (t,)
        s, rising.
    channels : dict of str to ndarray (t,)
        Inputs and sensors of the model that were recorded, SI. Inputs are complete; a sensor is NaN where a value is
        missing.
    notes : tuple of str
        What was mended or is odd, in words.
    source : str
        The file.
    """

    time: np.ndarray
    channels: dict[str, np.ndarray] = field(repr=False)
    notes: tuple[str, ...] = ()
    source: str = ""

    def __getitem__(self, name: str) -> np.ndarray:
        """A channel, (t,)."""
        return self.channels[name]

    def inputs(self, system: System) -> np.ndarray:
        """Inputs (t, u) in the order of the system, N·m."""
        columns = [self.channels[part.name] for part in system.inputs]
        return np.stack(columns, axis=1) if columns else np.empty((len(self.time), 0))

    def sensors(self, system: System) -> list[str]:
        """Names of the system's sensors that were recorded."""
        return [part.name for part in system.sensors if part.name in self.channels]

    def cut(self, begin: float, end: float) -> Recording:
        """The rows with begin ≤ time < end (s); time stamps stay.

        Raises
        ------
        InputError
            If fewer than two are left.
        """
        inside = (self.time >= begin) & (self.time < end)
        if inside.sum() < 2:
            raise InputError(
                self.source, f"has fewer than two rows from {begin:g} to {end:g} s", "choose a longer stretch"
            )
        return replace(
            self, time=self.time[inside], channels={name: value[inside] for name, value in self.channels.items()}
        )

    def resampled(self, rate: float | None = None) -> Recording:
        """On a regular grid of ``rate`` (Hz; that of the median step if not given), linear between samples.

        Nothing is filtered: a lower rate than recorded folds what lies above half of it. A value next to a missing one
        is missing.
        """
        step = 1 / rate if rate else float(np.median(np.diff(self.time)))
        time = self.time[0] + np.arange(int((self.time[-1] - self.time[0]) / step * (1 + 1e-12)) + 1) * step
        if len(time) == len(self.time) and np.allclose(time, self.time, rtol=0, atol=1e-9 * step):
            return self
        notes = [f"resampled to {1 / step:g} Hz, linear between samples"]
        if step > 1.01 * np.median(np.diff(self.time)):
            notes.append("resampled to a lower rate without a filter: what lies above half of it is folded")
        channels = {name: np.interp(time, self.time, value) for name, value in self.channels.items()}
        return replace(self, time=time, channels=channels, notes=(*self.notes, *notes))


def read_recording(path: str | Path, system: System, channels: Mapping[str, Channel] | None = None) -> Recording:
    """Read the channels of a system from a file.

    Every input of the system must be there; sensors that are missing are simply unused, as are columns that the system
    does not have. ``channels`` says what they are called in the file, where that differs.

    Raises
    ------
    InputError
        One line that names file, line or column: no header, no time, text among numbers, unknown unit, missing or
        incomplete input, time that does not rise, too few rows.
    """
    table = read_table(path, called(_names(system), channels))
    return from_table(renamed(table, channels, str(path)) if channels else table, system, str(path))


def _names(system: System) -> list[str]:
    return [*(part.name for part in system.inputs), *(part.name for part in system.sensors)]


def from_table(table: Table, system: System, source: str) -> Recording:
    """Check a table, convert to SI and mend what may be mended; see :func:`read_recording`."""
    names, units = columns_of(table.header, source)
    if names[0] != "time":
        raise InputError(f"{source}: line 1", f"the first column is {names[0]!r}, not 'time [s]'", name_time(names))
    wanted = {part.name: "N*m" for part in system.inputs} | {part.name: part.unit for part in system.sensors}
    for part in system.inputs:
        if part.name not in names:
            free = [name for name in (*names[1:], *table.others) if name not in wanted]
            wrong = unknown(part.name, free or names[1:], source)
            raise InputError(
                source,
                f"input {part.name!r} was not recorded",
                f"{wrong.right}; a channel file (--channels) maps names",
            )
    factors = {
        name: factor(unit, wanted.get(name, "s"), f"{source}: column {name!r}")
        for name, unit in zip(names, units, strict=True)
        if name in wanted or name == "time"
    }
    values = table.values
    if len(values) < 2:
        raise InputError(
            source, f"has {len(values)} row{'s' * (len(values) != 1)} of numbers", "at least two are needed"
        )
    notes = list(table.notes)
    rows, time = _time(values[:, 0] * factors["time"], table, source, notes)
    channels = {}
    for name, scale in factors.items():
        if name == "time":
            continue
        column = values[rows, names.index(name)] * scale
        if np.isinf(column).any():
            row = int(rows[np.argmax(np.isinf(column))])
            raise InputError(
                f"{source}: {table.place(row)}", f"{name!r} is infinite", "write a finite number or leave it empty"
            )
        kept = _mended(name, column, time, name in [part.name for part in system.inputs], source, notes)
        if kept is not None:
            channels[name] = kept
    unused = [name for name in (*names[1:], *table.others) if name not in wanted]
    if unused:
        notes.append(f"not in the model, unused: {listed(unused)}")
        for sensor in system.sensors:
            near = get_close_matches(sensor.name, unused, n=1, cutoff=0.75)
            if sensor.name not in names and near:
                notes.append(f"{sensor.name!r} was not recorded; is it column {near[0]!r}? A channel file can say so")
    return Recording(time, channels, tuple(notes), source)


def columns_of(header: list[str], source: str) -> tuple[list[str], list[str]]:
    """Names and units of a header's ``name [unit]``; a unit that is not given is empty.

    Raises
    ------
    InputError
        If a name is missing or stands twice.
    """
    matches = [_COLUMN.fullmatch(text) for text in header]
    names, units = [m[1] if m else "" for m in matches], [(m[2] or "") if m else "" for m in matches]
    for i, name in enumerate(names):
        if not name:
            raise InputError(f"{source}: line 1", f"column {i + 1} has no name", "write 'name [unit]'")
        if name in names[:i]:
            raise InputError(f"{source}: line 1", f"column {name!r} stands twice", "names must differ")
    if not names:
        raise InputError(source, "has no columns", "'time [s]' and the inputs are needed")
    return names, units


def _time(time: np.ndarray, table: Table, source: str, notes: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Rows to keep and their times: rising, on a grid where they are near to one."""
    if not np.isfinite(time).all():
        row = int(np.argmin(np.isfinite(time)))
        raise InputError(f"{source}: {table.place(row)}", "time is missing or not finite", "every row needs its time")
    step = np.diff(time)
    if (step < 0).any():
        row = int(np.argmax(step < 0)) + 1
        raise InputError(
            f"{source}: {table.place(row)}", f"time falls from {time[row - 1]:g} to {time[row]:g} s", "time must rise"
        )
    rows = np.flatnonzero(np.append(True, step > 0))
    if len(rows) < len(time):
        at = time[np.argmax(step == 0)]
        notes.append(
            f"{len(time) - len(rows)} time stamps stand twice, first at {at:g} s: the first row of each is kept"
        )
        time = time[rows]
    if len(time) < 2:
        raise InputError(source, "all rows have the same time", "time must rise")
    step = np.diff(time)
    usual = float(np.median(step))
    wide = step > GAP * usual
    if wide.any():
        where = ", ".join(f"{step[i]:g} s at {time[i]:g} s" for i in np.flatnonzero(wide)[:3])
        more = f" and {wide.sum() - 3} more" if wide.sum() > 3 else ""
        notes.append(f"gaps in time ({where}{more}): inputs vary linearly across them")
    whole = np.rint(step / usual)
    drift = np.abs(step - whole * usual).max()
    if not wide.any() and drift < 0.5 * usual:
        grid = time[0] + np.arange(len(time)) * (time[-1] - time[0]) / (len(time) - 1)
        off = float(np.abs(time - grid).max())
        if off <= EVEN * usual:
            return rows, grid
        if np.abs(step / usual - 1).max() < 0.5:
            notes.append(
                f"time stamps jitter by up to {off * 1e3:.3g} ms about steps of {usual * 1e3:g} ms; taken as they are"
            )
            return rows, time
    if not wide.any():
        notes.append(f"uneven time steps, {step.min():g} to {step.max():g} s; taken as they are")
    return rows, time


def _mended(
    name: str, column: np.ndarray, time: np.ndarray, is_input: bool, source: str, notes: list[str]
) -> np.ndarray | None:
    """A complete input, a sensor with its holes, or None for a sensor that has no value."""
    if is_input:
        return bridged(name, column, time, source, notes)
    there = np.isfinite(column)
    missing = len(column) - int(there.sum())
    if missing == len(column):
        notes.append(f"{name} has no value and is unused")
        return None
    if missing:
        notes.append(f"{name}: {missing} values missing, first at {time[np.argmin(there)]:g} s; left out")
    return column


def bridged(name: str, column: np.ndarray, time: np.ndarray, source: str, notes: list[str]) -> np.ndarray:
    """A column (t,) whose missing values are bridged by straight lines, which is noted.

    Raises
    ------
    InputError
        If it has no value, or ``LONGEST_FILL`` is missing at a time.
    """
    there = np.isfinite(column)
    missing = len(column) - int(there.sum())
    if not missing:
        return column
    if not there.any():
        raise InputError(f"{source}: column {name!r}", "has no value", "it must be recorded")
    first, known = time[np.argmin(there)], time[there]
    longest = max(float(np.diff(known).max(initial=0.0)), known[0] - time[0], time[-1] - known[-1])
    if longest > LONGEST_FILL + 2 * float(np.median(np.diff(time))):
        raise InputError(
            f"{source}: column {name!r}", f"{longest:g} s of values are missing, first at {first:g} s",
            f"it may lack {LONGEST_FILL:g} s at a time: cut the recording",
        )  # fmt: skip
    notes.append(f"{name}: {missing} values missing, first at {first:g} s; bridged by straight lines")
    return np.interp(time, known, column[there])


def csv_text(time: np.ndarray, columns: Mapping[str, np.ndarray], units: Mapping[str, str]) -> str:
    """Text of a CSV recording: ``time [s]``, then ``name [unit]``; nine digits.

    Parameters
    ----------
    time : ndarray (t,)
    columns : mapping of str to ndarray (t,)
    units : mapping of str to str
        By column.
    """
    text = io.StringIO()
    header = ",".join(["time [s]", *(f"{name} [{units[name]}]" for name in columns)])
    np.savetxt(text, np.column_stack([time, *columns.values()]), "%.9g", ",", header=header, comments="")
    return text.getvalue()
