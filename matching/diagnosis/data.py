"""From recordings to the data of a fit: segments without gaps, noise by sensor, what is fitted and what is held out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.linalg import solve_discrete_are

from modelling.errors import InputError
from modelling.recordings.channel_faults import fault
from modelling.recordings.corrections import SETTINGS, kept_values, resolution
from modelling.recordings.recording import Recording, longest_bridge
from modelling.system import Sensor, System

# --- A stationary Kalman smoother: states and unknown inputs of a linear system from noisy readings.
#
# Forward filter and backward smoother (Rauch, Tung and Striebel, AIAA Journal 3, 1965) with the constant gains of the
# stationary covariance, which SciPy finds from the discrete algebraic Riccati equation.


@dataclass(frozen=True)
class StationarySmoother:
    """Gains of x[k+1] = F·x[k] + w, y[k] = H·x[k] + v with covariances Q of w and R of v.

    Attributes
    ----------
    F : ndarray (x, x)
    H : ndarray (y, x)
    gain : ndarray (x, y)
        K of the filter.
    smoother_gain : ndarray (x, x)
        S of the smoother.
    """

    F: np.ndarray
    H: np.ndarray
    gain: np.ndarray
    smoother_gain: np.ndarray

    def smooth(self, y: np.ndarray) -> np.ndarray:
        """Readings (t, y) → states (t, x), beginning at rest."""
        keep = (np.eye(len(self.F)) - self.gain @ self.H) @ self.F
        driven = y @ self.gain.T
        states = np.empty((len(y), len(self.F)))
        x = np.zeros(len(self.F))
        for k, correction in enumerate(driven):
            x = keep @ x + correction
            states[k] = x
        anchored = states @ (np.eye(len(self.F)) - self.smoother_gain @ self.F).T
        for k in range(len(y) - 2, -1, -1):
            x = anchored[k] + self.smoother_gain @ x
            states[k] = x
        return states


def stationary_smoother(F: np.ndarray, H: np.ndarray, Q: np.ndarray, R: np.ndarray) -> StationarySmoother:
    """Constant gains of filter and smoother.

    Readings are scaled to unit noise first, so that the Riccati equation is well conditioned.

    Parameters
    ----------
    F, H : ndarray (x, x), (y, x)
        State from sample to sample, and readings of a state.
    Q : ndarray (x, x)
        Covariance of what enters the state within a sample.
    R : ndarray (y,)
        Variances of the readings.
    """
    sigma = np.sqrt(R)
    scaled = H / sigma[:, None]
    unit = np.eye(len(R))
    predicted = solve_discrete_are(F.T, scaled.T, Q, unit)
    gain = np.linalg.solve(scaled @ predicted @ scaled.T + unit, scaled @ predicted).T
    filtered = predicted - gain @ scaled @ predicted
    smoother_gain = np.linalg.solve(predicted, F @ filtered).T
    return StationarySmoother(F, H, gain / sigma, smoother_gain)


# --- A gap in a recording: the samples before and after it are fitted as segments, each with its own start state.

FEWEST_SAMPLES = 64  # of a segment; a start state of its own costs as much as fewer samples tell


def segments_between_gaps(time: np.ndarray, source: str) -> tuple[list[slice], list[str]]:
    """Samples between gaps too long to bridge (:mod:`modelling.recordings.recording`), and notes on those left out.

    Parameters
    ----------
    time : ndarray (t,)
        s, increasing.
    source : str
        The recording, for messages.
    """
    edges = [0, *(np.flatnonzero(np.diff(time) > longest_bridge(time)) + 1), len(time)]
    kept, notes = [], []
    for first, last in pairwise(int(edge) for edge in edges):
        if last - first >= FEWEST_SAMPLES:
            kept.append(slice(first, last))
        elif len(edges) > 2:
            notes.append(f"{last - first} samples between gaps at {time[first]:g} s are left out")
        else:
            raise InputError(source, f"has {last - first} samples", f"at least {FEWEST_SAMPLES} are needed")
    return kept, notes


# --- The data of a fit: segments of recordings with inputs and readings, and the noise of each sensor.


@dataclass(frozen=True)
class Segment:
    """A part of a recording without gaps.

    Attributes
    ----------
    time : ndarray (t,)
        s, increasing, from the start of its recording.
    inputs : ndarray (t, u)
        SI, in the order of the model's inputs.
    readings : ndarray (t, y)
        SI, in the order of the model's sensors; NaN where nothing was measured.
    name : str
        The recording it is from.
    recording : int
        Its number, from 1.
    held : tuple of int
        Inputs, by index, that keep the value of a sample until the next; others are straight between samples.
    smooth : tuple of int
        Inputs, by index, that are smooth between samples.
    cut_from : int
        Of a window: the number of the segment that it was cut from.
    """

    time: np.ndarray
    inputs: np.ndarray
    readings: np.ndarray
    name: str = ""
    recording: int = 1
    held: tuple[int, ...] = ()
    smooth: tuple[int, ...] = ()
    cut_from: int = 0

    @property
    def measured(self) -> np.ndarray:
        """(t, y) whether there is a reading."""
        return np.isfinite(self.readings)

    def part(self, first: int, last: int) -> Segment:
        """Samples first … last − 1."""
        samples = slice(first, last)
        return replace(self, time=self.time[samples], inputs=self.inputs[samples], readings=self.readings[samples])


@dataclass(frozen=True)
class FitData:
    """What a fit is given.

    Attributes
    ----------
    segments : tuple of Segment
    noise : ndarray (y,)
        Standard uncertainty of each sensor, SI; also the noise that a fit assumes.
    rounding : ndarray (y, l), optional
        What the resolution of the inputs adds to a residual beyond white noise, as
        :attr:`matching.diagnosis.statistics.WhitenessTest.excess`.
    """

    segments: tuple[Segment, ...]
    noise: np.ndarray
    rounding: np.ndarray | None = None

    @property
    def readings_by_sensor(self) -> np.ndarray:
        """(y,) number of readings of each sensor."""
        return sum((segment.measured.sum(axis=0) for segment in self.segments), np.zeros(len(self.noise), dtype=int))

    @property
    def readings_count(self) -> int:
        """Number of readings of all sensors."""
        return int(self.readings_by_sensor.sum())

    @property
    def sampling_interval(self) -> float:
        """Median time between samples of the first segment, s."""
        return float(np.median(np.diff(self.segments[0].time)))


# --- The noise of a sensor that states no uncertainty, estimated from the scatter of its readings.

MEDIAN_OF_NORMAL = 0.6745  # median of |x| for x normal with standard deviation 1
SMALLEST_SHARE = 1e-6  # of the largest reading: less is rounding
SMALLEST = 1e-12  # SI, for readings that are all 0
UNMEASURED = 1e6  # SI, noise of a sensor without any reading: it tells nothing


def noise_from_scatter(parts: Sequence[np.ndarray]) -> float:
    """Standard deviation of white noise on a smooth signal.

    The second difference of white noise has six times its variance; a smooth signal hardly adds to it at high
    sampling. The median of its magnitude ignores jumps.

    Parameters
    ----------
    parts : sequence of ndarray (t,)
        Readings without gaps; NaN where there is none.
    """
    second_difference = np.concatenate([np.diff(part, 2) for part in parts])
    second_difference = second_difference[np.isfinite(second_difference)]
    scatter = 0.0
    if len(second_difference):
        scatter = float(np.median(np.abs(second_difference))) / MEDIAN_OF_NORMAL / np.sqrt(6)
    largest = float(np.nanmax(np.abs(np.concatenate(parts)), initial=0.0))
    return max(scatter, SMALLEST_SHARE * largest, SMALLEST)


def remove_stuck_values(
    values: np.ndarray, time: np.ndarray, name: str, standing: np.ndarray | None = None
) -> tuple[np.ndarray, list[str]]:
    """A channel with NaN where it is stuck, and a note on each of these times.

    Parameters
    ----------
    values, time : ndarray (t,)
        Of the channel, and in s.
    name : str
        The sensor, for the notes.
    standing : ndarray (t,) of bool, optional
        Where the drive stands still by its other sensors: there a sensor that shows one value is sound.
    """
    cleaned, notes = values.copy(), []
    for first, last, kind in kept_values(values, time):
        if standing is None or not standing[first + 1 : last].all():
            size = f" from {time[first]:g} to {time[last]:g} s"
            notes.append(f"{fault(kind, name, size=size, value=float(values[first])).sentence}; left out")
            cleaned[first : last + 1] = np.nan
    return cleaned, notes


ROUNDED_STAMP = 0.025  # of a sampling interval, up to which stamps are taken as those of even steps, rounded


# --- From recordings to the data of a fit: segments without gaps, noise, and channels that do not measure.


def prepare_data(system: System, recordings: Sequence[Recording]) -> tuple[FitData, list[str]]:
    """Segments of several recordings of one system, and notes on what was left out."""
    segments: list[Segment] = []
    notes: list[str] = []
    for number, recording in enumerate(recordings, 1):
        more, remarks = _segments(system, recording, number)
        segments += more
        notes += remarks
    if not segments:
        raise InputError(
            recordings[0].source, "has no part without gaps that is long enough", f"{FEWEST_SAMPLES} samples"
        )
    segments, resting = _without_resting(system, segments)
    notes += resting
    noise, remarks = _noise(system, segments)
    data = FitData(tuple(segments), noise)
    if not data.readings_count:
        raise InputError(recordings[0].source, "has no usable reading", "see the notes on its channels")
    return data, list(dict.fromkeys(notes + remarks))


def _without_resting(system: System, segments: Sequence[Segment]) -> tuple[list[Segment], list[str]]:
    """Segments without sensors that keep one value and state no uncertainty: nothing tells how exact they are."""
    kept, notes = [replace(segment, readings=segment.readings.copy()) for segment in segments], []
    for j, sensor in enumerate(system.sensors):
        values = np.concatenate([segment.readings[:, j] for segment in kept])
        values = values[np.isfinite(values)]
        if (
            not sensor.uncertainty
            and values.size
            and np.ptp(values) <= max(SMALLEST_SHARE**2 * np.abs(values).max(), SMALLEST)
        ):
            notes.append(f"{sensor.name} keeps one value and states no uncertainty: left out; state one to use it")
            for segment in kept:
                segment.readings[:, j] = np.nan
    return kept, notes


def _segments(system: System, recording: Recording, number: int) -> tuple[list[Segment], list[str]]:
    """Segments of one recording, and notes."""
    if not recording.sensors(system):
        names = ", ".join(part.name for part in system.sensors) or "none"
        raise InputError(recording.source, "has no sensor of the model", f"the model has {names}")
    notes: list[str] = []
    readings = np.full((len(recording.time), len(system.sensors)), np.nan)
    still = _still(system, recording)
    for j, sensor in enumerate(system.sensors):
        if sensor.name in recording.channels:
            others = [at for name, at in still.items() if name != sensor.name]
            standing = np.all(others, axis=0) if others else None
            readings[:, j], remarks = remove_stuck_values(recording[sensor.name], recording.time, sensor.name, standing)
            notes += remarks
    inputs = np.ascontiguousarray(recording.inputs(system))
    parts, remarks = segments_between_gaps(recording.time, recording.source)
    segments = [Segment(_even(recording.time[p]), inputs[p], readings[p], recording.source, number) for p in parts]
    return segments, notes + remarks


def _even(time: np.ndarray) -> np.ndarray:
    """Times (t,) at even steps where the stamps are so but for their rounding; else as they are."""
    slope, begin = np.polyfit(np.arange(len(time)), time - time[0], 1)
    even = time[0] + begin + slope * np.arange(len(time))
    return even if np.abs(even - time).max() < ROUNDED_STAMP * slope else time


def _still(system: System, recording: Recording) -> dict[str, np.ndarray]:
    """Where (t,) each recorded speed is 0 and each recorded angle keeps its value."""
    still = {}
    for sensor in system.sensors:
        if sensor.name in recording.channels and sensor.measures in ("speed", "angle"):
            values = recording[sensor.name]
            same = np.diff(values, prepend=values[:1]) == 0
            still[sensor.name] = same if sensor.measures == "angle" else values == 0
    return still


def _rounded(sensor: Sensor, readings: np.ndarray) -> list[str]:
    """A note of readings (t,) that are rounded more coarsely than the sensor's stated uncertainty."""
    step = resolution(readings[np.isfinite(readings)], SETTINGS.fewest_of_sensor)
    least = step / np.sqrt(12)
    if least <= (sensor.uncertainty or np.inf):
        return []
    said = fault("rounded", sensor.name, size=f"{step:.3g} {sensor.unit}", value=step, mends=least)
    return [f"{said.sentence}; the model needs {said.line}"]


