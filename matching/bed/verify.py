"""Measured responses of the controlled bed beside the vehicle and the prediction of the match."""

from __future__ import annotations

import math
import shutil
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from matching.bed.measured import (
    FITTED_BAND_RATIO,
    MeasuredFunction,
    MeasuredMode,
    MeasuredResponse,
    Spectra,
    estimated_response,
    joined,
    lines_needed,
    measured_mode,
    periodic_responses,
    repetition,
    spectra,
)
from matching.bed.plausible import check_commands, check_recording
from matching.bed.tracked import TrackedQuantity, outputs_of, tracked_quantities
from matching.bed.vehicle_beside import InTime, motions_in_time, reached_by_torques
from matching.match.box import Box, of_system
from matching.match.case import Case, once_per_case
from matching.match.exported import controller_on_the_bed
from matching.match.loop import bed_set, frequency_response, responses, vehicle_response
from matching.match.responses import ComparedBed, Responses
from matching.match.targets import target_modes
from modelling.display import Displayed
from modelling.errors import InputError, listed
from modelling.fidelity.measures import WEIGHTS, Fidelity, SignalPair, fidelity_distribution, fidelity_of_signals
from modelling.fidelity.over_range import at_rest
from modelling.linear.state_space import state_space
from modelling.recordings.read import Channel, read_signals
from modelling.recordings.readers import READERS
from modelling.recordings.recording import Recording
from modelling.recordings.text import read_csv
from modelling.system import System
from modelling.units import of_input

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
    interval : tuple of float
        95 % interval of the error.
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
    interval: tuple[float, float]
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
            "standard_uncertainty": self.uncertainty if known else None,
            "interval": list(self.interval) if known else None, "predicted": self.predicted,
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

    ``unit`` is the SI unit of the sensor, ``per`` what of the input it is per one of: ``N*m`` or ``pedal``.
    """

    input: str
    sensor: str
    unit: str
    per: str
    frequencies: np.ndarray = field(repr=False)
    measured: np.ndarray = field(repr=False)
    uncertainty: np.ndarray = field(repr=False)
    vehicle: np.ndarray = field(repr=False)
    predicted: np.ndarray = field(repr=False)


@dataclass(frozen=True)
class OpenQuestion:
    """What recordings leave undetermined, and what would decide it.

    Attributes
    ----------
    name : str
        ``response error to … torques``, ``frequency`` or ``damping ratio of vehicle mode …``.
    expanded : float
        Expanded uncertainty (k = 2) with which it is known, in ``unit``; NaN where it does not show above the noise.
    allowed : float
        By the case.
    unit : str
        Empty for a ratio.
    longer : float
        Times as long a recording under the same torques that would do, as far as its noise decides; infinite where none
        does. Its square root is the factor on the torques.
    of_vehicle : bool
        Whether the uncertainty of the vehicle leaves it open, however long a recording is.
    """

    name: str
    expanded: float
    allowed: float
    unit: str
    longer: float
    of_vehicle: bool = False

    @property
    def because(self) -> str:
        """``near_limit``, or where even a bed without any error would stay undetermined ``vehicle`` or ``excitation``:
        that is too weak for the question."""
        if self.expanded <= self.allowed:
            return "near_limit"
        return "vehicle" if self.of_vehicle else "excitation"

    def to_dict(self) -> dict[str, Any]:
        """As ``verification.json`` holds it; what is not known is null."""
        return {
            "name": self.name, "expanded_uncertainty": self.expanded if math.isfinite(self.expanded) else None,
            "allowed": self.allowed, "unit": self.unit, "because": self.because,
            "times_as_long": self.longer if math.isfinite(self.longer) else None,
        }  # fmt: skip


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
    open : tuple of OpenQuestion
        What the recordings do not decide; what their excitation is too weak for comes first.
    duration : float
        Of all recordings together, s.
    tracked : tuple of TrackedQuantity
        Of each dynamometer, where a recording holds what the controller tracked.
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
    open: tuple[OpenQuestion, ...] = ()
    duration: float = 0.0
    tracked: tuple[TrackedQuantity, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """As ``verification.json`` holds it."""
        return {
            "title": self.title,
            "status": self.status,
            "open": [question.to_dict() for question in self.open],
            "duration": self.duration,
            "band": list(self.band),
            "coverage_factor": COVERAGE_FACTOR,
            "errors": [error.to_dict() for error in self.errors],
            "functions": [function.to_dict() for function in self.functions],
            "modes": [mode.to_dict() for mode in self.modes],
            "fidelity": [fidelity.to_dict() for fidelity in self.fidelity],
            "tracked": [quantity.to_dict() for quantity in self.tracked],
            "notes": list(self.notes),
        }


# --- Response errors of the controlled bed, and whether the match predicted them.

UNKNOWN_VARIANCE = 0.1  # of a response over its square: beyond it a frequency counts as one in the noise
LARGEST_UNKNOWN = 0.2  # share of the band that may lie in the noise
IN_NOISE = 0.3  # of a response over its square: beyond it what was read is judged beside the lines around it
NEGLIGIBLE = 0.1  # of what the case allows: a smaller error is none that the prediction could be blamed for
RICHARDSON = 3.0  # 2² − 1: the trapezoidal rule is of second order
SUFFICIENT = 1 / 3  # of a tolerance: standard uncertainty that decides; a proof is planned by it
LONGEST = 100.0  # times as long as a recording: nobody records longer to decide a question
CORRECTED = 0.5  # of what the spectral lines change: half-width of what is left after its correction


@dataclass(frozen=True)
class Figures:
    """Mean squares over the logarithm of frequency: error, its variance, prediction; share of the band left out.

    ``variance`` is that of the function alone; functions of one torque, ``source``, share noise, which ``lines`` hold.
    ``resolution`` is by how much the recordings' spectral lines alone change the mean square of the prediction,
    ``vehicles`` (b,) by how much it changes against vehicles drawn from what is not known of them.
    """

    square: float
    variance: float
    predicted: float
    unknown: float
    resolution: float = 0.0
    vehicles: np.ndarray = field(default_factory=lambda: np.zeros(0), repr=False)
    lines: Lines | None = field(default=None, repr=False)
    source: str = ""

    @property
    def known(self) -> bool:
        """Whether enough of the band is determined."""
        return self.unknown <= LARGEST_UNKNOWN

    @classmethod
    def of(
        cls,
        function: MeasuredFunction,
        vehicle: np.ndarray,
        matched: np.ndarray,
        band: tuple[float, float],
        drawn: np.ndarray | None = None,
    ) -> Figures:
        """Of one function (f,) in a band (Hz), its vehicle's and predicted values (f,), and those of drawn vehicles
        (b, f)."""
        values, shared = function.values, function.shared
        with np.errstate(invalid="ignore", divide="ignore"):
            relative = function.variances / np.abs(values) ** 2
            error = np.abs(np.log(values / vehicle)) ** 2
        expected = np.abs(np.log(matched / vehicle)) ** 2
        share, read = log_weights(function.frequencies, band), np.isfinite(error)
        unknown = float(share[~(read & (relative < UNKNOWN_VARIANCE))].sum())
        if unknown > LARGEST_UNKNOWN:
            return cls(math.nan, math.nan, float(share @ expected), unknown)
        good = read & (relative < IN_NOISE)
        error, relative = np.where(good, error, 0.0), np.where(good, relative, 0.0)
        with np.errstate(invalid="ignore", divide="ignore"):
            clean = np.log(values / vehicle) * np.sqrt(np.maximum(1 - relative / np.maximum(error, 1e-300), 0.0))
            noise = function.noise / values[:, None]
        clean, noise = np.where(good, clean, 0.0), np.where(good[:, None], noise, 0.0)
        between = 0.0
        if (shared == 1).all():
            between = between_lines(function.frequencies[good], error[good] - relative[good], band)
        below, spread = below_noise(function, vehicle, error - relative, good)
        lines = Lines(share, clean, noise, shared, math.hypot(between, float(share[~good] @ spread)))
        variance = square_variance([lines])
        square, others = float(share @ error), np.zeros(0)
        if drawn is not None and len(drawn):
            others = np.abs(np.log(np.where(good, values, vehicle) / drawn)) ** 2 @ share - square
        square += float(share[~good] @ below)
        predicted = float(share @ expected)
        return cls(square - float(share @ relative), variance, predicted, unknown, vehicles=others, lines=lines)


NEIGHBOURS = 10  # lines above the noise that say how large an error one below it is likely to have
SCALES = (1.0, 4.0, 16.0)  # of that size: where a dip moved, single lines are off by far more than those around it
TURNS, SIZES = 24, 24  # phases and sizes that stand for a circular normal distribution


def below_noise(
    function: MeasuredFunction, vehicle: np.ndarray, squares: np.ndarray, good: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Squares of the error (f',) at the lines that are not ``good`` (f,), and their standard uncertainties.

    There the response has a dip that lies in the noise, and the error is often the largest of the band: a dip that
    moved. It is as likely as the errors (``squares``, f) of the lines around it say, and as what was read there allows;
    of a dip every modulus is as likely as any other, not its logarithm. Lines beside each other are off together.
    """
    if good.all():
        return np.zeros(0), np.zeros(0)
    bad, above = np.flatnonzero(~good), np.flatnonzero(good)
    nearest = np.argsort(np.abs(np.log(function.frequencies[bad, None] / function.frequencies[above])), axis=1)
    size = np.sqrt(np.maximum(squares[above][nearest[:, :NEIGHBOURS]].mean(axis=1), 0.0))
    radii = np.sqrt(-np.log(1 - (np.arange(SIZES) + 0.5) / SIZES))
    circle = (radii[:, None] * np.exp(2j * np.pi * np.arange(TURNS) / TURNS)).ravel()
    error = size[:, None] * np.concatenate([scale * circle for scale in SCALES])  # (f', d)
    ratio = np.exp(error)
    misfit = np.abs(function.values[bad, None] - vehicle[bad, None] * ratio) ** 2 / function.variances[bad, None]
    misfit = np.where(np.isfinite(misfit), misfit, 0.0)  # nothing was read: it is as likely as its neighbours say
    misfit -= np.minimum(error.real, 0.0)
    likely = np.exp(misfit.min(axis=1, keepdims=True) - misfit)
    likely /= likely.sum(axis=1, keepdims=True)
    drawn = np.abs(np.log(ratio)) ** 2
    mean = np.sum(likely * drawn, axis=1)
    return mean, np.sqrt(np.sum(likely * (drawn - mean[:, None]) ** 2, axis=1))


