"""Columns of a file: found by name, converted to SI."""

from __future__ import annotations

import numpy as np

from modelling.common.errors import InputError, listed
from modelling.measurement.readers.table import Table, time_hint
from modelling.units.quantities import LARGEST


def check_header(table: Table, source: str) -> None:
    """Check that the first column is time, that names differ, and that there are rows.

    Raises
    ------
    InputError
        Otherwise.
    """
    columns = (*table.names, *table.others)
    if not columns:
        raise InputError(source, "has no columns", "'time [s]' and the inputs are needed")
    if "time" not in table.names:
        raise InputError(source, f"has no column 'time'; there are {listed(list(columns))}", time_hint(columns))
    if table.names[0] != "time":
        raise InputError(f"{source}: line 1", f"the first column is {columns[0]!r}", "it must be 'time [s]'")
    for i, name in enumerate(table.names):
        if name in table.names[:i]:
            raise InputError(f"{source}: line 1", f"column {name!r} is there twice", "names must differ")
    if len(table.values) < 2:
        rows = len(table.values)
        if table.others and len(table.names) == 1:
            there = f"has none of the channels that are asked for; there are {listed(list(table.others))}"
            raise InputError(source, there, "a channel file (--channels) maps names")
        raise InputError(source, f"has {rows} row{'s' * (rows != 1)} of numbers", "at least two are needed")


def column(table: Table, name: str, rows: np.ndarray, scale: float, source: str) -> np.ndarray:
    """Values (t,) of a column in the rows (t,), times ``scale``; NaN where missing.

    Raises
    ------
    InputError
        If a value is infinite, or larger than any quantity.
    """
    with np.errstate(over="ignore"):
        values = table.values[rows, table.names.index(name)] * scale
    if np.isinf(values).any():
        row = int(rows[np.argmax(np.isinf(values))])
        raise InputError(
            f"{source}: {table.place(row)}", f"{name!r} is infinite", "write a finite number or leave it empty"
        )
    if (np.abs(values) > LARGEST).any():
        row = int(rows[np.nanargmax(np.abs(values))])
        wrong = f"{name!r} is {table.values[row, table.names.index(name)]:g}"
        raise InputError(f"{source}: {table.place(row)}", wrong, f"at most {LARGEST:g} (SI) is read: leave it empty")
    return values
