"""What a measurement file holds: its channels in a table, and a channel file that fits a model."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from matching.explore.signals.suggestions import channel_file, suggestions, time_column
from modelling.measurement.readers import read_table
from modelling.measurement.readers.table import Table, time_hint
from modelling.model.system import System


def channel_list(path: str | Path, system: System | None = None) -> dict[str, Any]:
    """Channels of a measurement file as they stand there, in the file's names and units.

    Parameters
    ----------
    path : path
        CSV, MDF, ``.mat`` or Parquet.
    system : System, optional
        A model for which a channel file is suggested.

    Returns
    -------
    dict
        ``channels``: name, unit, samples, from, to (as time stands in the file), least and largest of each; ``notes``
        of the reader; ``channel_file``: its text, empty without a model.

    Raises
    ------
    InputError
        If the file cannot be read.
    """
    table = read_table(path)
    time = time_column(table.names)
    notes = list(table.notes)
    if not time:
        notes.append(f"no channel is called time: {time_hint(table.names)}")
    stamps = table.values[:, table.names.index(time)] if time else np.arange(len(table.values), dtype=float)
    channels = [_channel(table, index, stamps) for index in range(len(table.names))]
    suggested = ""
    if system is not None:
        columns = {name: unit for name, unit in zip(table.names, table.units, strict=True) if name != time}
        chosen = {name: (found.column, found.unit) for name, found in suggestions(system, columns).items()}
        suggested = channel_file(chosen, time or "NAME")
    return {"channels": channels, "notes": notes, "channel_file": suggested}


def _channel(table: Table, index: int, stamps: np.ndarray) -> dict[str, Any]:
    values = table.values[:, index]
    there = np.isfinite(values)
    found: dict[str, Any] = {"name": table.names[index], "unit": table.units[index], "samples": int(there.sum())}
    if not there.any():
        return found | dict.fromkeys(("from", "to", "least", "largest"))
    recorded = stamps[there & np.isfinite(stamps)]
    ends = (float(recorded[0]), float(recorded[-1])) if len(recorded) else (None, None)
    return found | {
        "from": ends[0], "to": ends[1], "least": float(values[there].min()), "largest": float(values[there].max()),
    }  # fmt: skip