def between_lines(frequencies: np.ndarray, squares: np.ndarray, band: tuple[float, float]) -> float:
    """Standard uncertainty of a mean square (f,) from what may lie between its frequencies.

    The error of the trapezoidal rule is a third of the change from twice the distance (Richardson); the two halves of
    the lines give that change twice.
    """
    if len(squares) < 4:
        return 0.0
    halves = [float(log_weights(frequencies[i::2], band) @ squares[i::2]) for i in (0, 1)]
    return abs(halves[0] - halves[1]) / (2 * RICHARDSON)


def log_weights(frequencies: np.ndarray, band: tuple[float, float]) -> np.ndarray:
    """Shares (f,) of a band's logarithm that values at ``frequencies`` (f,) inside it stand for; they add up to 1."""
    middles = np.log(frequencies[1:] * frequencies[:-1]) / 2
    weights = np.diff([np.log(band[0]), *middles, np.log(band[1])])
    return np.asarray(weights / weights.sum())


@dataclass(frozen=True)
class Lines:
    """A function at its frequencies: what the variance of mean squares is made of.

    Attributes
    ----------
    share : ndarray (f,)
        Weights in the mean square.
    error : ndarray (f,)
        Complex logarithm of the response over the vehicle's.
    noise : ndarray (f, n)
        Of the response over its value, as in :class:`matching.bed.measured.MeasuredFunction`.
    shared : ndarray (f,)
        As there.
    between : float
        Standard uncertainty of the mean square from what may lie between the frequencies.
    """

    share: np.ndarray
    error: np.ndarray
    noise: np.ndarray
    shared: np.ndarray
    between: float = 0.0


