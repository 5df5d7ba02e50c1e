"""Two recordings of one manoeuvre, reference and test: CSV with ``time [s]`` first, then ``name [unit]``."""

from __future__ import annotations

import csv
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from matching.validity.tables import check_keys, text
from matching.validity.units import Unit, signal_unit
from modelling.errors import InputError
from modelling.fidelity.assess import check_time

_HEADER = re.compile(r"\s*([^\[\]]+?)\s*(?:\[([^\]]*)\])?\s*")


@dataclass(frozen=True)
class Recording:
    """Columns ``(t,)`` in SI by name, with their units."""

    path: str
    time: np.ndarray
    columns: dict[str, tuple[np.ndarray, Unit]]


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


def read_recordings(table: Any, path: Path) -> Recordings:
    """The two recordings a case names, beside the case file; raises ``InputError`` where they do not fit together."""
    where = f"{path}: recordings"
    check_keys(table, ("reference", "test"), where)
    reference, test = (read_recording(path.parent / text(table, kind, where)) for kind in ("reference", "test"))
    steps = [check_time(one.time, f"{one.path}: time") for one in (reference, test)]
    if len(reference.time) != len(test.time):
        raise InputError(
            where,
            f"reference has {len(reference.time)} samples, test {len(test.time)}",
            "cut or resample both to the same length",
        )
    if abs(steps[0] - steps[1]) > 1e-4 * steps[0]:
        raise InputError(where, f"reference has a step of {steps[0]:g} s, test of {steps[1]:g} s", "resample one")
    return Recordings(reference, test, steps[0])


def read_recording(path: Path) -> Recording:
    """One CSV recording; raises ``InputError`` with the line where a value is no finite number."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = [row for row in csv.reader(file) if row]
    except FileNotFoundError as error:
        raise InputError(str(path), "no such file", "give the path of a CSV recording") from error
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(str(path), f"cannot be read: {error}", "give a CSV recording") from error
    if len(rows) < 3:
        raise InputError(str(path), "has fewer than two rows of values", "give a header row and samples")
    names, units = zip(*(_column(head, f"{path}: line 1") for head in rows[0]), strict=True)
    if names[0] != "time" or len(set(names)) < len(names):
        raise InputError(
            f"{path}: line 1", "must name time first and no column twice", "write time [s], name [unit], ..."
        )
    table = np.array([_numbers(row, len(names), f"{path}: line {line}") for line, row in enumerate(rows[1:], start=2)])
    columns = {
        name: (unit.value_to_si(table[:, i]), unit) for i, (name, unit) in enumerate(zip(names, units, strict=True))
    }
    time, _ = columns.pop("time")
    return Recording(str(path), time, columns)


def _column(head: str, where: str) -> tuple[str, Unit]:
    match = _HEADER.fullmatch(head)
    if not match:
        raise InputError(where, f"'{head}' is no column header", "write name [unit]")
    if match[2] is None:  # a column without unit is in SI, of whatever dimension
        return match[1], Unit("SI", 1.0, 0.0, None)
    return match[1], signal_unit(match[2], where)


def _numbers(row: list[str], count: int, where: str) -> list[float]:
    if len(row) != count:
        raise InputError(where, f"has {len(row)} values, the header {count}", "give one value a column")
    values = []
    for cell in row:
        try:
            values.append(float(cell))
        except ValueError as error:
            raise InputError(where, f"'{cell[:40]}' is no number", "write numbers with a decimal point") from error
        if not math.isfinite(values[-1]):
            raise InputError(where, f"'{cell}' is not finite", "remove or fill the gap")
    return values