def _noise(system: System, segments: Sequence[Segment]) -> tuple[np.ndarray, list[str]]:
    """Standard uncertainty (y,) of the sensors, as stated or estimated, and notes on the latter."""
    noise, notes = [], []
    for j, sensor in enumerate(system.sensors):
        uncertainty = sensor.uncertainty
        if not any(segment.measured[:, j].any() for segment in segments):
            uncertainty = uncertainty or UNMEASURED
        elif not uncertainty:
            uncertainty = noise_from_scatter([segment.readings[:, j] for segment in segments])
            scatter = f"{uncertainty:.3g} {sensor.unit}"
            notes.append(f"{sensor.name} states no uncertainty: {scatter} is estimated from its scatter")
        else:
            notes += _rounded(sensor, np.concatenate([segment.readings[:, j] for segment in segments]))
        noise.append(uncertainty)
    return np.array(noise), notes


# --- How residuals are weighted where the model is not perfect: model error is no white noise.
#
# Each sensor has a scale and a memory of its own: what the model leaves of it is taken as a first-order autoregressive
# process e[t] = memory·e[t − 1] + scale·w[t] with white w. The slow drift of an encoder angle then does not hide that
# the same encoder follows a vibration to a microradian, and no sensor outvotes the others because it is precise.

FEWEST_INDEPENDENT = 3.0  # readings that a sensor counts as at least; with 50 the filter of the bench is lost
SMALLEST_MEMORY = 0.0
SMALLEST_SCALE = 1e-6  # times the noise; less is rounding