def square_variance(functions: Sequence[Lines]) -> float:
    """Variance of the sum of mean squares of functions at the same frequencies.

    For circular normal n, |e + n|² has the variance 2|e|²v + v², v that of n; two of them that share noise have the
    covariance 2 Re(e₁*·e₂·c) + |c|², c = ⟨n₁·n₂*⟩.
    """
    along = sum((one.share * one.error.conj())[:, None] * one.noise for one in functions)
    gram = sum(one.share[:, None, None] * one.noise[:, :, None].conj() * one.noise[:, None, :] for one in functions)
    of_lines = 2 * np.sum(np.abs(along) ** 2, axis=1) + np.sum(np.abs(gram) ** 2, axis=(1, 2))
    return float(of_lines @ functions[0].shared) + sum(one.between**2 for one in functions)


def together_variance(figures: Sequence[Figures]) -> float:
    """Of the sum of the functions' mean squares."""
    total = 0.0
    together: dict[str, list[Lines]] = {}
    for figure in figures:
        if figure.lines is None:
            total += figure.variance
        else:
            together.setdefault(figure.source, []).append(figure.lines)
    return total + sum(square_variance(lines) for lines in together.values())


def interval_of(square: float, spread: float) -> tuple[float, float]:
    """95 % interval of a root mean square whose mean square is known with a standard deviation ``spread``."""
    reach = COVERAGE_FACTOR * spread
    return math.sqrt(max(square - reach, 0.0)), math.sqrt(max(square, 0.0) + reach)


def standard_uncertainty(square: float, spread: float) -> float:
    """Half of what the interval of :func:`interval_of` reaches to its longer side."""
    low, high = interval_of(square, spread)
    value = math.sqrt(max(square, 0.0))
    return max(high - value, value - low) / COVERAGE_FACTOR


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
        unknown = (math.nan, math.nan)
        return ErrorJudgement(name, math.nan, math.nan, unknown, predicted, expected, allowed, resolved, "undetermined")
    # the prediction, sent through the same lines, shows what they change: it is taken off, and half of it stays unsure
    lines = float(np.mean([figure.resolution for figure in shown]))
    square = float(np.mean([figure.square for figure in shown])) - lines
    rest = CORRECTED * abs(lines) / math.sqrt(3)
    spread = math.hypot(math.sqrt(together_variance(shown)) / len(shown), rest)
    if shown[0].vehicles.size:  # the same drawn vehicles for all functions
        changes = np.mean([figure.vehicles for figure in shown], axis=0)
        spread = math.hypot(spread, float(np.sqrt(np.mean(changes**2))))
    low, high = interval_of(square, spread)
    limit = max(predicted, NEGLIGIBLE * allowed, min(expected, allowed))
    decided = "as_predicted" if high <= max(limit, allowed) else "undetermined"
    status = "short" if low > limit else decided
    return ErrorJudgement(
        name, math.sqrt(max(square, 0.0)), standard_uncertainty(square, spread), (low, high), predicted, expected,
        allowed, resolved, status,
    )  # fmt: skip


# --- How far the prediction of a match holds: response errors of beds drawn from what is not known exactly.

