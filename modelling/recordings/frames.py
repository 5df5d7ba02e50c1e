"""A pandas DataFrame as a table of channels."""

from __future__ import annotations

from typing import Any

import numpy as np

from modelling.errors import InputError
from modelling.recordings.table import TIME_NAMES, Column, Table, name_and_unit


def is_frame(value: Any) -> bool:
    """Whether a value is a pandas DataFrame; pandas is not imported for it."""
    kind = type(value)
    return kind.__name__ == "DataFrame" and kind.__module__.partition(".")[0] == "pandas"


def table_of_frame(frame: Any) -> Table:
    """The columns that hold numbers, and the index as time where no column is called ``time``.

    Raises
    ------
    InputError
        If the frame has several levels of columns.
    """
    if getattr(frame.columns, "nlevels", 1) > 1:
        raise InputError("the DataFrame", "has several levels of columns", "give it one name a column")
    columns, others = [], []
    for position, header in enumerate(frame.columns):
        name, unit = name_and_unit(str(header))
        try:
            values, seconds = _numbers(frame.iloc[:, position])
        except (TypeError, ValueError):
            others.append(name)
            continue
        columns.append(Column(name, "s" if seconds else unit, values))
    if not any(column.name.strip().lower() in TIME_NAMES for column in columns):
        columns.insert(0, _index(frame.index))
    return Table(tuple(columns), others=tuple(others))


def _index(index: Any) -> Column:
    """The index as a column; as time if it is one, or decimal numbers without a name, which count no rows."""
    values, seconds = _numbers(index.to_series())
    name, unit = name_and_unit(str(index.name)) if index.name is not None else ("", "")
    is_time = seconds or (not name and index.dtype.kind == "f")
    return Column("time" if is_time else name or "row", "s" if is_time else unit, values)


def _numbers(series: Any) -> tuple[np.ndarray, bool]:
    """Values (t,) of a column, and whether it held durations or dates, which are in s from the first."""
    if series.dtype.kind in "mM":
        ticks = series.to_numpy(f"{'timedelta' if series.dtype.kind == 'm' else 'datetime'}64[ns]").astype("int64")
        first = ticks[0] if series.dtype.kind == "M" and len(ticks) else 0
        return (ticks - first) * 1e-9, True
    return np.asarray(series.to_numpy(dtype=float, na_value=np.nan)), False
