"""Parquet: columns named ``name [unit]``, or a ``unit`` in the field's metadata."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import numpy as np

from modelling.errors import InputError
from modelling.readers import Table


def read(path: Path, used: Collection[str] | None = None) -> Table:
    """Read a Parquet file.

    Raises
    ------
    InputError
        If it is no Parquet file or a column holds no numbers.
    """
    import pyarrow
    import pyarrow.parquet

    try:
        table = pyarrow.parquet.read_table(path)
    except pyarrow.ArrowInvalid as fault:
        raise InputError(str(path), f"is no Parquet file: {fault}", "write it as Parquet") from None
    header, columns = [], []
    for field, column in zip(table.schema, table.columns, strict=True):
        if not (pyarrow.types.is_integer(field.type) or pyarrow.types.is_floating(field.type)):
            if field.name.split(" [")[0] == "time":
                raise InputError(str(path), f"column {field.name!r} holds {field.type}", "write time as seconds")
            continue  # e.g. a comment; a channel of the model that is missing is told later
        unit = (field.metadata or {}).get(b"unit", b"").decode(errors="replace")
        header.append(f"{field.name} [{unit}]" if unit and "[" not in field.name else field.name)
        columns.append(column.to_numpy().astype(float))
    return Table(header, np.stack(columns, axis=1) if columns else np.empty((0, 0)))