BEDS = 64  # drawn evenly
PREDICTION_VEHICLES = 32  # the same
POINTS = 60  # frequencies over the band
SHARE = 0.95  # of the beds that have no larger error


@once_per_case
def drawn_squares(case: Case) -> np.ndarray:
    """Mean squares (b, h) of |log(H_bed/H_vehicle)| of drawn beds against the vehicle as the case has it."""
    box = case.uncertainty
    frequencies = np.geomspace(*case.band, POINTS)
    beds = bed_set(case, [box.at(position) for position in box.spread(BEDS)], frequencies)
    acting = frequency_response(controller_on_the_bed(case), frequencies)
    ratio = responses(beds, acting, acting.known) / vehicle_response(case, {}, frequencies)
    with np.errstate(divide="ignore", invalid="ignore"):
        squares = np.abs(np.log(ratio)) ** 2
    return np.asarray(squares.mean(axis=1))


def drawn_vehicles(case: Case, frequencies: np.ndarray) -> np.ndarray:
    """Compared functions (b, f, h) of vehicles drawn from what the case does not know of them; ``frequencies`` in Hz.

    There are none where it knows all that the rig lacks, and none of a vehicle of others: its FMU is as it is.
    """
    box = case.uncertainty.of_kind("vehicle.")
    values = box_values(box, PREDICTION_VEHICLES) if case.vehicle_in_the_loop is None else []
    vehicles = [vehicle_response(case, each, frequencies) for each in values]
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

    def active(self, recording: Recording) -> list[str]:
        """Torques that change in one recording."""
        return [name for name in self.inputs if _moves(recording, name)]

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
    *,
    any_length: bool = False,
) -> BedRecordings:
    """Read recordings of the controlled bed with the names of the case's compared functions.

    A compared torque that a recording lacks is taken as constant there. ``sources`` say what the recordings are called
    where the paths are copies. Of ``any_length`` are those of one manoeuvre, from which no response is estimated.
    """
    torques = list(dict.fromkeys(pair.input for pair in case.compared))
    wanted = list(dict.fromkeys(pair.sensor for pair in case.compared))
    drives = [part.name for part in case.rig.inputs]
    names = {*torques, *wanted, *drives, *(sensor.name for sensor in case.rig.sensors), *outputs_of(case)}
    read = [
        replace(read_signals(Path(path), names, channels).resampled(), source=str(source))
        for path, source in zip(paths, sources or paths, strict=True)
    ]
    notes = [f"{recording.source}: {note}" for recording in read for note in recording.notes]
    for recording in read:
        _check_length(recording, case.band, 0.0 if any_length else PERIODS)
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


def _check_length(recording: Recording, band: tuple[float, float], periods: float) -> None:
    step, lasts = float(np.median(np.diff(recording.time))), float(np.ptp(recording.time))
    if 1 / step < SAMPLES_A_PERIOD * band[1]:
        raise InputError(
            recording.source,
            f"is sampled at {1 / step:g} Hz",
            f"{SAMPLES_A_PERIOD * band[1]:g} Hz or more is needed for a band up to {band[1]:g} Hz",
        )
    if lasts < periods / band[0]:
        raise InputError(
            recording.source,
            f"lasts {lasts:g} s",
            f"{periods / band[0]:g} s or more is needed for a band from {band[0]:g} Hz",
        )


# --- XiL fidelity of a recording of the controlled bed: the vehicle is simulated on the torques that were recorded.

DRAWS = 2_000
FIDELITY_VEHICLES = 8  # drawn evenly
LONGEST_DELAY = 0.25  # s: a delay beyond it counts as none of the fidelity
SAMPLES_A_PERIOD = 8.0  # of the highest frequency that are enough


def recorded_fidelity(
    case: Case, recorded: BedRecordings, recording: Recording, simulated: np.ndarray | None = None
) -> RecordedFidelity:
    """R_SD of the compared sensors, R_MU and R_XiL with its standard uncertainty (Eqs. 14 to 23) of one recording.

    The vehicle starts at rest with the recording's first sample; both lose their mean, for only deviations are
    compared. The weights are those of the domains there are. What is not known of the vehicle enters the uncertainty.
    ``simulated`` (t, y) is what a vehicle of others answers.
    """
    answer = _answer(case.vehicle, recorded, recording) if simulated is None else simulated
    fidelity, others = _against(case, answer, recorded, recording), list[float]()
    drawn = fidelity_distribution(fidelity, DRAWS).summary()["total"]
    if simulated is None:
        vehicles = box_values(case.uncertainty.of_kind("vehicle."), FIDELITY_VEHICLES)
        answers = (
            _answer(case.vehicle.with_values(of_system(each, case.vehicle)), recorded, recording) for each in vehicles
        )
        others = [_against(case, each, recorded, recording).total for each in answers]
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


