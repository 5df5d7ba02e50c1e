"""Frequency responses and modes from recordings, with their variances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import scipy


@dataclass(frozen=True)
class MeasuredFunction:
    """One response, at frequencies (f,), Hz.

    Attributes
    ----------
    values : ndarray (f,)
        Output per input; NaN where it is not determined.
    noise : ndarray (f, n)
        What n independent noises of variance 1 (complex, circular) add to the values; functions of the same torque at
        the same frequencies share them.
    shared : ndarray (f,)
        Neighbours that rest on the same spectral lines; 1: each value stands alone.
    """

    frequencies: np.ndarray
    values: np.ndarray = field(repr=False)
    noise: np.ndarray = field(repr=False)
    shared: np.ndarray = field(repr=False)

    @property
    def variances(self) -> np.ndarray:
        """Of the complex values (f,), real and imaginary part together."""
        return np.asarray(np.sum(np.abs(self.noise) ** 2, axis=1))

    def within(self, low: float, high: float) -> MeasuredFunction:
        """What lies between two frequencies, Hz, both included."""
        inside = (self.frequencies >= low) & (self.frequencies <= high)
        return MeasuredFunction(self.frequencies[inside], self.values[inside], self.noise[inside], self.shared[inside])


def joined(functions: Sequence[MeasuredFunction]) -> MeasuredFunction:
    """One response of several recordings, in the order of frequencies."""
    frequencies = np.concatenate([function.frequencies for function in functions])
    order = np.argsort(frequencies, kind="stable")
    values, noise, shared = (
        np.concatenate([getattr(function, name) for function in functions])[order]
        for name in ("values", "noise", "shared")
    )
    return MeasuredFunction(frequencies[order], values, noise, shared)


# --- Periodic excitation: each torque has spectral lines of its own, which repeat exactly.
#
# In the spectrum of P periods the answer stands at every P-th frequency. The frequencies between hold noise and the
# transient that the start leaves; the transient is smooth in frequency, so a local polynomial takes it off (Pintelon,
# Barbé, Vandersteen and Schoukens, Mechanical Systems and Signal Processing 25 (2011) 2683). A response is then the
# quotient at a line: no window, no model of the resonance. Lines that nothing excites show what a bed that is not
# linear adds; it counts as noise (Pintelon and Schoukens, System Identification, 2012, section 4.3).


@dataclass(frozen=True)
class PeriodicSettings:
    """When a recording counts as periodic, and how its spectra are read."""

    alike: float = 0.8  # normalised autocorrelation at one period, at least; a longer start or end lowers it
    repeats: float = 0.02  # rms of the difference of neighbouring periods over the rms of the torques: sensors' noise
    least_periods: int = 2  # fewer leave no bin between two lines
    between: int = 12  # bins without an answer around a line, that give noise and transient
    transient_degree: int = 2  # of the polynomial over these bins
    smoothed: int = 9  # lines over which the variance of noise is averaged: it is smooth in frequency
    unexcited: int = 12  # lines without excitation over which the answer of a nonlinear bed is averaged
    beyond_noise: float = 2.2  # times noise, from which such an answer counts: two standard deviations of that mean
    excited: float = 30.0  # power of an excited line over that of the bins between
    faint: float = 1e-6  # of the strongest line's power: below it none counts as excited
    fewest_lines: int = 12  # of a torque


PERIODIC = PeriodicSettings()


@dataclass(frozen=True)
class Repetition:
    """Where the inputs of a recording repeat: samples of one period, first sample, number of whole periods."""

    period: int
    first: int
    count: int


def repetition(inputs: np.ndarray, shortest: int, settings: PeriodicSettings = PERIODIC) -> Repetition | None:
    """The whole periods of inputs (t, u); None where they do not repeat.

    Parameters
    ----------
    shortest : int
        Samples that a period has at least: what is smooth is alike over a few samples.
    """
    moving = inputs - inputs.mean(axis=0)
    moving = moving / np.maximum(np.sqrt(np.mean(moving**2, axis=0)), 1e-300)
    count = len(moving)
    if count < settings.least_periods * shortest:
        return None
    spectrum = np.fft.rfft(moving, 2 * count, axis=0)
    product = np.fft.irfft(np.sum(np.abs(spectrum) ** 2, axis=1))[: count // 2 + 1]
    energy = np.append(0.0, np.cumsum(np.sum(moving**2, axis=1)))
    lags = np.arange(len(product))
    overlap = energy[count - lags] + energy[count] - energy[lags]
    alike = 2 * product / np.maximum(overlap, 1e-300)
    alike[:shortest] = -1.0
    peaks = np.flatnonzero((alike[1:-1] >= alike[:-2]) & (alike[1:-1] > alike[2:]) & (alike[1:-1] > settings.alike)) + 1
    for period in peaks.tolist():
        off = np.append(0.0, np.cumsum(np.sum((moving[period:] - moving[:-period]) ** 2, axis=1)))
        power = np.append(0.0, np.cumsum(np.sum(moving[period:] ** 2, axis=1)))
        # over a window of one period that ends at a sample
        unlike, whole = off[period:] - off[:-period], power[period:] - power[:-period]
        good = np.flatnonzero(np.append(unlike <= settings.repeats**2 * whole, False) == 0)
        starts, runs = np.append(0, good[:-1] + 1), np.diff(np.append(-1, good)) - 1
        longest = int(np.argmax(runs))
        if runs[longest] > 0:
            stretch = int(runs[longest]) - 1 + settings.least_periods * period
            periods = stretch // period
            return Repetition(int(period), int(starts[longest]) + stretch - periods * period, int(periods))
    return None


def periodic_responses(
    inputs: np.ndarray,
    outputs: np.ndarray,
    step: float,
    repeated: Repetition,
    top: float,
    settings: PeriodicSettings = PERIODIC,
) -> list[list[MeasuredFunction]] | None:
    """Responses of every output to every input, [y][u]; None where inputs share their lines.

    Parameters
    ----------
    inputs, outputs : ndarray (t, u), (t, y)
        At even steps (s).
    top : float
        Hz, up to which lines are looked at.
    """
    part = slice(repeated.first, repeated.first + repeated.count * repeated.period)
    bins = np.fft.rfft(np.hstack([inputs[part], outputs[part]]), axis=0) / np.sqrt(repeated.count * repeated.period)
    u = inputs.shape[1]
    lasts = repeated.count * repeated.period * step
    places, answers, covariance = _lines(bins, repeated.count, round(top * lasts), settings)
    noise = np.real(np.einsum("hcc->hc", covariance))
    frequencies = places / lasts
    driven, power = answers[:, :u], np.abs(answers[:, :u]) ** 2
    excited = (power > settings.excited * noise[:, :u]) & (power > settings.faint * power.max(axis=0))
    own = excited & (excited.sum(axis=1) == 1)[:, None]
    # a torque that is measured has a little of everything: far less than where it is excited
    if (own.sum(axis=0) < np.maximum(settings.fewest_lines, excited.sum(axis=0) / 2)).any():
        return None
    silent = ~excited.any(axis=1)
    ordinary = _roots(covariance[:, u:, u:])  # (h, y, y)
    functions = []
    for output in range(u, bins.shape[1]):
        answer, rows = answers[:, output], ordinary[:, output - u]
        first = [(frequencies[own[:, j]], answer[own[:, j]] / driven[own[:, j], j]) for j in range(u)]
        everywhere = np.stack([_between(frequencies, *known) for known in first], axis=1)
        rest = answer - np.sum(np.where(own, 0.0, everywhere * driven), axis=1)  # what other torques add at a line
        if silent.sum() >= settings.unexcited:
            # the mean of the logarithm of a power is that of its mean less Euler's number: no peak reaches far
            power = np.log(np.maximum(np.abs(rest[silent]) ** 2, 1e-300)) + np.euler_gamma
            added = scipy.ndimage.uniform_filter1d(power, settings.unexcited, mode="nearest")
            added = np.exp(np.interp(frequencies, frequencies[silent], added))
            times = added / np.maximum(noise[:, output], 1e-300)
            rows = rows * np.sqrt(np.where(times > settings.beyond_noise, times, 1.0))[:, None]
        row = []
        for j in range(u):
            mine = own[:, j]
            at, drive = frequencies[mine], driven[mine, j]
            row.append(MeasuredFunction(at, rest[mine] / drive, rows[mine] / drive[:, None], np.ones(len(at))))
        functions.append(row)
    return functions


def _lines(bins: np.ndarray, count: int, top: int, settings: PeriodicSettings) -> tuple[np.ndarray, ...]:
    """Bins (h,) of the lines, what stands there (h, c) without transient, and covariance of noise in it (h, c, c)."""
    reach = -(-settings.between * count // (2 * (count - 1)))
    offsets = np.array([offset for offset in range(-reach, reach + 1) if offset % count])
    offsets = offsets[np.argsort(np.abs(offsets), kind="stable")[: settings.between]]
    places = np.arange(-(-(reach + 1) // count) * count, min(top, len(bins) - reach - 1) + 1, count)
    powers = (offsets / reach)[:, None] ** np.arange(settings.transient_degree + 1)
    fitted = np.linalg.pinv(powers)
    around = bins[places[:, None] + offsets]  # (h, n, c)
    transient = np.tensordot(around, fitted[0], ([1], [0]))
    left = np.einsum("mn,hnc->hmc", np.eye(len(offsets)) - powers @ fitted, around)
    freedom = len(offsets) - powers.shape[1]
    covariance = np.einsum("hnc,hnd->hcd", left, left.conj()) / freedom * (1 + np.sum(fitted[0] ** 2))
    smooth = partial(scipy.ndimage.uniform_filter1d, size=settings.smoothed, axis=0, mode="nearest")
    return places, bins[places] - transient, smooth(covariance.real) + 1j * smooth(covariance.imag)


def _roots(covariances: np.ndarray) -> np.ndarray:
    """Roots R (h, y, y) of covariances R·Rᴴ, which may be singular."""
    values, vectors = np.linalg.eigh(covariances)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :])


def _between(frequencies: np.ndarray, known: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Complex values (f,) straight between known ones."""
    return np.interp(frequencies, known, values.real) + 1j * np.interp(frequencies, known, values.imag)


