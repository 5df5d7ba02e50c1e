"""A measurement file beside a model: its columns, which channel each is, and the signals over time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from matching.explore.signals.decimate import envelope
from matching.explore.signals.suggestions import Suggestion, channel_file, suggestions, time_column
from modelling.common.errors import InputError
from modelling.common.escape import file_name
from modelling.measurement.channels import Channel
from modelling.measurement.read import read_recording
from modelling.measurement.readers import read_table
from modelling.measurement.readers.table import Table
from modelling.measurement.recording import Recording
from modelling.model.system import System
from modelling.units import factor
from modelling.writing.output import write_all

COLUMNS = 1500  # of pixels that a signal is decimated to


@dataclass(frozen=True)
class Measurement:
    """A measurement file that is open.

    Attributes
    ----------
    path : Path
    table : Table
        All its columns, in the file's units.
    time : str
        The column of time.
    """

    path: Path
    table: Table
    time: str

    @property
    def columns(self) -> dict[str, str]:
        """Unit of every column but time, empty where the file states none."""
        units = dict(zip(self.table.names, self.table.units, strict=True))
        units.pop(self.time, None)
        return units

    @property
    def span(self) -> tuple[float, float]:
        """First and last time, in the file's unit."""
        time = self._column(self.time)
        return float(time[0]), float(time[-1])

    def suggestions(self, system: System) -> dict[str, Suggestion]:
        """The likeliest column of every channel of a model."""
        return suggestions(system, self.columns)

    def signal(self, column: str, low: float, high: float) -> tuple[np.ndarray, ...]:
        """Times and values (k,) of a column between two times, decimated for a screen, in the file's units."""
        time, values = envelope(self._column(self.time), self._column(column), low, high, COLUMNS)
        return time, values

    def write_channels(self, chosen: Mapping[str, tuple[str, str]], folder: Path) -> Path:
        """Write a channel file that says which column, in which unit, is which channel; its path.

        Raises
        ------
        InputError
            If a column stands for two channels.
        """
        used = [column for column, _ in chosen.values() if column]
        if twice := next((column for column in used if used.count(column) > 1), ""):
            raise InputError(str(self.path), f"column {twice!r} stands for two channels", "choose another for one")
        name = f"{file_name(self.path.stem)}_channels.toml"
        write_all(folder, {name: channel_file(chosen, self.time)})
        return folder / name

    def _column(self, name: str) -> np.ndarray:
        return self.table.values[:, self.table.names.index(name)]


def opened_measurement(path: str | Path) -> Measurement:
    """Read a measurement file with all its columns.

    Raises
    ------
    InputError
        If it cannot be read, or no column is time.
    """
    table = read_table(path)
    time = time_column(table.names)
    if not time:
        raise InputError(str(path), "has no column called time", "call the column of time `time` or `t`")
    return Measurement(Path(path), table, time)


def read_as_suggested(path: Path, system: System) -> Recording:
    """The channels of a model from a file, each from the column that is likeliest.

    Raises
    ------
    InputError
        If the file cannot be read, or an input is not in it.
    """
    file = opened_measurement(path)
    channels = {
        name: Channel(suggested.column, suggested.unit)
        for name, suggested in file.suggestions(system).items()
        if suggested.column
    }
    return read_recording(path, system, channels | {"time": Channel(file.time)})


def in_units_of(values: np.ndarray, si: str, unit: str) -> np.ndarray:
    """Values (k,) of a model, SI, in the unit of a file."""
    return values / factor(unit, si) if unit else values
