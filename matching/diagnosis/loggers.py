"""Recordings of two loggers as one: their clocks do not agree, and the offset is estimated from the start.

The model is simulated with the inputs of one logger. Where its readings and those that another logger recorded agree
best, as far as their shape goes, is that logger's clock to within a sample; a fit finds the rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy import fft

from matching.diagnosis.data import Segment
from matching.diagnosis.problem import first_state
from matching.diagnosis.simulation import simulate_readings, steps_and_stick_speed
from modelling.equations.casadi_code import compiled
from modelling.equations.lagrange import STICK_SPEED
from modelling.errors import InputError
from modelling.recordings.read import Channel, read_recording, read_signals
from modelling.recordings.recording import Recording
from modelling.system import System, clock_error

SEVERAL_LOGGERS = "+"  # between the files of one motion
LARGEST_SHARE = 0.25  # of the shorter recording: the largest offset that is looked for
FEWEST_SAMPLES = 128  # that both loggers recorded
LEFT_STEPS = 10.0  # sampling steps that the correlation may be wrong by: the model it is with is not fitted yet
LEFT_SECONDS = 0.03  # the same in s: a phase of 0.1 rad at 0.5 Hz
STEPS_PER_RADIAN = 3.0  # of the fastest mode


def read_loggers(paths: str, system: System, channels: Mapping[str, Channel] | None = None) -> Recording:
    """A recording from a file, or from the files of several loggers joined by ``+``."""
    if SEVERAL_LOGGERS not in paths or Path(paths).exists():
        return read_recording(paths, system, channels)
    names = [*(part.name for part in system.inputs), *(part.name for part in system.sensors)]
    names += system.input_references
    return joined(system, [read_signals(Path(path), names, channels) for path in paths.split(SEVERAL_LOGGERS)])


def joined(system: System, parts: Sequence[Recording]) -> Recording:
    """Recordings of the same motion by several loggers as one, on the clock of the one that recorded the inputs.

    Its ``clock_groups`` hold the sensors of each further logger, its notes their offsets. The reference of a controller
    is taken from any of them.
    """
    inputs = {part.name for part in system.inputs}
    leading = next((part for part in parts if inputs <= set(part.channels)), None)
    if leading is None:
        raise InputError(
            "+".join(part.source for part in parts), "no logger recorded all inputs", "one of them must have all"
        )
    whole = leading
    for part in parts:
        if part is not leading:
            whole = _with_logger(system, whole, part)
    return whole


def with_clocks(system: System, recordings: Sequence[Recording]) -> System:
    """A system whose further loggers are late by what joining may have left, to be fitted too."""
    steps = [float(np.median(np.diff(recording.time))) for recording in recordings]
    groups = dict.fromkeys(group for recording in recordings for group in recording.clock_groups)
    largest = max(LEFT_STEPS * max(steps), LEFT_SECONDS)
    return system.with_effects(*(clock_error([f"sensors.{name}" for name in group], largest) for group in groups))


def _with_logger(system: System, leading: Recording, part: Recording) -> Recording:
    """A recording with the sensors of a further logger."""
    names = [s.name for s in system.sensors if s.name in part.channels and s.name not in leading.channels]
    if not names:
        raise InputError(part.source, "has no sensor that the other logger lacks", "leave it out")
    offset = clock_offset(system, leading, part, names)
    time = part.time - offset
    inside = (leading.time >= time[0]) & (leading.time <= time[-1])
    if inside.sum() < FEWEST_SAMPLES:
        raise InputError(part.source, "does not overlap with the other logger", "give recordings of the same motion")
    kept = leading.time[inside]
    channels = {name: values[inside] for name, values in leading.channels.items()}
    channels |= {name: _at(kept, time, part.channels[name]) for name in names}
    channels |= {
        name: np.interp(kept, time, part.channels[name])
        for name in system.input_references
        if name in part.channels and name not in channels
    }
    how = f"{abs(offset):.4g} s {'late' if offset > 0 else 'early'}"
    note = f"{part.source}: its clock is {how}, found from {', '.join(names)}; taken out"
    return replace(
        leading, time=kept, channels=channels, notes=(*leading.notes, *part.notes, note),
        source=f"{leading.source}+{part.source}", units={**leading.units, **part.units},
        clock_groups=(*leading.clock_groups, tuple(names)),
    )  # fmt: skip


def _at(kept: np.ndarray, time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """A signal (t,) over its own time at the times kept (k,), linear between samples; NaN where there are more of these
    than samples: no noise counts twice."""
    nearest = np.unique(np.clip(np.searchsorted((kept[1:] + kept[:-1]) / 2, time), 0, len(kept) - 1))
    out = np.full(len(kept), np.nan)
    out[nearest] = np.interp(kept[nearest], time, values)
    return out


def clock_offset(system: System, leading: Recording, part: Recording, names: Sequence[str]) -> float:
    """By how much (s) the clock of a logger is late, from the cross-correlation of its sensors with the simulation.

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
    for name in names:
        known = np.isfinite(part.channels[name])
        measured = np.interp(other, part.time[known], part.channels[name][known])
        expected = np.interp(even, leading.time, simulated[:, index.index(name)])
        total += _correlation(measured, expected, size)
    lags = np.arange(size)
    lags[lags > size // 2] -= size
    offsets = lags * step + other[0] - even[0]
    longest = LARGEST_SHARE * min(np.ptp(even), np.ptp(other))
    best = int(np.argmax(np.where(np.abs(offsets) <= longest, total, -np.inf)))
    before, at, after = total[best - 1], total[best], total[(best + 1) % size]
    curvature = before - 2 * at + after
    return float(offsets[best] + (step * 0.5 * (before - after) / curvature if curvature < 0 else 0.0))


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