# --- Any other excitation: local rational models of the spectra. A drive on the road or a chirp does not repeat.
#
# Around each frequency the spectra obey Y·(1 + d₁r + d₂r²) = (G + g₁r + g₂r²)·U + t₀ + t₁r + t₂r², r the distance in
# frequency: a rational response and a smooth transient that the beginning and the end of a recording leave behind. It
# is linear in its unknowns, takes any number of inputs, and needs neither periods nor windows (McKelvey and Guérin,
# IFAC Proc. Vol. 45 (2012) 1431; Pintelon and Schoukens, System Identification, 2012, chapter 7). Recordings share the
# response; each has its own transient.

DEGREE = 2  # of response, transient and denominator over one window
FREEDOM = 1.5  # least ratio of a window's spectral lines to its unknowns: the residual then tells the noise
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

    def function(self, output: int, source: int) -> MeasuredFunction:
        """The response of one output to one input."""
        shared = np.maximum(self.windows / np.gradient(self.frequencies), 1.0)
        noise = np.zeros((len(self.frequencies), self.values.shape[1]))  # each output has its own
        noise[:, output] = np.sqrt(self.variances[:, output, source])
        return MeasuredFunction(self.frequencies, self.values[:, output, source], noise, shared)


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
FURTHER_VALUES = 4  # of a function, more than this degree: fewer do not tell a mode from a smooth curve
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


