"""Two recordings of one manoeuvre, reference and test, in any format that is read."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from modelling.common.errors import InputError
from modelling.common.tables import check_keys, text
from modelling.fidelity.assess import check_time
from modelling.measurement.channels import Channel, called, read_channels, renamed
from modelling.measurement.readers import read_table
from modelling.measurement.recording import GAP, bridged, columns_of
from modelling.units import Unit, signal_unit

KEYS = ("reference", "test", "reference_channels", "test_channels")
UNEVEN = 0.01  # of a step: from there on a recording is brought to even steps


@dataclass(frozen=True)
class Recording:
    """Columns ``(t,)`` in SI by name, with their units, and what was mended."""

    path: str
    time: np.ndarray
    columns: dict[str, tuple[np.ndarray, Unit]]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Recordings:
    """Reference and test at the same step (s); both begin at the same event of the manoeuvre."""

    reference: Recording
    test: Recording
    step: float

    def pair(self, reference: str, test: str, where: str) -> tuple[np.ndarray, np.ndarray, Unit]:
        """Both signals in SI and the reference's unit."""
        found = []
        for name, recording in ((reference, self.reference), (test, self.test)):
            if name not in recording.columns:
                raise InputError(
                    where,
                    f"{recording.path} has no column '{name}'",
                    f"choose {', '.join(recording.columns) or 'another file'}",
                )
            found.append(recording.columns[name])
        (first, unit), (second, other) = found
        if None not in (unit.dimension, other.dimension) and unit.dimension != other.dimension:
            raise InputError(
                where, f"reference is in {unit.text}, test in {other.text}", "give both the same dimension"
            )
        return first, second, unit


def read_recordings(
    table: Any, path: Path, used: Collection[str], channels: Mapping[str, Channel] | None = None
) -> Recordings:
    """The two recordings a case names, beside the case file.

    Parameters
    ----------
    used : collection of str
        Columns that the case compares.
    channels : mapping of str to Channel, optional
        What channels are called in both files; channel files that the case names for either come before it.

    Raises
    ------
    InputError
        Where a recording cannot be read, or the two do not fit together.
    """
    where = f"{path}: recordings"
    check_keys(table, KEYS, where)
    found = []
    for kind in ("reference", "test"):
        key = f"{kind}_channels"
        own = read_channels(path.parent / text(table, key, where)) if key in table else channels
        found.append(read_recording(path.parent / text(table, kind, where), used, own))
    reference, test = found
    steps = [check_time(one.time, f"{one.path}: time") for one in found]
    if len(reference.time) != len(test.time):
        raise InputError(
            where,
            f"reference has {len(reference.time)} samples, test {len(test.time)}",
            "cut or resample both to the same length",
        )
    if abs(steps[0] - steps[1]) > 1e-4 * steps[0]:
        raise InputError(where, f"reference has a step of {steps[0]:g} s, test of {steps[1]:g} s", "resample one")
    return Recordings(reference, test, steps[0])


def read_recording(path: Path, used: Collection[str], channels: Mapping[str, Channel] | None = None) -> Recording:
    """One recording: the columns ``used`` in SI, complete and at even steps.

    Short gaps and uneven time stamps are bridged by straight lines, and noted.

    Raises
    ------
    InputError
        One line with the file and the line, column or channel.
    """
    known = {name: own for name, own in (channels or {}).items() if name in used or name == "time"}
    table = read_table(path, called(used, known))
    there = {head.partition("[")[0].strip() for head in table.header}
    known = {name: own for name, own in known.items() if own.name in there or name not in there}  # called so already
    table = renamed(table, known, str(path)) if known else table
    names, units = columns_of(table.header, str(path))
    if names[0] != "time":
        raise InputError(f"{path}: line 1", f"the first column is {names[0]!r}", "it must be 'time [s]'")
    if len(table.values) < 2:
        raise InputError(str(path), "has fewer than two rows of values", "give a header row and samples")
    notes = [f"{path.name}: {note}" for note in table.notes]
    time = signal_unit(units[0] or "s", f"{path}: column 'time'").value_to_si(table.values[:, 0])
    if not np.isfinite(time).all():
        place = table.place(int(np.argmin(np.isfinite(time))))
        raise InputError(f"{path}: {place}", "time is missing or not finite", "every row needs its time")
    told: list[str] = []
    columns = {}
    for name, unit_text in zip(names, units, strict=True):
        if name not in used:
            continue
        column = table.values[:, names.index(name)]
        if np.isinf(column).any():
            place = table.place(int(np.argmax(np.isinf(column))))
            raise InputError(f"{path}: {place}", f"{name!r} is infinite", "write a finite number or leave it empty")
        # a column without unit is in SI, of whatever dimension
        unit = signal_unit(unit_text, f"{path}: column {name!r}") if unit_text else Unit("SI", 1.0, 0.0, None)
        columns[name] = unit.value_to_si(bridged(name, column, time, str(path), told)), unit
    even = _even(time)
    if even is not time:
        told.append("time stamps are uneven: brought to equal steps, linear between samples")
        columns = {name: (np.interp(even, time, value), unit) for name, (value, unit) in columns.items()}
    return Recording(str(path), even, columns, (*notes, *(f"{path.name}: {note}" for note in told)))


def _even(time: np.ndarray) -> np.ndarray:
    """As many equal steps through the stamps (least squares) where they only jitter; otherwise the time itself."""
    steps = np.diff(time)
    step = (time[-1] - time[0]) / (len(time) - 1)
    if (steps > 0).all() and UNEVEN * step < np.abs(steps - step).max() and steps.max() < GAP * np.median(steps):
        number = np.arange(len(time))
        return np.polyval(np.polyfit(number, time, 1), number)
    return time
