"""Recordings of two loggers as one: their clocks do not agree, and the offset is estimated from the start.

The model is simulated with the inputs of one logger. Where its readings and those that another logger recorded agree
best, as far as their shape goes, is that logger's clock to within a sample; a fit finds the rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy import fft

from matching.channel_names import SEVERAL, time_column
from matching.diagnosis.data import Segment
from matching.diagnosis.problem import first_state
from matching.diagnosis.simulation import simulate_readings, steps_and_stick_speed
from modelling.equations.casadi_code import compiled
from modelling.equations.lagrange import STICK_SPEED
from modelling.errors import InputError, listed, unknown
from modelling.recordings.read import (
    Channel,
    ChannelFile,
    absent_inputs,
    absent_note,
    names_in_file,
    read_recording,
    read_signals,
)
from modelling.recordings.readers import read_table
from modelling.recordings.recording import Recording
from modelling.system import System, clock_error

LARGEST_SHARE = 0.25  # of the shorter recording: the largest offset that is looked for
FEWEST_SAMPLES = 128  # that both loggers recorded
RIVAL = (
    0.9  # of the largest correlation: another offset with so much is as likely, as a period later under periodic load
)
LEFT_STEPS = 1.0  # sampling steps that the correlation may be wrong by at least
STEPS_PER_RADIAN = 3.0  # of the fastest mode


def read_loggers(paths: str, system: System, channels: Mapping[str, Channel] | None = None) -> Recording:
    """A recording from a file, or from the files of several loggers joined by ``+``.

    Raises
    ------
    InputError
        As :func:`modelling.recordings.read.read_recording`; if a channel of the channel file is in none of several
        files, or in more than one.
    """
    if SEVERAL not in paths or Path(paths).exists():
        return read_recording(paths, system, channels, absent_is_zero=True)
    names = [*(part.name for part in system.inputs), *(part.name for part in system.sensors)]
    names += system.further_signals
    files = [Path(path) for path in paths.split(SEVERAL)]
    stated = _by_file(files, channels) if channels else [None] * len(files)
    same_clock = isinstance(channels, ChannelFile) and channels.same_clock
    parts = [read_signals(path, names, own) for path, own in zip(files, stated, strict=True)]
    return joined(system, _with_absent(system, parts, bool(channels)), same_clock)


def _with_absent(system: System, parts: Sequence[Recording], mapped: bool) -> list[Recording]:
    """The same; a torque that no logger holds is zero in those that hold the other inputs, with a note."""
    columns = {name for part in parts for name in part.channels}
    absent = absent_inputs(columns, (), system, mapped)
    others = {part.name for part in system.inputs_to_record(columns)} - set(absent)
    return [
        replace(
            part, channels=part.channels | {name: np.zeros(len(part.time)) for name in absent},
            notes=(*part.notes, *map(absent_note, absent)),
        ) if others <= set(part.channels) else part
        for part in parts
    ]  # fmt: skip


def _by_file(files: Sequence[Path], channels: Mapping[str, Channel]) -> list[ChannelFile]:
    """The entries of a channel file that are of each file: of that which has the channel.

    The column of time may be in several files.
    """
    header = channels.header if isinstance(channels, ChannelFile) else None
    there = []
    for path in files:
        table = read_table(path, names_in_file(channels, channels), None, header)
        there.append({*table.names, *table.others})
    out = [ChannelFile() for _ in files]
    for own in out:
        if isinstance(channels, ChannelFile):
            own.header, own.sampling_rate = channels.header, channels.sampling_rate
    for name, channel in channels.items():
        having = [i for i, columns in enumerate(there) if channel.name in columns]
        where = channel.where or f"channels.{name}"
        if not having:
            known = sorted(set().union(*there))
            fault = unknown(channel.name, known, where)
            raise InputError(where, f"{channel.name!r} is in none of {listed([*map(str, files)])}", fault.right)
        if len(having) > 1 and name != "time":
            both = " and ".join(str(files[i]) for i in having)
            raise InputError(where, f"{channel.name!r} is in {both}", "rename or drop the column in one of them")
        for i in having:
            out[i][name] = channel
    for own, columns in zip(out, there, strict=True):
        # each file has a time of its own, and the channel file names one
        if own.sampling_rate is None and not ({"time"} | {own[key].name for key in own if key == "time"}) & columns:
            own["time"] = Channel(time_column(sorted(columns)) or "time")
    return out


def joined(system: System, parts: Sequence[Recording], same_clock: bool = False) -> Recording:
    """Recordings of the same motion by several loggers as one, on the clock of the one that recorded the inputs.

    Its ``clock_groups`` hold the sensors of each further logger, its notes their offsets; of loggers with the
    ``same_clock`` there are none. The reference of a controller is taken from any of them.
    """
    channels = {name for part in parts for name in part.channels}
    inputs = {part.name for part in system.inputs_to_record(channels)}
    leading = next((part for part in parts if inputs <= set(part.channels)), None)
    if leading is None:
        raise InputError(
            "+".join(part.source for part in parts), "no logger recorded all inputs", "one of them must have all"
        )
    whole = leading
    for part in parts:
        if part is not leading:
            whole = _with_logger(system, whole, part, same_clock)
    return whole


def with_clocks(system: System, recordings: Sequence[Recording]) -> System:
    """A system whose further loggers are late by what joining may have left, to be fitted too."""
    largest: dict[tuple[str, ...], float] = {}
    for recording in recordings:
        for group, limit in zip(recording.clock_groups, recording.clock_limits, strict=True):
            largest[group] = max(limit, largest.get(group, 0.0))
    return system.with_effects(
        *(clock_error([f"sensors.{name}" for name in group], limit) for group, limit in largest.items())
    )


def _with_logger(system: System, leading: Recording, part: Recording, same_clock: bool) -> Recording:
    """A recording with the sensors of a further logger."""
    names = [s.name for s in system.sensors if s.name in part.channels and s.name not in leading.channels]
    if not names:
        raise InputError(part.source, "has no sensor that the other logger lacks", "leave it out")
    found = None if same_clock else clock_offset(system, leading, part, names)
    offset = found.offset if found is not None and found.rival is None else 0.0
    time = part.time - offset
    inside = (leading.time >= time[0]) & (leading.time <= time[-1])
    if inside.sum() < FEWEST_SAMPLES:
        raise InputError(part.source, "does not overlap with the other logger", "give recordings of the same motion")
    kept = leading.time[inside]
    channels = {name: values[inside] for name, values in leading.channels.items()}
    channels |= {name: _at(kept, time, part.channels[name]) for name in names}
    channels |= {
        name: np.interp(kept, time, part.channels[name])
        for name in system.further_signals
        if name in part.channels and name not in channels
    }
    note = f"{part.source}: its clock is that of {leading.source} by the channel file"
    if found is not None:
        note = f"{part.source}: {found.words} (from {', '.join(names)})"
    return replace(
        leading, time=kept, channels=channels, notes=(*leading.notes, *part.notes, note),
        source=f"{leading.source}+{part.source}", units={**leading.units, **part.units},
        clock_groups=(*leading.clock_groups, *([tuple(names)] if found else [])),
        clock_limits=(*leading.clock_limits, *([found.uncertainty] if found else [])),
    )  # fmt: skip


def _at(kept: np.ndarray, time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """A signal (t,) over its own time at the times kept (k,), linear between samples; NaN where there are more of these
    than samples: no noise counts twice."""
    nearest = np.unique(np.clip(np.searchsorted((kept[1:] + kept[:-1]) / 2, time), 0, len(kept) - 1))
    out = np.full(len(kept), np.nan)
    out[nearest] = np.interp(kept[nearest], time, values)
    return out


@dataclass(frozen=True)
class ClockOffset:
    """By how much the clock of a logger is late.

    Attributes
    ----------
    offset, uncertainty : float
        s. A model whose readings correlate by ρ with the measured ones errs in phase by up to arccos ρ: the uncertainty
        is that phase at the mean frequency of the readings.
    correlation : float
        Of the measured and the simulated changes at this offset.
    rival : tuple of float or None
        Another offset that is nearly as likely, and its correlation.
    """

    offset: float
    uncertainty: float
    correlation: float
    rival: tuple[float, float] | None

    @property
    def words(self) -> str:
        """What was found, in a sentence."""
        if self.rival is None:
            return f"its clock is {_late(self.offset)} ± {self.uncertainty:.2g} s; taken out"
        return (
            f"its clock is {_late(self.offset)} (correlation {self.correlation:.3f}) or {_late(self.rival[0])} "
            f"({self.rival[1]:.3f}), which this motion does not tell apart; nothing is taken out. Set the clocks "
            "before, or write same_clock = true into the channel file"
        )


def _late(offset: float) -> str:
    return f"{abs(offset):.4g} s {'late' if offset > 0 else 'early'}"


def clock_offset(system: System, leading: Recording, part: Recording, names: Sequence[str]) -> ClockOffset:
    """By how much the clock of a logger is late, from the cross-correlation of its sensors with the simulation.

    Parameters
    ----------
    leading : Recording
        With all inputs.
    names : sequence of str
        Sensors of ``part``.
    """
    simulated = _simulated(system, leading)
    step = float(np.median(np.diff(leading.time)))
    even = np.arange(leading.time[0], leading.time[-1] + step / 2, step)
    other = np.arange(part.time[0], part.time[-1] + step / 2, step)
    size = fft.next_fast_len(len(even) + len(other), real=True)
    total = np.zeros(size)
    index = [sensor.name for sensor in system.sensors]
    columns = [index.index(name) for name in names]
    for name in names:
        known = np.isfinite(part.channels[name])
        measured = np.interp(other, part.time[known], part.channels[name][known])
        expected = np.interp(even, leading.time, simulated[:, index.index(name)])
        total += _correlation(measured, expected, size)
    lags = np.arange(size)
    lags[lags > size // 2] -= size
    offsets = lags * step + other[0] - even[0]
    longest = LARGEST_SHARE * min(np.ptp(even), np.ptp(other))
    order = np.argsort(offsets)
    order = order[np.abs(offsets[order]) <= longest]
    offsets, total = offsets[order], total[order] / len(names)
    best = int(np.argmax(total))
    at = float(np.clip(total[best], 1e-3, 1.0))
    offset = float(offsets[best])
    if 0 < best < len(total) - 1:
        before, after = total[best - 1], total[best + 1]
        curvature = before - 2 * total[best] + after
        offset += float(step * 0.5 * (before - after) / curvature) if curvature < 0 else 0.0
    uncertainty = max(LEFT_STEPS * step, float(np.arccos(at)) / _mean_frequency(simulated[:, columns], leading.time))
    return ClockOffset(offset, uncertainty, at, _rival(offsets, total, best))


def _rival(offsets: np.ndarray, total: np.ndarray, best: int) -> tuple[float, float] | None:
    """Another peak of the correlation (k,) that is nearly as high as the best one, which falls below it in between."""
    below = np.flatnonzero(total < RIVAL * total[best])
    beyond = np.ones(len(total), dtype=bool)
    first, last = below[below < best].max(initial=-1), below[below > best].min(initial=len(total))
    beyond[first + 1 : last] = False
    if not beyond.any():
        return None
    other = int(np.argmax(np.where(beyond, total, -np.inf)))
    return (float(offsets[other]), float(total[other])) if total[other] > RIVAL * total[best] else None


def _mean_frequency(readings: np.ndarray, time: np.ndarray) -> float:
    """Root mean square of the angular frequency (rad/s) in the changes of readings (t, k)."""
    change = np.gradient(readings, time, axis=0)
    steepness, size = np.gradient(change, time, axis=0), change - change.mean(axis=0)
    return float(np.sqrt(np.sum(steepness**2) / max(np.sum(size**2), 1e-300)) or 1.0)


def _correlation(measured: np.ndarray, expected: np.ndarray, size: int) -> np.ndarray:
    """Cross-correlation (size,) of the changes of two signals, over the lags of the first; each of norm 1."""
    spectra = []
    for signal in (measured, expected):
        change = np.gradient(signal)
        norm = float(np.linalg.norm(change))
        spectra.append(fft.rfft(change / norm if norm > 0 else change, size))
    return fft.irfft(spectra[0] * np.conj(spectra[1]), size)


def _simulated(system: System, recording: Recording) -> np.ndarray:
    """Readings (t, y) of the system as given over recorded inputs."""
    model = compiled(system)
    readings = np.full((len(recording.time), len(system.sensors)), np.nan)
    for j, sensor in enumerate(system.sensors):
        if sensor.name in recording.channels:
            readings[:, j] = recording.channels[sensor.name]
    segment = Segment(recording.time, np.ascontiguousarray(recording.inputs(system)), readings, recording.source)
    start = first_state(system, model, segment)
    sampling = 1 / float(np.median(np.diff(recording.time)))
    steps, stick_speed = steps_and_stick_speed(model, model.p0, start[None], sampling, STEPS_PER_RADIAN)
    p = model.vector({STICK_SPEED: stick_speed} if np.isfinite(stick_speed) else {})
    simulated = simulate_readings(model, [segment], p[None], [start[None]], steps)[0][0]
    if not np.isfinite(simulated).all():
        raise InputError(recording.source, "the model does not simulate these inputs", "check units and values")
    return simulated