@dataclass(frozen=True)
class Weighting:
    """Memory of one sample and scale, in times the noise, of what a model leaves of each sensor.

    Attributes
    ----------
    memory, scale : ndarray (y,)
    """

    memory: np.ndarray
    scale: np.ndarray

    @property
    def without_memory(self) -> Weighting:
        """The same standard deviations as white noise: for a free simulation whose whole error counts."""
        return Weighting(np.zeros_like(self.memory), self.scale / np.sqrt(1 - self.memory**2))

    def weigh(self, errors: np.ndarray, measured: np.ndarray) -> np.ndarray:
        """Errors (b, t, y), in times the noise, as white noise of variance 1; 0 where nothing was measured.

        A first sample, and one after a missing one, counts with the standard deviation of the process.
        """
        follows = np.zeros_like(measured)
        follows[1:] = measured[1:] & measured[:-1]
        out = np.where(measured, errors, 0.0)
        out[:, 1:] -= np.where(follows[1:], self.memory * np.where(measured[:-1], errors[:, :-1], 0.0), 0.0)
        return out * np.where(follows, 1.0, np.sqrt(1 - self.memory**2)) / self.scale

    def weigh_transposed(self, weighted: np.ndarray, measured: np.ndarray) -> np.ndarray:
        """The adjoint of :meth:`weigh` on one signal (t, y): the gradient by the errors of half its sum of squares."""
        follows = np.zeros_like(measured)
        follows[1:] = measured[1:] & measured[:-1]
        scaled = np.where(measured, weighted, 0.0) / self.scale
        out = scaled * np.where(follows, 1.0, np.sqrt(1 - self.memory**2))
        out[:-1] -= np.where(follows[1:], self.memory * scaled[1:], 0.0)
        return out


