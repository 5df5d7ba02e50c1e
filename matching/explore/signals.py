"""A recording beside a model: its columns, which channel each is, its signals, and responses from it."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from matching.bed.measured import estimated_response, spectra
from matching.channel_names import Suggestion, channel_file, suggestions, time_column
from matching.report.common import decimated
from matching.uncertainty.budget import parse_formula
from modelling.errors import InputError
from modelling.escape import file_name
from modelling.recordings.read import Channel, read_recording
from modelling.recordings.readers import read_table
from modelling.recordings.recording import Recording
from modelling.recordings.table import Table
from modelling.system import System
from modelling.units import SENSOR_UNITS, factor
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

    def alike(self, other: Measurement) -> bool:
        """Whether one channel file holds for both: the columns of one, with their units, are among the other's."""
        own, theirs = self.columns.items(), other.columns.items()
        same_time = (self.time, self.time_unit) == (other.time, other.time_unit)
        return same_time and (own <= theirs or theirs <= own)

    def values(self, of: str | Computed) -> np.ndarray | None:
        """Values (t,) of a column in the file's unit, or of a computed signal; None where the file lacks a column."""
        if isinstance(of, str):
            return self._column(of) if of in self.columns else None
        if not set(of.columns) <= self.columns.keys():
            return None
        return of.values({name: self._column(name) for name in of.columns})

    def at(self, of: str | Computed, times: Sequence[float]) -> list[float]:
        """Values of a signal at times, in the file's units, straight between samples; NaN outside the recording."""
        values = self.values(of)
        if values is None:
            return [float("nan") for _ in times]
        time, known = self._column(self.time), np.isfinite(values)
        found = np.interp(times, time[known], values[known], np.nan, np.nan) if known.any() else [np.nan] * len(times)
        return [float(value) for value in found]

    def signal(self, of: str | Computed, low: float, high: float) -> tuple[np.ndarray, ...]:
        """Times and values (k,) of a signal between two times, decimated for a screen, in the file's units."""
        time, values = self._column(self.time), self.values(of)
        if values is None:
            return np.empty(0), np.empty(0)
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


@dataclass(frozen=True)
class Computed:
    """A signal that a formula makes of columns, each in SI.

    Attributes
    ----------
    text : str
        The formula as it was written.
    columns : tuple of str
        Those that the formula names.
    scales : tuple of float
        What takes each column to SI.
    """

    text: str
    columns: tuple[str, ...]
    scales: tuple[float, ...]
    _made: Callable[..., Any] = field(repr=False, compare=False)

    @classmethod
    def of(cls, text: str, units: Mapping[str, str]) -> Computed:
        """Read a formula over columns, whose units are given; a name that is no single word stands in braces."""
        import sympy

        known = {f"_column{number}": name for number, name in enumerate(units)}
        places = {name: place for place, name in known.items()}
        written = _BRACED.sub(lambda found: places.get(found[1].strip(), found[0]), text)
        words = {place: sympy.Symbol(place, real=True) for place in known}
        names = {name: places[name] for name in units if name.isidentifier()}
        try:
            expression = parse_formula(written, {**names, **known}, "formula")
        except InputError as error:
            right = "columns are " + ", ".join(name if name.isidentifier() else f"{{{name}}}" for name in units)
            raise InputError("formula", error.wrong.replace("the inputs", "the columns"), right) from None
        expression = expression.subs({sympy.Symbol(name, real=True): words[place] for name, place in names.items()})
        used = sorted((str(symbol) for symbol in expression.free_symbols), key=list(known).index)
        if not used:
            raise InputError("formula", f"{text!r} names no column", "write it like a * b")
        columns = tuple(known[place] for place in used)
        return cls(
            text.strip(), columns, tuple(_to_si(units[name]) for name in columns),
            sympy.lambdify([words[place] for place in used], expression, "numpy"),
        )  # fmt: skip

    def values(self, columns: Mapping[str, np.ndarray]) -> np.ndarray:
        """Values (t,) from those of the columns, in the file's units; NaN where the formula has none."""
        given = [scale * columns[name] for name, scale in zip(self.columns, self.scales, strict=True)]
        with np.errstate(all="ignore"):
            found = np.broadcast_to(np.asarray(self._made(*given), complex), given[0].shape)
        return np.where(np.isfinite(found) & (found.imag == 0), found.real, np.nan)


_BRACED = re.compile(r"\{([^{}]*)\}")


def _to_si(unit: str) -> float:
    """Factor that takes a unit to SI; 1 where the file states none, or one that is none of a drivetrain's."""
    for si in (*SENSOR_UNITS.values(), "m/s", "W", "N", "s", "1"):
        with contextlib.suppress(InputError):
            return factor(unit, si) if unit else 1.0
    return 1.0


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
