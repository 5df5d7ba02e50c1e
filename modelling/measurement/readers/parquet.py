"""Parquet: columns named ``name [unit]``, or a ``unit`` in the field's metadata; time may be a date or a duration."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import numpy as np

from modelling.common.errors import InputError
from modelling.measurement.readers.table import Table, name_and_unit

TICKS_PER_SECOND = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}


def is_foreign(_: Path) -> bool:
    """Always: pyarrow."""
    return True


def read(path: Path, used: Collection[str] | None = None) -> Table:
    """Read a Parquet file.

    Raises
    ------
    InputError
        If it is no Parquet file, or ``time`` holds no numbers.
    """
    import pyarrow
    import pyarrow.parquet

    try:
        fields = pyarrow.parquet.read_schema(path).names
        wanted = [name for name in fields if used is None or name_and_unit(name)[0] in used]
        table = pyarrow.parquet.read_table(path, columns=wanted)
    except MemoryError:
        raise
    except (pyarrow.ArrowException, ValueError, OSError) as fault:
        if isinstance(fault, OSError) and fault.strerror:
            raise
        raise InputError(str(path), f"is no Parquet file: {fault}", "write it as Parquet") from None
    names: list[str] = []
    units: list[str] = []
    columns = []
    for field, values in zip(table.schema, table.columns, strict=True):
        name, unit = name_and_unit(field.name)
        if pyarrow.types.is_duration(field.type) or pyarrow.types.is_timestamp(field.type):
            ticks = values.cast(pyarrow.int64()).to_numpy()
            values, unit = (ticks - ticks[:1]) / TICKS_PER_SECOND[field.type.unit], "s"
        elif pyarrow.types.is_integer(field.type) or pyarrow.types.is_floating(field.type):
            unit = unit or (field.metadata or {}).get(b"unit", b"").decode(errors="replace")
            values = values.to_numpy().astype(float)
        elif name == "time":
            raise InputError(str(path), f"column {field.name!r} holds {field.type}", "write time as seconds")
        else:
            continue  # e.g. a comment; a channel of the model that is missing is reported later
        names.append(name)
        units.append(unit)
        columns.append(values)
    if "time" in names:
        for texts in (names, units, columns):  # an index is written last
            texts.insert(0, texts.pop(names.index("time")))
    others = tuple(name for name in (name_and_unit(field)[0] for field in fields) if name not in names)
    return Table(names, units, np.stack(columns, axis=1) if columns else np.empty((0, 0)), others=others)
