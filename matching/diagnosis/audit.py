"""The audit of the channels, before any physics: name, time, sign, gain, resolution and lines of every channel.

Every measured channel is held against the simulation of the model as given. What the audit finds is mended first
(exchanged channels, hum of the mains) or is the first hypothesis of the search (times), so that no effect of the
drivetrain stands in for a fault of a channel.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from scipy import fft
from scipy.optimize import linear_sum_assignment

from matching.diagnosis.base import as_hypothesis, fit_base
from matching.diagnosis.data import FitData, Segment
from matching.diagnosis.descent import Fit, FitOptions, solve
from matching.diagnosis.hypotheses import at_noise, rms_errors
from matching.diagnosis.problem import base_problem
from matching.diagnosis.settings import DiagnosisSettings
from matching.diagnosis.times import Times
from modelling.effects.effect import shared_place
from modelling.effects.sensors_and_actuators import ClockOffset, DeadTime, Lag, SensorDelay, SensorGain
from modelling.errors import FitError
from modelling.recordings.channel_faults import ChannelFault, conversion, fault, likeliest_fault
from modelling.recordings.corrections import resolution
from modelling.system import System

# --- Exchanged channels: each measured one against each simulated one of its quantity.

FAR, CLEARLY = 0.1, 0.5  # error over the spread of a channel as labelled, and times that of the exchanged one at most


def exchanged(system: System, measured: np.ndarray, simulated: np.ndarray) -> list[int]:
    """For every sensor the one whose readings it seems to have: itself, or another of the same quantity.

    The assignment with the least error of all (Hungarian method), where that of each channel that moves is clearly
    smaller so.

    Parameters
    ----------
    measured, simulated : ndarray (t, y)
        SI; NaN where nothing was measured.
    """
    order = list(range(len(system.sensors)))
    for same in _alike(system, measured):
        cost = np.array([[_error(measured[:, i], simulated[:, j]) for i in same] for j in same])
        rows, columns = linear_sum_assignment(cost)
        moved = [(r, c) for r, c in zip(rows, columns, strict=True) if r != c]
        if moved and all(cost[r, r] > FAR and cost[r, c] < CLEARLY * cost[r, r] for r, c in moved):
            for r, c in moved:
                order[same[r]] = same[c]
    return order


def _alike(system: System, measured: np.ndarray) -> Iterator[list[int]]:
    """Sensors of one quantity each that were measured and move; encoders have zeros of their own and are left out."""
    for quantity in dict.fromkeys(sensor.measures for sensor in system.sensors):
        same = [j for j, sensor in enumerate(system.sensors) if sensor.measures == quantity]
        same = [j for j in same if np.isfinite(measured[:, j]).any() and np.nanstd(measured[:, j]) > 0]
        if len(same) > 1 and quantity != "angle":
            yield same


def reordered(data: FitData, order: Sequence[int]) -> FitData:
    """Data whose sensors have the readings of others; whether noise belongs to the sensor or to its channel is not
    known, so the larger one is taken."""
    order = list(order)
    segments = tuple(replace(s, readings=s.readings[:, order]) for s in data.segments)
    return replace(data, segments=segments, noise=np.maximum(data.noise, data.noise[order]))


def _both(fit: Fit) -> tuple[np.ndarray, np.ndarray]:
    """Measured and simulated readings (t, y) of all segments, SI."""
    segments = fit.problem.data.segments
    return np.concatenate([s.readings for s in segments]), np.concatenate(fit.problem.simulated(fit.v))


def _error(measured: np.ndarray, simulated: np.ndarray) -> float:
    """Root mean square error of a channel (t,) over its spread."""
    known = np.isfinite(measured)
    return float(np.std(measured[known] - simulated[known]) / np.std(measured[known]))


def with_channels_of(system: System, base: Fit, data: FitData, settings: DiagnosisSettings) -> tuple[list[int], Fit]:
    """The order of the sensors' readings, and the base fit with it: another than that of the labels only where the fit
    is clearly better so.

    Channels are compared with the simulation at the stated values, then with that of the base fit. Where channels of
    one quantity are exchanged, those of the others are tried pair by pair: whole sides may be.
    """
    same, (measured, _) = list(range(len(system.sensors))), _both(base)
    problem, v = base_problem(system, data)
    order = same
    for simulated in (np.concatenate(problem.simulated(v)), _both(base)[1]):
        if order == same and np.isfinite(simulated).all():
            order = exchanged(system, measured, simulated)
    if order == same:
        return same, base
    best = _refitted(system, data, order, settings)
    if best is None or best.cost > CLEARLY**2 * base.cost:
        return same, base
    for pair in [pair for group in _alike(system, measured) for pair in combinations(group, 2)]:
        other = list(order)
        for i, j in (pair, pair[::-1]):
            other[i] = order[j]
        fit = None if any(order[j] != j for j in pair) else _refitted(system, data, other, settings)
        if fit is not None and fit.cost < CLEARLY**2 * best.cost:
            order, best = other, fit
    return order, best


def _refitted(system: System, data: FitData, order: Sequence[int], settings: DiagnosisSettings) -> Fit | None:
    try:
        return fit_base(system, reordered(data, order), settings)
    except FitError:
        return None


# --- Hum of the mains: a line in what the model leaves of one channel, at a multiple of 50 or 60 Hz or its alias.

MAINS, MULTIPLES = (50.0, 60.0), 6  # Hz, and how many multiples are looked at
LINE = 40.0  # power of a line over that of its neighbours: in 1e7 noise spectra one line is as large
DRIVEN = 10.0  # the same of an input, from which a line is its own
NEIGHBOURS, GUARD = 12, 2  # bins to each side, and next to the line, which its own width fills
STEADY = 0.7  # of the amplitude, that the mean of the halves' phasors keeps: a line of the drive changes its phase


@dataclass(frozen=True)
class Hum:
    """A line of the mains in a channel: frequency as it shows, Hz, amplitude, SI, and the multiple it is of."""

    sensor: str
    frequency: float
    amplitude: float
    source: str


def find_hum(system: System, fit: Fit) -> list[Hum]:
    """Lines of the mains in what a fit leaves of its longest segment."""
    index = max(range(len(fit.errors)), key=lambda i: len(fit.errors[i]))
    segment, errors = fit.problem.data.segments[index], fit.errors[index]
    step = float(np.median(np.diff(segment.time)))
    if np.ptp(np.diff(segment.time)) > 0.2 * step:
        return []
    out = []
    for j, sensor in enumerate(system.sensors):
        if segment.measured[:, j].all():
            out += _lines(sensor.name, errors[:, j] * fit.problem.data.noise[j], segment.inputs, step)
    return out


def _lines(name: str, left: np.ndarray, inputs: np.ndarray, step: float) -> list[Hum]:
    """Lines of the mains in a residual (t,) at even steps, s, that no input (t, u) has: else a wrong model leaves
    them."""
    spectrum = _spectrum(left)
    driven = [_spectrum(column) for column in inputs.T]
    resolved, out, taken = 1 / (len(left) * step), list[Hum](), set[int]()
    for mains in MAINS:
        for multiple in range(1, MULTIPLES + 1):
            alias = abs(mains * multiple - round(mains * multiple * step) / step)
            at = round(alias / resolved)
            near = slice(max(at - 1, 0), at + 2)
            if at <= NEIGHBOURS + GUARD or at + NEIGHBOURS + GUARD + 1 >= len(spectrum) or at in taken:
                continue
            beside = np.r_[at - NEIGHBOURS - GUARD : at - GUARD, at + GUARD + 1 : at + GUARD + 1 + NEIGHBOURS]
            if spectrum[near].max() < LINE * np.median(spectrum[beside]):
                continue
            if any(power[near].max() > DRIVEN * np.median(power[beside]) for power in driven):
                continue
            halves = [_phasor(part, np.arange(len(left))[p] * step, alias) for p, part in _halves(left)]
            size = float(np.mean(np.abs(halves)))
            if abs(np.mean(halves)) > STEADY * size:
                taken |= {at - 1, at, at + 1}
                out.append(Hum(name, alias, float(abs(np.mean(halves))), f"{multiple} × {mains:g} Hz"))
    return out


def _spectrum(values: np.ndarray) -> np.ndarray:
    """Power (f,) of values (t,)."""
    return np.abs(fft.rfft((values - values.mean()) * np.hanning(len(values)))) ** 2


def _halves(values: np.ndarray) -> list[tuple[slice, np.ndarray]]:
    middle = len(values) // 2
    return [(p, values[p]) for p in (slice(0, middle), slice(middle, len(values)))]


def _phasor(values: np.ndarray, time: np.ndarray, frequency: float) -> complex:
    """Amplitude and phase of a line in values (t,)."""
    turning = np.exp(-2j * np.pi * frequency * time)
    window = np.hanning(len(values))
    return complex(2 * np.sum(window * (values - values.mean()) * turning) / np.sum(window))


def without_hum(system: System, data: FitData, fit: Fit, hum: Sequence[Hum]) -> FitData:
    """Data from whose readings the lines are taken off, with amplitude and phase of every segment, as a fit leaves
    them; of segments that the fit does not have, as their readings without slow parts show them."""
    simulated = dict(zip([_key(s) for s in fit.problem.data.segments], fit.problem.simulated(fit.v), strict=True))
    names, segments = [sensor.name for sensor in system.sensors], []
    for segment in data.segments:
        readings = segment.readings.copy()
        own = simulated.get(_key(segment))
        for line in hum:
            j = names.index(line.sensor)
            known = np.isfinite(readings[:, j])
            left = readings[:, j] if own is None else readings[:, j] - np.resize(own[:, j], len(readings))
            angle = 2 * np.pi * line.frequency * segment.time[known]
            columns = np.stack([np.cos(angle), np.sin(angle)], axis=1)
            part = slice(0, None if own is None else min(len(own), len(columns)))
            smooth = _without_slow(left[known][part]) if own is None else left[known][part]
            size = np.linalg.lstsq(columns[part], smooth, rcond=None)[0]
            readings[known, j] -= columns @ size
        segments.append(replace(segment, readings=readings))
    return replace(data, segments=tuple(segments))


def _key(segment: Segment) -> tuple[str, float]:
    return segment.name, float(segment.time[0])


def _without_slow(values: np.ndarray) -> np.ndarray:
    """Values (t,) without what a mean over neighbours keeps."""
    width = 9
    return values - np.convolve(np.pad(values, width // 2, mode="edge"), np.full(width, 1 / width), mode="valid")


# --- Times: groups of channels that are apart.


def time_hypotheses(system: System, fit: Fit, times: Times) -> list[tuple[str, str, dict[str, float]]]:
    """Kind, place and first values of the causes that the times of channels speak for, one for each group that is apart
    from the largest.

    A group with the inputs stays where it is: what is apart from it is the rest.
    """
    largest, *others = times.late.groups() or [[]]
    out: list[tuple[str, str, dict[str, float]]] = []
    for group in others:
        moved, late = group, times.late.between(group, largest)[0]
        if group == [-1]:
            if late < 0 and len(largest) == len(system.sensors):
                out.append(
                    (DeadTime.kind, shared_place(f"inputs.{part.name}" for part in system.inputs), {"delay": -late})
                )
            continue
        if -1 in group:
            moved, late = largest, -late
        places = shared_place(f"sensors.{system.sensors[j].name}" for j in moved)
        alike = len({system.sensors[j].measures for j in moved}) == 1
        if alike and late > 0:  # a clock of late channels of one quantity is the same
            out.append((SensorDelay.kind, places, {"delay": late}))
        else:
            out.append((ClockOffset.kind, places, {"offset": late}))
    for pair in times.pairs:
        if pair.lag and not any(
            kind == Lag.kind and at.endswith(system.sensors[pair.second].name) for kind, at, _ in out
        ):
            out.append((Lag.kind, f"sensors.{system.sensors[pair.second].name}", {"time_constant": pair.lag}))
    return out + [
        (SensorGain.kind, f"sensors.{system.sensors[j].name}", {"factor": times.gain(j)[0]})
        for j in _of_other_gain(system, times)
    ]


def _of_other_gain(system: System, times: Times) -> list[int]:
    """Sensors whose sign or gain is beyond doubt another than that of most, of three at least."""
    largest = next(iter(times.logarithm.groups()), [])
    told = [j for j in range(len(system.sensors)) if np.isfinite(times.gain(j)[0])]
    other = [j for j in told if times.sign[j + 1] < 0 or (j not in largest and len(largest) > 1)]
    return other if len(told) > 2 else []


def notes_on_times(system: System, times: Times, named: Collection[str]) -> list[str]:
    """What is said of channels whose time, sign or gain is apart from that of most.

    A part between two channels that the model has wrong looks the same. Every suspicion was therefore fitted: where
    causes were found, and none at such a channel, that speaks against it and nothing is said.

    Parameters
    ----------
    named : collection of str
        Places of the causes that were found.
    """
    largest, *others = times.stated_late.groups() or [[]]
    names = ["the inputs", *(sensor.name for sensor in system.sensors)]
    notes = []

    def refuted(group: Sequence[int]) -> bool:
        places = {f"sensors.{system.sensors[j].name}" for j in group if j >= 0}
        if -1 in group:
            places |= {f"inputs.{part.name}" for part in system.inputs}
        return bool(named) and places.isdisjoint(named)

    for group in others:
        if refuted(group) and refuted(largest):
            continue
        late, uncertainty = times.stated_late.between(group, largest)
        late_ones, rest = (" and ".join(names[j + 1] for j in part) for part in (group, largest))
        size = f"{abs(late):.4g} ± {uncertainty:.1g} s {'later' if late > 0 else 'earlier'}"
        alone = group != [-1] and len(group) == 1
        said = fault("delay", late_ones, rest, size=size, value=late, mends=late if alone and late > 0 else np.nan)
        words = said.words if len(group) == 1 and group != [-1] else said.words.replace("is ", "are ", 1)
        line = f"; if so, the model needs {said.line}" if said.line else ""
        notes.append(f"{late_ones} {words}, by the part of the model between them alone{line}")
    told = _of_other_gain(system, replace(times, logarithm=times.stated_logarithm))
    for j in told:
        if refuted([j]):
            continue
        gain, uncertainty = times.stated_gain(j)
        sign = "the other sign and " if gain < 0 else ""
        usual = conversion(gain, system.sensors[j].measures, SURE * uncertainty / abs(gain))
        notes.append(
            f"{system.sensors[j].name} has {sign}{abs(gain):.4g} ± {uncertainty:.1g} times the size that most channels "
            f"tell, by the parts of the model between them alone{f': perhaps it {usual.words}' if usual else ''}"
        )
    return notes


SURE = 3.0  # standard uncertainties of a gain, within which a usual conversion is named
ITERATIONS_WITHOUT = 40  # of the fit without a channel, from that with it


def wrong_channel(system: System, fit: Fit, settings: DiagnosisSettings) -> tuple[str, ChannelFault | None]:
    """The one sensor without which the model leaves noise alone in all others; empty where there is none, or several.
    What the others say that it should read tells which fault it has, if it is one of the table.

    What is wrong with a channel alone, as a dead band or a speed that enters a torque, has no kind for each; an effect
    of the drivetrain shows in its neighbours too.
    """
    problem, found = fit.problem, list[tuple[int, Fit]]()
    several = np.count_nonzero(problem.data.readings_by_sensor) > 1
    beyond = np.flatnonzero(rms_errors(fit) > settings.clearly_beyond).tolist() if several else []
    for j in beyond:
        segments = []
        for segment in problem.data.segments:
            readings = segment.readings.copy()
            readings[:, j] = np.nan
            segments.append(replace(segment, readings=readings))
        others = replace(problem, data=replace(problem.data, segments=tuple(segments)))
        try:
            rest = solve(others, fit.v, None, FitOptions(ITERATIONS_WITHOUT))
        except FitError:
            continue
        if at_noise(as_hypothesis(system, rest)):
            found.append((j, rest))
    if len(found) != 1:
        return "", None
    j, rest = found[0]
    parts = [(part[:, j], segment.readings[:, j], float(np.median(np.diff(segment.time)))) for part, segment in
             zip(rest.problem.simulated(rest.v), problem.data.segments, strict=True)]  # fmt: skip
    sensor = system.sensors[j]
    return sensor.name, likeliest_fault(sensor.name, sensor.unit, parts, float(problem.data.noise[j]))


def notes_on(system: System, order: Sequence[int], hum: Sequence[Hum]) -> list[str]:
    """What is said of exchanged channels and of hum."""
    names = [sensor.name for sensor in system.sensors]
    notes = [
        f"{names[j]} has the readings of {names[i]}: exchanged for this diagnosis; the channel file needs "
        f"{fault('exchanged', names[j], names[i]).line}"
        for j, i in enumerate(order)
        if i != j
    ]
    notes += [
        f"{line.sensor} carries hum of the mains at {line.frequency:.4g} Hz ({line.source}), amplitude "
        f"{line.amplitude:.3g} {next(s.unit for s in system.sensors if s.name == line.sensor)}: taken off"
        for line in hum
    ]
    return notes


# --- The table


@dataclass(frozen=True)
class AuditedChannel:
    """A line of the audit.

    Attributes
    ----------
    name : str
    exchanged_with : str
        The channel whose readings it seems to have; empty where it has its own.
    delay, delay_uncertainty : float
        Against the largest group of channels with one time, s; NaN where it is open, or of an input.
    gain, gain_uncertainty : float
        Against most channels, by the parts of the model between them; negative where the sign is the other; NaN where
        it is open, or of an input.
    over_simulated : float
        Measured over simulated, in least squares; NaN of an input.
    resolution : float
        Step to which its values are rounded, SI; 0 where none shows.
    between : str
        Of an input: how it is taken between samples.
    hum : str
        Lines of the mains.
    """

    name: str
    exchanged_with: str = ""
    delay: float = np.nan
    delay_uncertainty: float = np.nan
    gain: float = np.nan
    gain_uncertainty: float = np.nan
    over_simulated: float = np.nan
    resolution: float = 0.0
    between: str = ""
    hum: str = ""

    def to_dict(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        return {key: None if isinstance(v, float) and not np.isfinite(v) else v for key, v in vars(self).items()}


def audited(
    system: System, fit: Fit, times: Times, order: Sequence[int], kinds: Sequence[str], hum: Sequence[Hum]
) -> list[AuditedChannel]:
    """A line for every channel, sensors first."""
    measured, simulated = _both(fit)
    inputs = np.concatenate([segment.inputs for segment in fit.problem.data.segments])
    out = []
    for j, sensor in enumerate(system.sensors):
        known = np.isfinite(measured[:, j])
        if not known.any():
            continue
        a, b = (part[known, j] - part[known, j].mean() for part in (measured, simulated))
        square = float(b @ b)
        other = "" if order[j] == j else system.sensors[order[j]].name
        out.append(
            AuditedChannel(
                sensor.name, other, *times.stated_late.of_channel(j), *times.stated_gain(j),
                float(a @ b) / square if square else np.nan, resolution(measured[known, j]), "",
                ", ".join(line.source for line in hum if line.sensor == sensor.name),
            )
        )  # fmt: skip
    for j, part in enumerate(system.inputs):
        out.append(AuditedChannel(part.name, resolution=resolution(inputs[:, j]), between=kinds[j]))
    return out