def _answer(system: System, recorded: BedRecordings, recording: Recording) -> np.ndarray:
    """What a vehicle's compared sensors (t, y) read under the torques of a recording, linear."""
    torques, _ = recorded.signals(recording)
    step = float(np.mean(np.diff(recording.time)))
    vehicle = state_space(system)
    drive = np.zeros((len(torques), len(vehicle.inputs)))
    for j, name in enumerate(recorded.inputs):
        drive[:, vehicle.inputs.index(name)] = torques[:, j] - torques[0, j]
    A, B, C, D, _ = scipy.signal.cont2discrete((vehicle.A, vehicle.B, vehicle.C, vehicle.D), step, "foh")
    answer: np.ndarray = scipy.signal.dlsim((A, B, C, D, step), drive)[1]
    return answer[:, [vehicle.outputs.index(name) for name in recorded.sensors]]


def _against(case: Case, answer: np.ndarray, recorded: BedRecordings, recording: Recording) -> Fidelity:
    """Fidelity of a recording against what a vehicle's sensors (t, y) read."""
    _, readings = recorded.signals(recording)
    step = float(np.mean(np.diff(recording.time)))
    every = max(int(1 / (SAMPLES_A_PERIOD * case.band[1] * step)), 1)
    units = {sensor.name: sensor.uncertainty for sensor in case.rig.sensors}
    pairs = {}
    for i, name in enumerate(recorded.sensors):
        reference, test = (trace - trace.mean() for trace in (answer[:, i], readings[:, i]))
        if at_rest(reference[:, None])[0]:
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
BEYOND_BAND = 1.3  # spectra reach so far, for the windows at its upper end and the modes near it
FIT_POINTS = 60  # frequencies around a mode


def judge(case: Case, recorded: BedRecordings, *, of_this_controller: bool = True) -> BedVerification:
    """Judge recordings of the bed of a tuned case.

    Parameters
    ----------
    of_this_controller : bool
        Whether the case's controller ran: then a recording that cannot be one of this bed under it is refused.

    Raises
    ------
    InputError
        Where a recording cannot be right, see :func:`matching.bed.plausible.check_recording`.
    """
    case, left_out = reached_by_torques(case)
    if of_this_controller:
        for recording in recorded.recordings:
            check_recording(case, recording, recorded.active(recording))
    shown = _shown(case, recorded)
    if of_this_controller:
        for recording, motion in zip(recorded.recordings, shown.motions, strict=False):
            check_commands(case, recording, recorded.active(recording), motion.commands)
    units = {part.name: part.unit for part in case.rig.sensors}
    allowed = {"measured": case.tolerance, "unmeasured": case.unmeasured_tolerance}
    drawn = drawn_squares(case) + shown.beyond_linear(case)
    errors, questions = [], list[OpenQuestion]()
    for kind in dict.fromkeys(function.kind for function in shown.functions):
        alike = [function for function in shown.functions if function.kind == kind]

        def of_kind(
            longer: float, known_vehicle: bool = False, kind: str = kind, alike: list[_Function] = alike
        ) -> ErrorJudgement:
            """As a recording so many times as long would be judged, and with all known of the vehicle."""
            figures = [one.figures_of(longer, known_vehicle) if longer > 1 else one.figures for one in alike]
            counted = [one.number for one, known in zip(alike, figures, strict=True) if known.known]
            expected = largest_expected(drawn[:, counted or [one.number for one in alike]])
            return judged(kind, figures, expected, allowed[kind])

        errors.append(of_kind(1.0))
        if errors[-1].status == "undetermined":
            questions.append(_open_error(errors[-1], of_kind))
    each = [
        judged(
            function.name, [function.figures], largest_expected(drawn[:, [function.number]]), allowed[function.kind]
        )
        for function in shown.functions
    ]  # fmt: skip
    mode_checks, of_modes = _modes(case, shown)
    questions = sorted([*questions, *of_modes], key=lambda question: question.because)
    duration = sum(float(np.ptp(recording.time)) for recording in recorded.recordings)
    fidelity = tuple(
        recorded_fidelity(case, recorded, recording, shown.motions[number].vehicle if shown.motions else None)
        for number, recording in enumerate(recorded.recordings)
    )
    states = [*(checked.status for checked in errors), *(checked.status for checked in mode_checks)]
    of_inputs = {**case.rig.input_units, **case.vehicle.input_units}
    curves = tuple(
        function.curves(units[function.sensor], of_input(of_inputs[function.input])) for function in shown.functions
    )
    tracked = tracked_quantities(case, recorded.recordings)
    drifts = [quantity.advice for quantity in tracked if quantity.drifted]
    return BedVerification(
        case.title, _together(states), case.band, tuple(errors), tuple(each), tuple(mode_checks), fidelity, curves,
        (*drifts, *recorded.notes, *left_out, *_hidden(shown.functions), *_not_shown(case, mode_checks)),
        tuple(questions), duration, tracked,
    )  # fmt: skip


def _open_error(now: ErrorJudgement, of_kind: Callable[..., ErrorJudgement]) -> OpenQuestion:
    """What would decide an undetermined response error: the shortest recording, by steps of a half in noise power."""
    name, expanded = f"response error to {now.name} torques", COVERAGE_FACTOR * now.uncertainty

    def decides(then: ErrorJudgement) -> bool:
        """Also of a bed without error, whatever is read of it."""
        reach = math.sqrt(max(then.interval[1] ** 2 - then.value**2, 0.0))
        enough = reach <= COVERAGE_FACTOR * SUFFICIENT * now.allowed
        return enough and (not expanded <= now.allowed or then.status != "undetermined")

    longer = 1.0
    while (longer := 1.5 * longer) < LONGEST:
        if decides(of_kind(longer)):
            return OpenQuestion(name, expanded, now.allowed, "", longer)
    return OpenQuestion(name, expanded, now.allowed, "", math.inf, decides(of_kind(LONGEST, True)))


