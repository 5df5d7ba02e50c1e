"""A recording beside a model: its columns, which channel each is, its signals, and responses from it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from matching.bed.measured import estimated_response, spectra
from matching.channel_names import Suggestion, channel_file, suggestions, time_column
from matching.report.common import decimated
from modelling.errors import InputError
from modelling.escape import file_name
from modelling.recordings.read import Channel, read_recording
from modelling.recordings.readers import read_table
from modelling.recordings.recording import Recording
from modelling.recordings.table import Table
from modelling.system import System
from modelling.units import factor
from modelling.writing import write_all

# --- Frequency responses from a recording, to be laid over those of a model.

POINTS = 60  # of a measured response, spaced logarithmically
PERIODS = 6.0  # of the lowest frequency within the recording
SAMPLES_A_PERIOD = 6.0  # of the highest frequency
MOVES = 1e-9  # of a torque's largest value: what changes less does not excite


@dataclass(frozen=True)
class MeasuredCurves:
    """Responses (f, y, u) at frequencies (f,), Hz, NaN where undetermined, with standard uncertainty of the modulus."""

    frequencies: np.ndarray
    inputs: tuple[str, ...]
    sensors: tuple[str, ...]
    values: np.ndarray
    uncertainties: np.ndarray


def measured_curves(recording: Recording, system: System) -> MeasuredCurves:
    """Responses of a recording's sensors to those of its inputs that change."""
    inputs = [part.name for part in system.inputs if np.ptp(recording[part.name]) > MOVES * _size(recording, part.name)]
    sensors = [part.name for part in system.sensors if part.name in recording.channels]
    if not inputs or not sensors:
        what = "no input changes" if not inputs else "no sensor of the model was recorded"
        raise InputError(recording.source, what, "record one that the model can answer")
    time = recording.time
    even = np.linspace(time[0], time[-1], len(time))
    signals = {name: np.interp(even, time, recording[name]) for name in (*inputs, *sensors)}
    step, lasts = float(even[1] - even[0]), float(even[-1] - even[0])
    low, high = PERIODS / lasts, 1 / (SAMPLES_A_PERIOD * step)
    try:
        spectrum = spectra(
            np.stack([signals[name] for name in inputs], axis=1),
            np.stack([signals[name] for name in sensors], axis=1),
            step,
            high,
        )
        responses = estimated_response([spectrum], np.geomspace(low, high, POINTS))
    except ValueError as error:
        raise InputError(recording.source, f"is too short: {error}", "record longer") from None
    spread = np.sqrt(responses.variances / 2)
    return MeasuredCurves(responses.frequencies, tuple(inputs), tuple(sensors), responses.values, spread)


def _size(recording: Recording, name: str) -> float:
    return max(float(np.abs(recording[name]).max()), 1e-300)


# --- A measurement file beside a model: its columns, which channel each is, and the signals over time.

SHOWN_POINTS = 3000  # of a signal: two a column of pixels


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
        return {column.name: column.unit for column in self.table.columns if column.name != self.time}

    @property
    def time_unit(self) -> str:
        """Unit of time in the file; seconds where it states none."""
        return self.table[self.time].unit or "s"

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
        time, values = self._column(self.time), self._column(column)
        first = max(int(np.searchsorted(time, low)) - 1, 0)  # one sample beyond each end: the curve reaches the edges
        last = int(np.searchsorted(time, high, side="right")) + 1
        return decimated(time[first:last], values[first:last], SHOWN_POINTS)

    def write_channels(self, chosen: Mapping[str, tuple[str, str]], folder: Path) -> Path:
        """Write a channel file that says which column, in which unit, is which channel; its path."""
        used = [column for column, _ in chosen.values() if column]
        if twice := next((column for column in used if used.count(column) > 1), ""):
            raise InputError(str(self.path), f"column {twice!r} stands for two channels", "choose another for one")
        name = f"{file_name(self.path.stem)}_channels.toml"
        write_all(folder, {name: channel_file(chosen, self.time)})
        return folder / name

    def _column(self, name: str) -> np.ndarray:
        return self.table[name].values


def opened_measurement(path: str | Path) -> Measurement:
    """Read a measurement file with all its columns."""
    table = read_table(path)
    time = time_column(table.names)
    if not time:
        raise InputError(str(path), "has no column called time", "call the column of time `time` or `t`")
    return Measurement(Path(path), table, time)


def read_as_suggested(path: Path, system: System) -> Recording:
    """The channels of a model from a file, each from the column that is likeliest."""
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
