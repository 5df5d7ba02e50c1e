"""Measured responses of the controlled bed beside the vehicle and the prediction of the match."""

from __future__ import annotations

import math
import shutil
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from matching.match.case import Box, Case, of_system
from matching.match.loop import bed_set, controller_of, frequency_response, responses, vehicle_response
from matching.match.responses import ComparedBed
from modelling.display import Displayed
from modelling.errors import InputError, listed
from modelling.fidelity.measures import WEIGHTS, Fidelity, SignalPair, fidelity_distribution, fidelity_of_signals
from modelling.linear.state_space import state_space
from modelling.modal.modes import modes
from modelling.recordings.read import Channel, read_signals
from modelling.recordings.readers import READERS
from modelling.recordings.recording import Recording
from modelling.recordings.text import read_csv
from modelling.system import System

# --- Frequency responses from recordings of any excitation, by local rational models, with their covariance.
#
# Around each frequency the spectra obey Y·(1 + d₁r + d₂r²) = (G + g₁r + g₂r²)·U + t₀ + t₁r + t₂r², r the distance in
# frequency: a rational response and a smooth transient that the beginning and the end of a recording leave behind. It
# is
# linear in its unknowns, takes any number of inputs, and needs neither periods nor windows (McKelvey and Guérin, IFAC
# Proc. Vol. 45 (2012) 1431; Pintelon and Schoukens, System Identification, 2012, chapter 7). Recordings share the
# response; each has its own transient.

DEGREE = 2  # of response, transient and denominator over one window
FREEDOM = 1.5  # lines in a window over unknowns, at least: what is left over measures the noise
SINGULAR = 1e-9  # of the largest singular value of a scaled window: below it an input does not excite


@dataclass(frozen=True)
class Spectra:
    """One recording: frequencies (l,), Hz, spectra of inputs (l, u) and outputs (l, y)."""

    frequencies: np.ndarray
    inputs: np.ndarray
    outputs: np.ndarray


@dataclass(frozen=True)
class MeasuredResponse:
    """Responses at frequencies (f,), Hz.

    Attributes
    ----------
    values : ndarray (f, y, u)
        Output per input; NaN where it is not determined.
    variances : ndarray (f, y, u)
        Of the complex values: real and imaginary part together.
    windows : ndarray (f,)
        Hz, width of the window that each value was taken from.
    """

    frequencies: np.ndarray
    values: np.ndarray
    variances: np.ndarray
    windows: np.ndarray


def spectra(inputs: np.ndarray, outputs: np.ndarray, step: float, top: float) -> Spectra:
    """Spectra of signals (t, u), (t, y) at even steps (s), up to ``top`` (Hz), without their means."""
    count = len(inputs)
    frequencies = np.fft.rfftfreq(count, step)
    kept = (frequencies > 0) & (frequencies <= top)
    both = np.fft.rfft(np.hstack([inputs - inputs.mean(axis=0), outputs - outputs.mean(axis=0)]), axis=0)[kept]
    both /= np.sqrt(count)
    u = inputs.shape[1]
    return Spectra(frequencies[kept], both[:, :u], both[:, u:])


def estimated_response(recordings: Sequence[Spectra], frequencies: np.ndarray) -> MeasuredResponse:
    """Responses at frequencies (f,), Hz, from one or several recordings of the same system."""
    first = recordings[0]
    u, y = first.inputs.shape[1], first.outputs.shape[1]
    lines = lines_needed(u, len(recordings))
    if any(len(recording.frequencies) < lines for recording in recordings):
        raise ValueError(f"{lines} lines are needed")
    values = np.full((len(frequencies), y, u), np.nan, complex)
    variances = np.full((len(frequencies), y, u), np.inf)
    windows = np.zeros(len(frequencies))
    for i, frequency in enumerate(frequencies):
        near = [_nearest(recording.frequencies, frequency, lines) for recording in recordings]
        windows[i] = max(np.ptp(recording.frequencies[at]) for recording, at in zip(recordings, near, strict=True))
        for output in range(y):
            values[i, output], variances[i, output] = _one(recordings, near, frequency, windows[i], output)
    return MeasuredResponse(np.asarray(frequencies, float), values, variances, windows)


def lines_needed(inputs: int, recordings: int) -> int:
    """Lines of each recording in a window."""
    unknown = (DEGREE + 1) * (inputs + recordings) + DEGREE
    return int(np.ceil((FREEDOM * unknown + 2) / recordings)) | 1