@dataclass(frozen=True)
class _Function:
    """A compared function with number ``number`` of the case: what was measured of it, also near modes, and figures.

    ``kind`` says whether its torque is ``measured`` or ``unmeasured``; ``vehicle`` and ``matched`` (f,) are the
    responses of vehicle and prediction at the same frequencies, ``drawn`` (b, f) those of drawn vehicles;
    ``resolution`` as in :class:`Figures`.
    """

    kind: str
    number: int
    input: str
    sensor: str
    measured: MeasuredFunction
    around: Callable[[np.ndarray], MeasuredFunction]
    vehicle: np.ndarray
    matched: np.ndarray
    drawn: np.ndarray
    band: tuple[float, float]
    resolution: float = 0.0

    @property
    def name(self) -> str:
        return f"{self.input} → {self.sensor}"

    @cached_property
    def figures(self) -> Figures:
        return self.figures_of(1.0)

    def figures_of(self, longer: float, known_vehicle: bool = False) -> Figures:
        """As if the noise were that of a recording so many times as long, with less of it on what was read.

        Where noise hides the response, it is taken as predicted.
        """
        measured = self.measured
        if longer != 1:
            relative, share = (
                measured.variances / np.abs(self.matched) ** 2,
                log_weights(measured.frequencies, self.band),
            )
            with np.errstate(invalid="ignore", divide="ignore"):
                error = np.log(measured.values / self.vehicle)
                shown = np.isfinite(error) & (relative < UNKNOWN_VARIANCE)
                squares = np.where(shown, np.abs(error) ** 2, 0.0)
                # noise is taken off the sum of squares: single ones are off by as much as it
                rest = max(1 - float(share @ np.where(shown, relative, 0.0)) / max(float(share @ squares), 1e-300), 0.0)
                own = np.where(shown, rest * squares, np.abs(np.log(self.matched / self.vehicle)) ** 2)
                less = np.sqrt((own + relative / longer) / np.abs(error) ** 2)
            values = np.where(np.isfinite(less), self.vehicle * np.exp(less * error), self.matched)
            measured = replace(measured, values=values, noise=measured.noise / math.sqrt(longer))
        drawn = None if known_vehicle else self.drawn
        figures = Figures.of(measured, self.vehicle, self.matched, self.band, drawn)
        return replace(figures, source=self.input, resolution=self.resolution)

    def curves(self, unit: str, per: str) -> FunctionCurves:
        """What a figure of it draws."""
        measured = self.measured
        return FunctionCurves(
            self.input, self.sensor, unit, per, measured.frequencies, measured.values, np.sqrt(measured.variances / 2),
            self.vehicle, self.matched,
        )  # fmt: skip


@dataclass(frozen=True)
class _Shown:
    """What recordings show of a bed: compared functions and the bed that answers for vehicle and prediction."""

    functions: tuple[_Function, ...]
    bed: ComparedBed | _InTime

    @property
    def motions(self) -> Sequence[InTime]:
        """What answers in time to each recording's torques; none where the vehicle is a linear model."""
        return self.bed.motions if isinstance(self.bed, _InTime) else ()

    def beyond_linear(self, case: Case) -> np.ndarray:
        """Mean squares (h,) that a vehicle of others adds to the error that linear models of all parts predict."""
        more = np.zeros(len(case.compared))
        if isinstance(self.bed, _InTime):
            linear = ComparedBed(case)
            for one in self.functions:
                at = linear.at(one.measured.frequencies)
                with np.errstate(divide="ignore", invalid="ignore"):
                    squares = np.abs(np.log(at.matched[:, one.number] / at.vehicle[:, one.number])) ** 2
                known = float(log_weights(one.measured.frequencies, one.band) @ squares)
                more[one.number] = max(one.figures.predicted - known, 0.0)
        return more

    def at(self, grids: Sequence[np.ndarray]) -> list[Responses]:
        """Answers of vehicle and prediction at frequencies (f,), Hz, of several functions; like grids are one."""
        answers: dict[bytes, Responses] = {}
        for grid in grids:
            if grid.tobytes() not in answers:
                answers[grid.tobytes()] = self.bed.at(grid)
        return [answers[grid.tobytes()] for grid in grids]


