"""The time base of a recording: which rows count, and when they were sampled."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from modelling.common.errors import InputError
from modelling.measurement.gaps import GAP_STEPS, longest_bridge
from modelling.measurement.readers.table import Table

ON_GRID = 0.01  # of a step: time stamps that deviate less from a regular grid are put on it
JITTER = 0.5  # of a step: time stamps that deviate more do not jitter about a regular grid
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
    """Times (t,) on a regular grid where they are near one, and notes of gaps, jitter and uneven steps."""
    step = np.diff(time)
    usual = float(np.median(step))
    notes = gap_notes(time)
    if notes:
        return time, notes
    if np.abs(step - np.rint(step / usual) * usual).max() < JITTER * usual:
        grid = time[0] + np.arange(len(time)) * (time[-1] - time[0]) / (len(time) - 1)
        deviation = float(np.abs(time - grid).max())
        if deviation <= ON_GRID * usual:
            return grid, []
        if np.abs(step / usual - 1).max() < JITTER:
            return time, [f"time stamps jitter by up to {deviation * 1e3:.3g} ms about steps of {usual * 1e3:g} ms"]
    return time, [f"uneven time steps, {step.min():g} to {step.max():g} s"]


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
