"""Parquet: columns named ``name [unit]``, or a ``unit`` in the field's metadata; time may be a date or a duration."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import numpy as np

from modelling.common.errors import InputError, listed
from modelling.measurement.readers import Table, name_time

TICKS = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}  # a second


def read(path: Path, used: Collection[str] | None = None) -> Table:
    """Read a Parquet file.

    Raises
    ------
    InputError
        If it is no Parquet file, has no column of times, or that holds no numbers.
    """
    import pyarrow
    import pyarrow.parquet

    try:
        table = pyarrow.parquet.read_table(path)
    except pyarrow.ArrowInvalid as fault:
        raise InputError(str(path), f"is no Parquet file: {fault}", "write it as Parquet") from None
    header, columns = [], []
    time = "time" if used is None or "time" in used else ""
    for field, column in zip(table.schema, table.columns, strict=True):
        if pyarrow.types.is_duration(field.type) or pyarrow.types.is_timestamp(field.type):
            ticks = column.cast(pyarrow.int64()).to_numpy()
            header.append(f"{field.name} [s]")
            columns.append((ticks - ticks[:1]) / TICKS[field.type.unit])
            continue
        if not (pyarrow.types.is_integer(field.type) or pyarrow.types.is_floating(field.type)):
            if field.name.split(" [")[0] == "time":
                raise InputError(str(path), f"column {field.name!r} holds {field.type}", "write time as seconds")
            continue  # e.g. a comment; a channel of the model that is missing is told later
        unit = (field.metadata or {}).get(b"unit", b"").decode(errors="replace")
        header.append(f"{field.name} [{unit}]" if unit and "[" not in field.name else field.name)
        columns.append(column.to_numpy().astype(float))
    names = [text.split(" [")[0] for text in header]
    if time and time not in names:
        raise InputError(str(path), f"has no column 'time'; there are {listed(names)}", name_time(names))
    if time:  # an index is written last
        header.insert(0, header.pop(names.index(time)))
        columns.insert(0, columns.pop(names.index(time)))
    return Table(header, np.stack(columns, axis=1) if columns else np.empty((0, 0)))