class _InTime:
    """A vehicle of others and the bed that is predicted with it, by simulated answers to the torques of recordings.

    Both are read as the recordings are, so what these cannot resolve is missing in all alike.

    Attributes
    ----------
    motions : list of InTime
        By recording.
    """

    def __init__(self, case: Case, recorded: BedRecordings):
        linear = ComparedBed(case)
        self.pairs, self.measured, self._band = linear.pairs, linear.measured, case.band
        self.motions = [motions_in_time(case, one, recorded.sensors) for one in recorded.recordings]
        self._vehicle, self._predicted = (
            replace(
                recorded,
                recordings=tuple(
                    replace(one, channels={**one.channels, **dict(zip(recorded.sensors, read.T, strict=True))})
                    for one, read in zip(recorded.recordings, answers, strict=True)
                ),
            )
            for answers in ([one.vehicle for one in self.motions], [one.predicted for one in self.motions])
        )

    def at(self, frequencies: np.ndarray) -> Responses:
        """Responses at frequencies (f,), Hz: of a periodic excitation at its lines, straight in between."""
        vehicle, matched = (self._of(each, frequencies) for each in (self._vehicle, self._predicted))
        return Responses(frequencies, self.pairs, vehicle, np.full(vehicle.shape, np.nan), matched, matched)

    def _of(self, recorded: BedRecordings, frequencies: np.ndarray) -> np.ndarray:
        found = np.full((len(frequencies), len(self.pairs)), np.nan, complex)
        periodic = _periodic(recorded, self._band)
        estimated = None if periodic else estimated_response(_spectra(recorded, self._band), frequencies)
        for h, (source, sensor) in enumerate(self.pairs):
            if source not in recorded.inputs or sensor not in recorded.sensors:
                continue
            y, u = recorded.sensors.index(sensor), recorded.inputs.index(source)
            if estimated is not None:
                found[:, h] = estimated.function(y, u).values
            elif periodic is not None:
                one = periodic[y][u]
                real, imaginary = (
                    np.interp(frequencies, one.frequencies, part) for part in (one.values.real, one.values.imag)
                )
                found[:, h] = real + 1j * imaginary
        return found


def _on_the_bed(case: Case) -> ComparedBed:
    return ComparedBed(case, controller=controller_on_the_bed(case))


def _shown(case: Case, recorded: BedRecordings) -> _Shown:
    bed = _on_the_bed(case) if case.vehicle_in_the_loop is None else _InTime(case, recorded)
    known = {pair: (h, bool(bed.measured[h])) for h, pair in enumerate(bed.pairs)}
    periodic = _periodic(recorded, case.band)
    found, grid, again = [], np.empty(0), None
    if periodic is None:
        every, recordings = _frequencies(recorded, case.band), _spectra(recorded, case.band)
        measured = estimated_response(recordings, every)
        again = _predicted_again(recordings, bed, recorded, every) if isinstance(bed, ComparedBed) else None
    for (source, sensor), (h, is_measured) in known.items():
        if source not in recorded.inputs or sensor not in recorded.sensors:
            continue
        y, u = recorded.sensors.index(sensor), recorded.inputs.index(source)
        if periodic is not None:
            function, around = periodic[y][u].within(*case.band), partial(_as_it_is, periodic[y][u])
        else:
            function, around = measured.function(y, u), partial(_estimated, recordings, y, u)
        if not len(grid) or not np.array_equal(grid, function.frequencies):  # a torque's functions share theirs
            grid = function.frequencies
            answers, vehicles = bed.at(grid), drawn_vehicles(case, grid)
        vehicle, matched, resolution = answers.vehicle[:, h], answers.matched[:, h], 0.0
        if again is not None:
            repeated = Figures.of(
                replace(again.function(y, u), noise=np.zeros((len(every), 1))), vehicle, matched, case.band
            )
            resolution = repeated.square - repeated.predicted
        kind = "measured" if is_measured else "unmeasured"
        found.append(_Function(kind, h, source, sensor, function, around, vehicle, matched, vehicles[:, :, h],
                               case.band, resolution))  # fmt: skip
    return _Shown(tuple(found), bed)


def _as_it_is(function: MeasuredFunction, _: np.ndarray) -> MeasuredFunction:
    return function


def _estimated(recordings: Sequence[Spectra], y: int, u: int, frequencies: np.ndarray) -> MeasuredFunction:
    return estimated_response(recordings, frequencies).function(y, u)


def _periodic(recorded: BedRecordings, band: tuple[float, float]) -> list[list[MeasuredFunction]] | None:
    """Responses [y][u] of recordings that all hold whole periods with lines of their own for every torque."""
    parts: list[list[list[MeasuredFunction]]] = [[[] for _ in recorded.inputs] for _ in recorded.sensors]
    for recording in recorded.recordings:
        torques, readings = recorded.signals(recording)
        step = float(np.mean(np.diff(recording.time)))
        active = [recorded.inputs.index(name) for name in recorded.active(recording)]
        repeated = repetition(torques[:, active], round(1 / (band[0] * step)))
        found = repeated and periodic_responses(torques[:, active], readings, step, repeated, BEYOND_BAND * band[1])
        if not found:
            return None
        for y, row in enumerate(found):
            for j, function in zip(active, row, strict=True):
                parts[y][j].append(function)
    return [[joined(functions) for functions in row] for row in parts]


def _hidden(functions: Sequence[_Function]) -> list[str]:
    """Sentences on what the recordings do not show."""
    return [
        f"{function.name} is left out of the answer: it shows in {100 * (1 - function.figures.unknown):.0f} % of the "
        "band only, the rest lies below the noise"
        for function in functions
        if not function.figures.known
    ]