def measured_mode(functions: Sequence[MeasuredFunction], frequency: float, damping: float) -> MeasuredMode | None:
    """The mode near an expected one (Hz, damping ratio); None where the responses do not show it.

    Each function is (c₀ + c₁q + c₂q²)/(s² + 2ζωs + ω²), q the relative distance in frequency: for given ω and ζ linear
    in c, so only ω and ζ are searched for (variable projection, Golub and Pereyra 1973).
    """
    low, high = frequency / FITTED_BAND_RATIO, frequency * FITTED_BAND_RATIO
    fits = [fit for fit in (_Fit.of(function.within(low, high), frequency) for function in functions) if fit]
    if not fits:
        return None

    def residual(x: np.ndarray) -> np.ndarray:
        omega, zeta = 2 * np.pi * np.exp(x[0]), x[1]
        return np.concatenate([fit.left(omega, zeta) for fit in fits])

    start = np.array([np.log(frequency), damping])
    bounds = [np.log(low), 1e-5], [np.log(high), 0.9]
    optimum = scipy.optimize.least_squares(residual, np.clip(start, *bounds), bounds=bounds, x_scale=[0.05, 0.05])
    freedom = max(len(optimum.fun) - 2 - 2 * (RESIDUAL_DEGREE + 1) * len(fits), 1)
    shared = float(np.mean(np.concatenate([fit.shared for fit in fits])))  # so many values are one independent value
    covariance = np.linalg.pinv(optimum.jac.T @ optimum.jac) * shared * max(2 * optimum.cost / freedom, 1.0)
    relative, of_damping = np.sqrt(np.diag(covariance))
    if optimum.cost > LARGEST_MISFIT_RATIO * sum(fit.left_without_mode() for fit in fits):
        return None
    if relative > LARGEST_RELATIVE_UNCERTAINTY or not bounds[0][0] < optimum.x[0] < bounds[1][0]:
        return None
    value = float(np.exp(optimum.x[0]))
    return MeasuredMode(value, value * float(relative), float(optimum.x[1]), float(of_damping))