def _nearest(frequencies: np.ndarray, frequency: float, count: int) -> slice:
    middle = int(np.searchsorted(frequencies, frequency))
    start = min(max(middle - count // 2, 0), len(frequencies) - count)
    return slice(start, start + count)


def _one(
    recordings: Sequence[Spectra], near: Sequence[slice], frequency: float, width: float, output: int
) -> tuple[np.ndarray, np.ndarray]:
    """Values (u,) and variances (u,) of one output at one frequency."""
    count, u = len(recordings), recordings[0].inputs.shape[1]
    rows, wanted = [], []
    for i, (recording, lines) in enumerate(zip(recordings, near, strict=True)):
        powers = ((recording.frequencies[lines] - frequency) / (width / 2))[:, None] ** np.arange(DEGREE + 1)
        answer = recording.outputs[lines, output]
        driven = [powers * recording.inputs[lines, j, None] for j in range(u)]
        block = [powers if i == j else np.zeros_like(powers) for j in range(count)]
        rows.append(np.hstack([*driven, *block, -powers[:, 1:] * answer[:, None]]))
        wanted.append(answer)
    matrix, right = np.vstack(rows), np.concatenate(wanted)
    scale = np.linalg.norm(matrix, axis=0)
    missing = np.full(u, np.nan, complex), np.full(u, np.inf)
    if not (scale[: u * (DEGREE + 1)] > 0).all() or not np.linalg.norm(right) > 0:
        return missing
    scale[scale == 0] = 1.0
    left, sizes, turned = np.linalg.svd(matrix / scale, full_matrices=False)
    if sizes[-1] < SINGULAR * sizes[0]:
        return missing
    solution = (turned.conj().T @ ((left.conj().T @ right) / sizes)) / scale
    freedom = len(right) - matrix.shape[1]
    noise = float(np.sum(np.abs(right - matrix @ solution) ** 2)) / freedom
    spread = np.sum(np.abs(turned.conj().T / sizes) ** 2, axis=1) / scale**2
    at = np.arange(u) * (DEGREE + 1)
    return solution[at], noise * spread[at]


# --- Frequency and damping of a mode from measured responses: one pair of poles that all functions share.

FITTED_BAND_RATIO = 1.3  # a mode is fitted from its expected frequency over this to its frequency times this
RESIDUAL_DEGREE = 2  # of the numerator: what other modes add is smooth so near to this one
LEAST_DEVIATION = 1e-6  # of the largest value: no value counts as exact
LARGEST_MISFIT_RATIO = 0.3  # over the misfit of a polynomial alone: above it the responses show no mode here
LARGEST_RELATIVE_UNCERTAINTY = 0.1  # of a frequency that still counts as identified, k = 1


@dataclass(frozen=True)
class MeasuredMode:
    """Frequency (Hz) and damping ratio with standard uncertainties."""

    frequency: float
    frequency_uncertainty: float
    damping_ratio: float
    damping_uncertainty: float


def measured_mode(measured: MeasuredResponse, frequency: float, damping: float) -> MeasuredMode | None:
    """The mode near an expected one (Hz, damping ratio); None where the responses do not show it.

    Each function is (c₀ + c₁q + c₂q²)/(s² + 2ζωs + ω²), q the relative distance in frequency: for given ω and ζ linear
    in c, so only ω and ζ are searched for (variable projection, Golub and Pereyra 1973).
    """
    low, high = frequency / FITTED_BAND_RATIO, frequency * FITTED_BAND_RATIO
    near = (measured.frequencies > low) & (measured.frequencies < high)
    values = measured.values[near].reshape(near.sum(), -1)
    deviations = np.sqrt(measured.variances[near].reshape(near.sum(), -1))
    known = np.isfinite(values).all(axis=0) & np.isfinite(deviations).all(axis=0)
    f = measured.frequencies[near]
    if len(f) < 2 * (RESIDUAL_DEGREE + 3) or not known.any():
        return None
    values, deviations = values[:, known], deviations[:, known]
    deviations = np.maximum(deviations, LEAST_DEVIATION * np.abs(values).max(axis=0))
    powers = ((f - frequency) / frequency)[:, None] ** np.arange(RESIDUAL_DEGREE + 1)
    s = 2j * np.pi * f

    def residual(x: np.ndarray) -> np.ndarray:
        omega, zeta = 2 * np.pi * np.exp(x[0]), x[1]
        shape = powers / (s**2 + 2 * zeta * omega * s + omega**2)[:, None]
        parts = []
        for value, deviation in zip(values.T, deviations.T, strict=True):
            weighted, right = shape / deviation[:, None], value / deviation
            scale = np.linalg.norm(weighted, axis=0)
            c = np.linalg.lstsq(weighted / scale, right, rcond=None)[0]
            rest = right - weighted / scale @ c
            parts += [rest.real, rest.imag]
        return np.concatenate(parts)

    start = np.array([np.log(frequency), damping])
    bounds = [np.log(low), 1e-5], [np.log(high), 0.9]
    optimum = scipy.optimize.least_squares(residual, np.clip(start, *bounds), bounds=bounds, x_scale=[0.05, 0.05])
    freedom = max(len(optimum.fun) - 2 - 2 * (RESIDUAL_DEGREE + 1) * values.shape[1], 1)
    # neighbouring values share spectral lines: as many independent ones as windows fit in
    overlap = max(1.0, len(f) * float(np.mean(measured.windows[near])) / np.ptp(f))
    covariance = np.linalg.pinv(optimum.jac.T @ optimum.jac) * overlap * max(2 * optimum.cost / freedom, 1.0)
    relative, of_damping = np.sqrt(np.diag(covariance))
    if optimum.cost > LARGEST_MISFIT_RATIO * _misfit_without_mode(powers, values, deviations, f, frequency):
        return None
    if relative > LARGEST_RELATIVE_UNCERTAINTY or not bounds[0][0] < optimum.x[0] < bounds[1][0]:
        return None
    value = float(np.exp(optimum.x[0]))
    return MeasuredMode(value, value * float(relative), float(optimum.x[1]), float(of_damping))


def _misfit_without_mode(
    powers: np.ndarray, values: np.ndarray, deviations: np.ndarray, f: np.ndarray, middle: float
) -> float:
    """Half the sum of squares that polynomials leave which have two degrees more, as many unknowns, and no pole."""
    more = ((f - middle) / middle)[:, None] ** np.arange(powers.shape[1] + 2)
    misfit = 0.0
    for value, deviation in zip(values.T, deviations.T, strict=True):
        weighted, right = more / deviation[:, None], value / deviation
        scale = np.linalg.norm(weighted, axis=0)
        rest = right - weighted / scale @ np.linalg.lstsq(weighted / scale, right, rcond=None)[0]
        misfit += float(np.sum(np.abs(rest) ** 2)) / 2
    return misfit


# --- What recordings of the controlled bed show beside vehicle and prediction.

COVERAGE_FACTOR = 2.0


@dataclass(frozen=True)
class ErrorJudgement:
    """A response error of the bed, measured and predicted at the same frequencies.

    Attributes
    ----------
    name : str
        ``measured`` or ``unmeasured`` torques, or ``INPUT → SENSOR``.
    value, uncertainty : float
        Response error and its standard uncertainty; NaN where nothing determines it.
    predicted, expected, allowed : float
        By the match for the bed as planned; what 95 % of beds drawn from ``[uncertainty]`` keep below; by the case.
    resolved : float
        Share of the functions that the recordings show: only these count.
    status : str
        ``as_predicted``, ``short`` or ``undetermined``.
    """

    name: str
    value: float
    uncertainty: float
    predicted: float
    expected: float
    allowed: float
    resolved: float
    status: str

    def to_dict(self) -> dict[str, Any]:
        """As ``verification.json`` holds it; what is not determined is null."""
        known = math.isfinite(self.value) and math.isfinite(self.uncertainty)
        return {
            "name": self.name, "error": self.value if known else None,
            "standard_uncertainty": self.uncertainty if known else None, "predicted": self.predicted,
            "expected": self.expected, "allowed": self.allowed, "resolved": self.resolved, "status": self.status,
        }  # fmt: skip


@dataclass(frozen=True)
class ModeJudgement:
    """A target mode: vehicle and prediction (Hz, damping ratio), and what was measured, None where it does not show."""

    number: int
    vehicle: tuple[float, float]
    predicted: tuple[float, float] | None
    measured: MeasuredMode | None
    status: str

    def to_dict(self) -> dict[str, Any]:
        """As ``verification.json`` holds it."""

        def pair(values: tuple[float, float] | None) -> dict[str, float] | None:
            return None if values is None else {"frequency": values[0], "damping_ratio": values[1]}

        return {
            "vehicle_mode": self.number, "vehicle": pair(self.vehicle), "predicted": pair(self.predicted),
            "measured": None if self.measured is None else dict(vars(self.measured)), "status": self.status,
        }  # fmt: skip


@dataclass(frozen=True)
class RecordedFidelity:
    """XiL fidelity of one recording of the bed against the vehicle's model on the recorded torques (Eqs. 14 to 23).

    Attributes
    ----------
    recording : str
        Path of its file.
    system_dynamics, measurement_uncertainty : float or None
        R_SD and R_MU; None where the recording or the case has nothing to judge them by.
    total, standard_uncertainty : float
        R_XiL and its standard uncertainty.
    of_vehicle : float
        The part of the uncertainty that comes from the vehicle's model.
    interval : tuple of float
        95 % interval of R_XiL.
    """

    recording: str
    system_dynamics: float | None
    measurement_uncertainty: float | None
    total: float
    standard_uncertainty: float
    of_vehicle: float
    interval: tuple[float, float]

    def to_dict(self) -> dict[str, Any]:
        """As ``verification.json`` holds it."""
        return {
            "recording": self.recording, "R_SD": self.system_dynamics, "R_MU": self.measurement_uncertainty,
            "R_XiL": self.total, "standard_uncertainty": self.standard_uncertainty, "of_vehicle": self.of_vehicle,
            "interval": list(self.interval),
        }  # fmt: skip


@dataclass(frozen=True)
class FunctionCurves:
    """One compared function at frequencies (f,): measured with standard uncertainty of its modulus, and the others.

    ``unit`` is the SI unit of the sensor, per N·m.
    """

    input: str
    sensor: str
    unit: str
    frequencies: np.ndarray = field(repr=False)
    measured: np.ndarray = field(repr=False)
    uncertainty: np.ndarray = field(repr=False)
    vehicle: np.ndarray = field(repr=False)
    predicted: np.ndarray = field(repr=False)


@dataclass(frozen=True)
class BedVerification(Displayed):
    """The judgement of recordings of a controlled bed.

    Attributes
    ----------
    status : str
        ``as_predicted``, ``short`` where something measured is worse than predicted and than allowed, beyond its
        uncertainty, or ``undetermined``.
    errors, functions : tuple of ErrorJudgement
        By kind of torque, and by compared function.
    modes : tuple of ModeJudgement
    fidelity : tuple of RecordedFidelity
        Of every recording.
    curves : tuple of FunctionCurves
    band : tuple of float
        Hz.
    notes : tuple of str
    """

    title: str
    status: str
    band: tuple[float, float]
    errors: tuple[ErrorJudgement, ...]
    functions: tuple[ErrorJudgement, ...]
    modes: tuple[ModeJudgement, ...]
    fidelity: tuple[RecordedFidelity, ...]
    curves: tuple[FunctionCurves, ...]
    notes: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """As ``verification.json`` holds it."""
        return {
            "title": self.title,
            "status": self.status,
            "band": list(self.band),
            "coverage_factor": COVERAGE_FACTOR,
            "errors": [error.to_dict() for error in self.errors],
            "functions": [function.to_dict() for function in self.functions],
            "modes": [mode.to_dict() for mode in self.modes],
            "fidelity": [fidelity.to_dict() for fidelity in self.fidelity],
            "notes": list(self.notes),
        }


# --- Response errors of the controlled bed, and whether the match predicted them.

UNKNOWN_VARIANCE = 0.1  # of a response over its square: beyond it nothing is said at that frequency
LARGEST_UNKNOWN = 0.2  # share of the band that may be left out of an error
NEGLIGIBLE = 0.1  # of what the case allows: a smaller error is none that the prediction could be blamed for
CORRECTED = 0.5  # of what the spectral lines change: half-width of what is left after its correction


@dataclass(frozen=True)
class Figures:
    """Mean squares over the logarithm of frequency: error, its variance, prediction; share of the band left out.

    ``resolution`` is by how much the recordings' spectral lines alone change the mean square of the prediction,
    ``vehicles`` (b,) by how much it changes against vehicles drawn from what is not known of them.
    """

    square: float
    variance: float
    predicted: float
    unknown: float
    resolution: float = 0.0
    vehicles: np.ndarray = field(default_factory=lambda: np.zeros(0), repr=False)

    @property
    def known(self) -> bool:
        """Whether enough of the band is determined."""
        return self.unknown <= LARGEST_UNKNOWN

    @classmethod
    def of(
        cls,
        values: np.ndarray,
        variances: np.ndarray,
        vehicle: np.ndarray,
        matched: np.ndarray,
        measured: MeasuredResponse,
        drawn: np.ndarray | None = None,
    ) -> Figures:
        """Of one function (f,), and of drawn vehicles (b, f)."""
        with np.errstate(invalid="ignore", divide="ignore"):
            relative = variances / np.abs(values) ** 2
            error = np.abs(np.log(values / vehicle)) ** 2
        expected = np.abs(np.log(matched / vehicle)) ** 2
        good = np.isfinite(error) & (relative < UNKNOWN_VARIANCE)
        weights = np.gradient(np.log(measured.frequencies))
        weights /= weights.sum()
        unknown = float(weights[~good].sum())
        if unknown > LARGEST_UNKNOWN:
            return cls(math.nan, math.nan, float(weights @ expected), unknown)
        share = np.where(good, weights, 0.0) / weights[good].sum()
        error, relative = np.where(good, error, 0.0), np.where(good, relative, 0.0)
        # |e + n|² has the mean |e|² + v and the variance 2|e|²v + v²; neighbours share spectral lines
        clean = np.maximum(error - relative, 0.0)
        overlap = np.maximum(measured.windows / np.gradient(measured.frequencies), 1.0)
        variance = float(np.sum(share**2 * (2 * clean * relative + relative**2) * overlap))
        square, others = float(share @ error), np.zeros(0)
        if drawn is not None and len(drawn):
            others = np.abs(np.log(np.where(good, values, vehicle) / drawn)) ** 2 @ share - square
        return cls(square - float(share @ relative), variance, float(share @ expected), unknown, vehicles=others)


def judged(name: str, figures: Sequence[Figures], expected: float, allowed: float) -> ErrorJudgement:
    """One judgement of several functions together, of which those count that the recordings show.

    ``as_predicted`` where the error is no larger than predicted within its uncertainty, and surely no larger than
    allowed; ``short`` where it is larger than predicted beyond its uncertainty. Predicted counts as: the match itself,
    or what 95 % of the beds drawn from ``[uncertainty]`` keep below as far as the case allows it.

    Parameters
    ----------
    expected : float
        Error that 95 % of drawn beds keep below.
    allowed : float
        By the case.
    """
    shown = [figure for figure in figures if figure.known]
    resolved = len(shown) / len(figures)
    predicted = math.sqrt(float(np.mean([figure.predicted for figure in shown or figures])))
    if not shown:
        return ErrorJudgement(name, math.nan, math.nan, predicted, expected, allowed, resolved, "undetermined")
    # the prediction, sent through the same lines, shows what they change: it is taken off, and half of it stays unsure
    lines = float(np.mean([figure.resolution for figure in shown]))
    square = max(float(np.mean([figure.square for figure in shown])) - lines, 0.0)
    rest = CORRECTED * abs(lines) / math.sqrt(3)
    spread = math.hypot(math.sqrt(sum(figure.variance for figure in shown)) / len(shown), rest)
    if shown[0].vehicles.size:  # the same drawn vehicles for all functions
        changes = np.mean([figure.vehicles for figure in shown], axis=0)
        spread = math.hypot(spread, float(np.sqrt(np.mean(changes**2))))
    value = math.sqrt(square)
    uncertainty = math.sqrt(square + spread) - value
    limit = max(predicted, NEGLIGIBLE * allowed, min(expected, allowed))
    expanded = COVERAGE_FACTOR * uncertainty
    if value - expanded > limit:
        status = "short"
    else:
        status = "as_predicted" if value + expanded <= max(limit, allowed) else "undetermined"
    return ErrorJudgement(name, value, uncertainty, predicted, expected, allowed, resolved, status)


# --- How far the prediction of a match holds: response errors of beds drawn from what is not known exactly.

BEDS = 64  # drawn evenly
PREDICTION_VEHICLES = 32  # the same
POINTS = 60  # frequencies over the band
SHARE = 0.95  # of the beds that have no larger error


def drawn_squares(case: Case) -> np.ndarray:
    """Mean squares (b, h) of |log(H_bed/H_vehicle)| of drawn beds against the vehicle as the case has it."""
    box = case.uncertainty
    frequencies = np.geomspace(*case.band, POINTS)
    beds = bed_set(case, [box.at(position) for position in box.spread(BEDS)], frequencies)
    acting = frequency_response(controller_of(case), frequencies)
    ratio = responses(beds, acting, acting.known) / vehicle_response(case, {}, frequencies)
    with np.errstate(divide="ignore", invalid="ignore"):
        squares = np.abs(np.log(ratio)) ** 2
    return np.asarray(squares.mean(axis=1))


def drawn_vehicles(case: Case, frequencies: np.ndarray) -> np.ndarray:
    """Compared functions (b, f, h) of vehicles drawn from what the case does not know of them; ``frequencies`` in Hz.

    There are none where it knows all that the rig lacks.
    """
    box = case.uncertainty.of_kind("vehicle.")
    vehicles = [vehicle_response(case, values, frequencies) for values in box_values(box, PREDICTION_VEHICLES)]
    return np.array(vehicles).reshape(-1, len(frequencies), len(case.compared))


def box_values(box: Box, count: int) -> list[dict[str, float]]:
    """Values by name at positions that fill a box evenly; none where nothing is uncertain."""
    return [box.at(position) for position in box.spread(count)] if box.uncertain else []


def largest_expected(squares: np.ndarray) -> float:
    """Response error that 95 % of drawn beds keep below; ``squares`` (b, h) of the functions that count."""
    return float(np.sqrt(np.quantile(squares.mean(axis=1), SHARE)))


# --- Recordings of the controlled bed: which torques excite it, what its sensors answer, at one sample time.

MOVES = 1e-9  # of a torque's largest value: what changes less is constant
PERIODS = 4.0  # of the lowest frequency of the band that a recording has to last


@dataclass(frozen=True)
class BedRecordings:
    """Evenly sampled recordings of a case's compared functions.

    Attributes
    ----------
    recordings : tuple of Recording
    inputs : tuple of str (u)
        Compared torques that excite the bed in at least one recording.
    sensors : tuple of str (y)
        Compared sensors that every recording has.
    notes : tuple of str
    """

    recordings: tuple[Recording, ...]
    inputs: tuple[str, ...]
    sensors: tuple[str, ...]
    notes: tuple[str, ...]

    def signals(self, recording: Recording) -> tuple[np.ndarray, np.ndarray]:
        """Torques (t, u) and readings (t, y) of one recording."""
        rest = np.zeros(len(recording.time))
        torques = np.stack([recording.channels.get(name, rest) for name in self.inputs], axis=1)
        return torques, np.stack([recording[name] for name in self.sensors], axis=1)


def read_recordings(
    paths: Sequence[str | Path],
    case: Case,
    channels: Mapping[str, Channel] | None = None,
    sources: Sequence[str | Path] | None = None,
) -> BedRecordings:
    """Read recordings of the controlled bed with the names of the case's compared functions.

    A compared torque that a recording lacks is taken as constant there. ``sources`` say what the recordings are called
    where the paths are copies.
    """
    torques = list(dict.fromkeys(pair.input for pair in case.compared))
    wanted = list(dict.fromkeys(pair.sensor for pair in case.compared))
    drives = [part.name for part in case.rig.inputs]
    names = {*torques, *wanted, *drives}
    read = [
        replace(read_signals(Path(path), names, channels).resampled(), source=str(source))
        for path, source in zip(paths, sources or paths, strict=True)
    ]
    notes = [f"{recording.source}: {note}" for recording in read for note in recording.notes]
    for recording in read:
        _check_length(recording, case.band)
    sensors = tuple(name for name in wanted if all(name in recording.channels for recording in read))
    if not sensors:
        raise InputError(
            read[0].source,
            f"has none of the compared sensors {listed(wanted)}",
            "record them, or name them in a channel file",
        )
    notes += [f"{name} is not in every recording and not judged" for name in wanted if name not in sensors]
    inputs = tuple(name for name in torques if any(_moves(recording, name) for recording in read))
    if not inputs:
        raise InputError(
            read[0].source,
            f"holds no change of {listed(torques)}",
            "excite the bed with one of these torques and record it",
        )
    notes += [
        f"{name} does not change in any recording: its functions are not judged"
        for name in torques
        if name not in inputs
    ]
    return BedRecordings(tuple(read), inputs, sensors, tuple(notes))


def _moves(recording: Recording, name: str) -> bool:
    if name not in recording.channels:
        return False
    torque = recording[name]
    return bool(np.ptp(torque) > MOVES * max(np.abs(torque).max(), 1e-300))


def _check_length(recording: Recording, band: tuple[float, float]) -> None:
    step, lasts = float(np.median(np.diff(recording.time))), float(np.ptp(recording.time))
    if 1 / step < SAMPLES_A_PERIOD * band[1]:
        raise InputError(
            recording.source,
            f"is sampled at {1 / step:g} Hz",
            f"{SAMPLES_A_PERIOD * band[1]:g} Hz or more is needed for a band up to {band[1]:g} Hz",
        )
    if lasts < PERIODS / band[0]:
        raise InputError(
            recording.source,
            f"lasts {lasts:g} s",
            f"{PERIODS / band[0]:g} s or more is needed for a band from {band[0]:g} Hz",
        )


# --- XiL fidelity of a recording of the controlled bed: the vehicle is simulated on the torques that were recorded.

DRAWS = 2_000
FIDELITY_VEHICLES = 8  # drawn evenly
LONGEST_DELAY = 0.25  # s: a delay beyond it counts as none of the fidelity
SAMPLES_A_PERIOD = 8.0  # of the highest frequency that are enough


def recorded_fidelity(case: Case, recorded: BedRecordings, recording: Recording) -> RecordedFidelity:
    """R_SD of the compared sensors, R_MU and R_XiL with its standard uncertainty (Eqs. 14 to 23) of one recording.

    The vehicle starts at rest with the recording's first sample; both lose their mean, for only deviations are
    compared. The weights are those of the domains there are. What is not known of the vehicle enters the uncertainty.
    """
    fidelity = _against(case, case.vehicle, recorded, recording)
    drawn = fidelity_distribution(fidelity, DRAWS).summary()["total"]
    others = [
        _against(case, case.vehicle.with_values(of_system(values, case.vehicle)), recorded, recording).total
        for values in box_values(case.uncertainty.of_kind("vehicle."), FIDELITY_VEHICLES)
    ]
    of_vehicle = float(np.sqrt(np.mean((np.array(others) - fidelity.total) ** 2))) if others else 0.0
    below, above = (np.hypot(fidelity.total - end, COVERAGE_FACTOR * of_vehicle) for end in drawn.interval)
    lower, upper = (fidelity.total - below, fidelity.total + above) if others else drawn.interval
    return RecordedFidelity(
        recording.source,
        system_dynamics=fidelity.domains.get("system_dynamics"),
        measurement_uncertainty=fidelity.domains.get("measurement_uncertainty"),
        total=fidelity.total,
        standard_uncertainty=float(np.hypot(drawn.standard_uncertainty, of_vehicle)),
        of_vehicle=of_vehicle,
        interval=(float(lower), float(upper)),
    )


def _against(case: Case, system: System, recorded: BedRecordings, recording: Recording) -> Fidelity:
    """Fidelity of a recording against a vehicle."""
    torques, readings = recorded.signals(recording)
    step = float(np.mean(np.diff(recording.time)))
    vehicle = state_space(system)
    drive = np.zeros((len(torques), len(vehicle.inputs)))
    for j, name in enumerate(recorded.inputs):
        drive[:, vehicle.inputs.index(name)] = torques[:, j] - torques[0, j]
    A, B, C, D, _ = scipy.signal.cont2discrete((vehicle.A, vehicle.B, vehicle.C, vehicle.D), step, "foh")
    answer = scipy.signal.dlsim((A, B, C, D, step), drive)[1]
    every = max(int(1 / (SAMPLES_A_PERIOD * case.band[1] * step)), 1)
    units = {sensor.name: sensor.uncertainty for sensor in case.rig.sensors}
    pairs = {}
    for i, name in enumerate(recorded.sensors):
        reference, test = (trace - trace.mean() for trace in (answer[:, vehicle.outputs.index(name)], readings[:, i]))
        if np.ptp(reference) <= 0:
            continue
        u = units.get(name)
        pairs[name] = SignalPair(reference[::every], test[::every], None if u is None else COVERAGE_FACTOR * u)
    domains = ["system_dynamics"]
    if any(pair.expanded_uncertainty is not None for pair in pairs.values()):
        domains.append("measurement_uncertainty")
    total = sum(WEIGHTS[name] for name in domains)
    time = recording.time[::every] - recording.time[0]
    return fidelity_of_signals(
        np.arange(len(time)) * step * every, pairs, f_max=case.band[1],
        weights={name: WEIGHTS[name] / total for name in domains}, longest_delay=min(LONGEST_DELAY, time[-1] / 4),
    )  # fmt: skip


# --- Recordings that are still being written, for a person who stands at the bed.

POLL_SECONDS = 0.25  # between two looks at the files
TEXT = tuple(suffix for suffix, reader in READERS.items() if reader is read_csv)  # written line by line


def appeared(places: Sequence[Path]) -> None:
    """Wait until there is a file at one of the places."""
    while not any(place.is_file() for place in places):
        time.sleep(POLL_SECONDS)


def snapshots(recordings: Sequence[Path], still: float, folder: Path) -> Iterator[tuple[Path, ...]]:
    """Copies of recordings now, and again each time that one has changed, until none has for ``still`` seconds.

    A copy in ``folder`` keeps its file's name. Of text, whole lines are copied. A file that is not there for a moment,
    as where a logger begins a new one, is waited for as long.
    """
    for path in recordings:
        if not path.is_file():
            raise InputError(str(path), "is no file", "give recordings that have been begun")
    changed = time.monotonic()
    copied: list[tuple[int, int, int] | None] = []
    while True:
        states = [_state(path) for path in recordings]
        changes = None not in states and states != copied
        copies = _copies(recordings, folder) if changes else ()
        if copies:
            copied, changed = states, time.monotonic()
            yield copies
        elif time.monotonic() - changed >= still:
            break
        else:
            time.sleep(POLL_SECONDS)
    if None in states:
        raise InputError(str(recordings[states.index(None)]), "is not there any more", "leave it where it is")


def _state(path: Path) -> tuple[int, int, int] | None:
    """What changes where a file is written to, or another takes its place; None: there is none."""
    try:
        about = path.stat()
    except FileNotFoundError:
        return None
    return about.st_ino, about.st_size, about.st_mtime_ns


def _copies(recordings: Sequence[Path], folder: Path) -> tuple[Path, ...]:
    """One of each recording; none at all where one of them is gone by now."""
    try:
        return tuple(_copy(path, folder / str(number)) for number, path in enumerate(recordings))
    except FileNotFoundError:
        return ()


def _copy(path: Path, folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    copy = folder / path.name
    shutil.copyfile(path, copy)
    if path.suffix.lower() in TEXT:
        content = copy.read_bytes()
        copy.write_bytes(content[: content.rfind(b"\n") + 1])
    return copy


# --- Judge

FINEST = 0.01  # relative distance of neighbouring frequencies
BEYOND_BAND = 1.3  # spectra reach so far, for the windows at its upper end
FIT_VARIANCE = 1e-8  # relative, of responses that are computed


def judge(case: Case, recorded: BedRecordings) -> BedVerification:
    """Judge recordings of the bed of a tuned case."""
    grid, recordings = _frequencies(recorded, case.band), _spectra(recorded, case.band)
    measured = estimated_response(recordings, grid)
    bed = ComparedBed(case)
    answers = bed.at(grid)
    pairs = [
        (h, source, sensor)
        for h, (source, sensor) in enumerate(answers.pairs)
        if source in recorded.inputs and sensor in recorded.sensors
    ]
    places = [(h, *_place(recorded, source, sensor)) for h, source, sensor in pairs]
    again = _predicted_again(recordings, bed, places, grid)
    units = {part.name: part.unit for part in case.rig.sensors}
    functions, vehicles = [], drawn_vehicles(case, grid)
    for (h, source, sensor), (_, y, u) in zip(pairs, places, strict=True):
        values, variances = measured.values[:, y, u], measured.variances[:, y, u]
        known = bool(bed.measured[h])
        figures = Figures.of(
            values, variances, answers.vehicle[:, h], answers.matched[:, h], measured, vehicles[:, :, h]
        )
        repeated = Figures.of(
            again.values[:, y, u], np.zeros(len(grid)), answers.vehicle[:, h], answers.matched[:, h], again
        )
        figures = replace(figures, resolution=repeated.square - repeated.predicted)
        curves = FunctionCurves(
            source, sensor, units[sensor], grid, values, np.sqrt(variances / 2), answers.vehicle[:, h],
            answers.matched[:, h],
        )  # fmt: skip
        functions.append(_Function("measured" if known else "unmeasured", h, figures, curves))
    allowed = {"measured": case.tolerance, "unmeasured": case.unmeasured_tolerance}
    drawn = drawn_squares(case)
    errors = []
    for kind in dict.fromkeys(function.kind for function in functions):
        alike = [function for function in functions if function.kind == kind]
        shown = [function for function in alike if function.figures.known] or alike
        expected = largest_expected(drawn[:, [function.number for function in shown]])
        errors.append(judged(kind, [function.figures for function in alike], expected, allowed[kind]))
    each = [
        judged(
            function.name, [function.figures], largest_expected(drawn[:, [function.number]]), allowed[function.kind]
        )
        for function in functions
    ]  # fmt: skip
    mode_checks = _modes(case, recordings, bed, places)
    fidelity = tuple(recorded_fidelity(case, recorded, recording) for recording in recorded.recordings)
    states = [*(checked.status for checked in errors), *(checked.status for checked in mode_checks)]
    return BedVerification(
        case.title, _together(states), case.band, tuple(errors), tuple(each), tuple(mode_checks), fidelity,
        tuple(function.curves for function in functions), (*recorded.notes, *_hidden(functions)),
    )  # fmt: skip


@dataclass(frozen=True)
class _Function:
    """A compared function: whether its torque is measured or unmeasured, its number, figures, and curves."""

    kind: str
    number: int
    figures: Figures
    curves: FunctionCurves

    @property
    def name(self) -> str:
        return f"{self.curves.input} → {self.curves.sensor}"


def _hidden(functions: Sequence[_Function]) -> list[str]:
    """Sentences on what the recordings do not show."""
    return [
        f"{function.name} is left out of the answer: it shows in {1 - function.figures.unknown:.0%} of the band only, "
        "the rest lies below the noise"
        for function in functions
        if not function.figures.known
    ]


def _place(recorded: BedRecordings, source: str, sensor: str) -> tuple[int, int]:
    return recorded.sensors.index(sensor), recorded.inputs.index(source)


def _together(states: Sequence[str]) -> str:
    """Short if anything is short, else undetermined if anything is."""
    return next((status for status in ("short", "undetermined") if status in states), "as_predicted")


def _frequencies(recorded: BedRecordings, band: tuple[float, float]) -> np.ndarray:
    """Frequencies (f,), Hz, over the band: as fine as half the windows that the longest recording allows."""
    longest = max(float(np.ptp(recording.time)) for recording in recorded.recordings)
    width = lines_needed(len(recorded.inputs), len(recorded.recordings)) / longest
    grid = [band[0]]
    while grid[-1] < band[1]:
        grid.append(grid[-1] + max(FINEST * grid[-1], width / 4))
    return np.array([*grid[:-1], band[1]])


def _spectra(recorded: BedRecordings, band: tuple[float, float]) -> list[Spectra]:
    """Spectra of every recording, long enough for one window of :func:`response`."""
    of_recordings = []
    for recording in recorded.recordings:
        step = float(np.mean(np.diff(recording.time)))
        of_recordings.append(spectra(*recorded.signals(recording), step, BEYOND_BAND * band[1]))
    lines = lines_needed(len(recorded.inputs), len(of_recordings))
    for recording, spectrum in zip(recorded.recordings, of_recordings, strict=True):
        if len(spectrum.frequencies) < lines:
            raise InputError(
                recording.source, f"is too short for so many inputs: {lines} lines are needed", "record longer"
            )
    return of_recordings


def _predicted_again(
    recordings: Sequence[Spectra], bed: ComparedBed, places: Sequence[tuple[int, int, int]], grid: np.ndarray
) -> MeasuredResponse:
    """The predicted responses as the recordings would show them without noise: what they cannot resolve is missing."""
    predicted = []
    for recording in recordings:
        matched = bed.at(recording.frequencies).matched
        outputs = np.zeros_like(recording.outputs)
        for h, y, u in places:
            outputs[:, y] += matched[:, h] * recording.inputs[:, u]
        predicted.append(replace(recording, outputs=outputs))
    return estimated_response(predicted, grid)


def _modes(
    case: Case, recordings: Sequence[Spectra], bed: ComparedBed, places: Sequence[tuple[int, int, int]]
) -> list[ModeJudgement]:
    """Target modes by one estimator for vehicle, prediction and bed: the same frequencies, the same shape."""
    known, out = modes(case.vehicle), []
    for target in case.targets:
        mode = known[target.mode - 1]
        if not case.band[0] <= mode.frequency <= case.band[1]:
            continue
        fine = np.geomspace(mode.frequency / 1.3, mode.frequency * 1.3, 60)
        answers = bed.at(fine)
        computed = [
            MeasuredResponse(
                fine, values[:, [h for h, *_ in places]][:, :, None],
                FIT_VARIANCE * np.abs(values[:, [h for h, *_ in places]][:, :, None]) ** 2, np.full(len(fine), 1e-9),
            )
            for values in (answers.vehicle, answers.matched)
        ]  # fmt: skip
        vehicle, predicted = (
            measured_mode(computation, mode.frequency, mode.damping_ratio) for computation in computed
        )
        if vehicle is None:
            continue
        start = predicted or vehicle
        local = estimated_response(recordings, fine)
        rows = np.array([(y, u) for _, y, u in places])
        picked = MeasuredResponse(
            fine,
            local.values[:, rows[:, 0], rows[:, 1], None],
            local.variances[:, rows[:, 0], rows[:, 1], None],
            local.windows,
        )
        fitted = measured_mode(picked, start.frequency, start.damping_ratio)
        status = _mode_status(fitted, vehicle, predicted, target.frequency_tolerance, target.damping_tolerance)
        out.append(
            ModeJudgement(
                target.mode, (vehicle.frequency, vehicle.damping_ratio),
                None if predicted is None else (predicted.frequency, predicted.damping_ratio), fitted, status,
            )
        )  # fmt: skip
    return out


def _mode_status(
    measured: MeasuredMode | None,
    vehicle: MeasuredMode,
    predicted: MeasuredMode | None,
    relative: float,
    damping: float,
) -> str:
    """Short where a deviation is larger than allowed, and than predicted, beyond its uncertainty."""
    if measured is None:
        return "undetermined"
    promised = vehicle if predicted is None else predicted
    states = []
    for value, u, right, expected, tolerance in (
        (
            measured.frequency, measured.frequency_uncertainty, vehicle.frequency, promised.frequency,
            relative * vehicle.frequency,
        ),
        (measured.damping_ratio, measured.damping_uncertainty, vehicle.damping_ratio, promised.damping_ratio, damping),
    ):  # fmt: skip
        limit = max(tolerance, abs(expected - right))
        off, expanded = abs(value - right), COVERAGE_FACTOR * u
        if off - expanded > limit:
            states.append("short")
        else:
            states.append("as_predicted" if off <= limit and expanded <= limit else "undetermined")
    return _together(states)