def _not_shown(case: Case, modes: Sequence[ModeJudgement]) -> list[str]:
    """Sentences on target modes that a vehicle of others does not show: they are those of the design vehicle."""
    if case.vehicle_in_the_loop is None:
        return []
    judged_ones = {mode.number for mode in modes}
    return [
        f"vehicle mode {target.mode} ({mode.frequency:.3g} Hz, of the design vehicle) does not show in the responses "
        "with the FMU: it is not judged"
        for target, (_, mode) in zip(case.targets, target_modes(case), strict=True)
        if case.band[0] <= mode.frequency <= case.band[1] and target.mode not in judged_ones
    ]


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
    recordings: Sequence[Spectra], bed: ComparedBed, recorded: BedRecordings, grid: np.ndarray
) -> MeasuredResponse:
    """The predicted responses as the recordings would show them without noise: what they cannot resolve is missing."""
    predicted = []
    for recording in recordings:
        matched = bed.at(recording.frequencies).matched
        outputs = np.zeros_like(recording.outputs)
        for h, (source, sensor) in enumerate(bed.pairs):
            if source in recorded.inputs and sensor in recorded.sensors:
                u = recorded.inputs.index(source)
                outputs[:, recorded.sensors.index(sensor)] += matched[:, h] * recording.inputs[:, u]
        predicted.append(replace(recording, outputs=outputs))
    return estimated_response(predicted, grid)


def _modes(case: Case, shown: _Shown) -> tuple[list[ModeJudgement], list[OpenQuestion]]:
    """Target modes by one estimator for vehicle, prediction and bed: the same frequencies, weights and shape."""
    out, questions = [], list[OpenQuestion]()
    for target, (_, mode) in zip(case.targets, target_modes(case), strict=True):
        if not case.band[0] <= mode.frequency <= case.band[1]:
            continue
        reach = FITTED_BAND_RATIO
        fine = np.geomspace(mode.frequency / reach, mode.frequency * reach, FIT_POINTS)
        bed = [function.around(fine).within(fine[0], fine[-1]) for function in shown.functions]
        answers = shown.at([function.frequencies for function in bed])
        computed = []
        for what in ("vehicle", "matched"):
            same = [
                replace(function, values=getattr(answer, what)[:, own.number])
                for function, answer, own in zip(bed, answers, shown.functions, strict=True)
            ]
            computed.append(measured_mode(same, mode.frequency, mode.damping_ratio))
        vehicle, predicted = computed
        if vehicle is None:
            continue
        start = predicted or vehicle
        fitted = measured_mode(bed, start.frequency, start.damping_ratio)
        rows = _of_mode(fitted, vehicle, predicted, target.frequency_tolerance, target.damping_tolerance)
        questions += [own.question(target.mode) for own in rows if own.status == "undetermined"]
        out.append(
            ModeJudgement(
                target.mode, (vehicle.frequency, vehicle.damping_ratio),
                None if predicted is None else (predicted.frequency, predicted.damping_ratio), fitted,
                _together([own.status for own in rows]),
            )
        )  # fmt: skip
    return out, questions


@dataclass(frozen=True)
class _OfMode:
    """A mode's frequency (Hz) or damping ratio: how far it is off, its expanded uncertainty, and what is allowed."""

    name: str
    off: float
    expanded: float
    limit: float
    unit: str

    @property
    def status(self) -> str:
        """Short where it is further off than allowed, and than predicted, beyond its uncertainty."""
        if self.off - self.expanded > self.limit:
            return "short"
        return "as_predicted" if self.off <= self.limit and self.expanded <= self.limit else "undetermined"

    def question(self, number: int) -> OpenQuestion:
        """What would decide it, where it is undetermined."""
        longer = math.inf
        if math.isfinite(self.expanded):
            enough = COVERAGE_FACTOR * SUFFICIENT * self.limit
            if self.expanded <= self.limit:
                enough = min(enough, self.off - self.limit)
            longer = (self.expanded / enough) ** 2 if enough > 0 else math.inf
        longer = longer if longer < LONGEST else math.inf
        return OpenQuestion(f"{self.name} of vehicle mode {number}", self.expanded, self.limit, self.unit, longer)


def _of_mode(
    measured: MeasuredMode | None,
    vehicle: MeasuredMode,
    predicted: MeasuredMode | None,
    relative: float,
    damping: float,
) -> list[_OfMode]:
    """Frequency and damping ratio of a mode next to the vehicle's; one row without uncertainty where it does not
    show."""
    promised = vehicle if predicted is None else predicted
    tolerances = (relative * vehicle.frequency, damping)
    rows = []
    for what, name, unit, tolerance in zip(
        ("frequency", "damping_ratio"), ("frequency", "damping ratio"), ("Hz", ""), tolerances, strict=True
    ):  # fmt: skip
        right, uncertainty = getattr(vehicle, what), f"{what.removesuffix('_ratio')}_uncertainty"
        limit = max(tolerance, abs(getattr(promised, what) - right))
        if measured is None:
            return [_OfMode(name, math.nan, math.nan, limit, unit)]
        expanded = COVERAGE_FACTOR * getattr(measured, uncertainty)
        rows.append(_OfMode(name, abs(getattr(measured, what) - right), expanded, limit, unit))
    return rows