@dataclass(frozen=True)
class _Fit:
    """A function near a mode: relative distances (f,) from its expected frequency, values and the like."""

    frequencies: np.ndarray
    distance: np.ndarray
    values: np.ndarray
    deviations: np.ndarray  # of real and imaginary part, each
    shared: np.ndarray

    @classmethod
    def of(cls, function: MeasuredFunction, middle: float) -> _Fit | None:
        """None where too little of it is known."""
        known = np.isfinite(function.values) & np.isfinite(function.variances)
        f, values = function.frequencies[known], function.values[known]
        if len(f) < RESIDUAL_DEGREE + FURTHER_VALUES:
            return None
        deviations = np.sqrt(function.variances[known] / 2)
        least = LEAST_DEVIATION * np.abs(values).max()
        return cls(f, (f - middle) / middle, values, np.maximum(deviations, least), function.shared[known])

    def left(self, omega: float, zeta: float) -> np.ndarray:
        """What a mode leaves of the values, real and imaginary part, over their deviations."""
        s = 2j * np.pi * self.frequencies
        rest = self._rest(self._powers(RESIDUAL_DEGREE) / (s**2 + 2 * zeta * omega * s + omega**2)[:, None])
        return np.concatenate([rest.real, rest.imag])

    def left_without_mode(self) -> float:
        """Half the sum of squares that a polynomial of two degrees more leaves: as many unknowns, and no pole."""
        return float(np.sum(np.abs(self._rest(self._powers(RESIDUAL_DEGREE + 2))) ** 2)) / 2

    def _powers(self, degree: int) -> np.ndarray:
        return np.asarray(self.distance[:, None] ** np.arange(degree + 1))

    def _rest(self, shapes: np.ndarray) -> np.ndarray:
        weighted, right = shapes / self.deviations[:, None], self.values / self.deviations
        weighted = weighted / np.linalg.norm(weighted, axis=0)
        return np.asarray(right - weighted @ np.linalg.lstsq(weighted, right, rcond=None)[0])