def weighting_of(errors: Sequence[np.ndarray], measured: Sequence[np.ndarray]) -> Weighting:
    """Memory and scale of what a model leaves of the sensors.

    The memory is the correlation of neighbours, which maximises the likelihood but for the first samples. It is
    bounded, so that no sensor is switched off: n readings of memory a count as n·(1 − a)/(1 + a) independent ones. Both
    are what the errors show, whatever uncertainty is stated: that of an encoder may be one of its mounting, not of its
    steps.

    Parameters
    ----------
    errors : sequence of ndarray (t, y)
        Of each segment, in times the noise.
    measured : sequence of ndarray (t, y)
    """
    pairs = [m[1:] & m[:-1] for m in measured]
    before = np.concatenate([np.where(pair, e[:-1], 0.0) for e, pair in zip(errors, pairs, strict=True)])
    after = np.concatenate([np.where(pair, e[1:], 0.0) for e, pair in zip(errors, pairs, strict=True)])
    count = np.maximum(np.concatenate(pairs).sum(axis=0), 1)
    square = np.sum(before**2, axis=0)
    memory = np.sum(before * after, axis=0) / np.where(square > 0, square, 1.0)
    largest = np.maximum((count - FEWEST_INDEPENDENT) / (count + FEWEST_INDEPENDENT), SMALLEST_MEMORY)
    memory = np.clip(memory, SMALLEST_MEMORY, largest)
    scale = np.sqrt(np.sum((after - memory * before) ** 2, axis=0) / count)
    return Weighting(memory, np.maximum(scale, SMALLEST_SCALE))
