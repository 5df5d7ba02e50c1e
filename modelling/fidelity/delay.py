"""The delay between two signals to a fraction of a sample, with its uncertainty, or the reason why there is none.

Cross-covariance at whole samples, normalised over what overlaps, gives the candidates (Knapp and Carter 1976 call the
peak of it the plain correlator). Each is refined by least squares: test(t) ≈ a·reference(t − τ) + b, both low-passed
alike without phase (:mod:`modelling.fidelity.delay`). The cut-off is the one with the smallest uncertainty, which
follows from the residual's own spectrum, so coloured noise and model mismatch count
(:mod:`modelling.fidelity.delay`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import scipy
from scipy.fft import next_fast_len
from scipy.special import ndtri, stdtrit

# --- The standard uncertainty of a fitted delay, from the spectrum of what the fit leaves and from corners of the
# signal.
#
# Three things move a fitted delay. Noise, of any colour: its part follows from the residual's periodogram. Noise in the
# reference: its slope looks like curvature of the misfit and holds no information. And corners: where between two
# samples a ramp begins cannot be known, and no interpolation gives it back.

SMOOTHED = 2  # frequencies on either side over which a periodogram is averaged: some ten degrees of freedom
LEAST_LEFT = 0.2  # of the noise: a fit that takes more of it out leaves too little to tell its spectrum from
CORNER_BAND = 0.6  # of half the sampling rate: corners are found above, where smooth signals have nothing
GAUSS_MEDIAN = 0.4549  # median of the square of a normal variable over its variance


@dataclass(frozen=True)
class FittedDelay:
    """A fit at samples (t,): delay in samples, gain, Jacobian (t, 3) of delay, gain and offset, residual (t,)."""

    places: np.ndarray
    delay: float
    gain: float
    jacobian: np.ndarray
    residual: np.ndarray

    @property
    def step(self) -> int:
        """Samples from one place to the next."""
        return int(self.places[1] - self.places[0])


def delay_uncertainties(fitted: FittedDelay, cutoff: float, corners: np.ndarray) -> tuple[float, float]:
    """Standard uncertainties in samples: with equal noise in both signals, and with all of it in the reference.

    Which signal holds the noise cannot be seen in the residual; it decides how much of the reference's slope is noise.
    The residual's slope has the energy of both signals' noise.

    Parameters
    ----------
    cutoff : float
        Of the low-pass, over half the rate of the fitted places.
    corners : ndarray (2, t)
        See :func:`corner_energy`; of reference and test, at all samples.
    """
    return (
        _uncertainty(fitted, cutoff, corners, in_reference=0.5),
        _uncertainty(fitted, cutoff, corners, in_reference=1.0),
    )


def _uncertainty(fitted: FittedDelay, cutoff: float, corners: np.ndarray, in_reference: float) -> float:
    """Standard uncertainty where the reference holds this share of the noise; infinite where nothing is known."""
    scale = np.linalg.norm(fitted.jacobian, axis=0)
    scale[scale == 0] = 1.0
    weighted = fitted.jacobian / scale
    noise_slope = np.gradient(fitted.residual, fitted.step)
    curvature = weighted.T @ weighted
    curvature[0, 0] -= in_reference * float(noise_slope @ noise_slope) / scale[0] ** 2
    if np.linalg.eigvalsh(curvature).min() < 1e-12:
        return math.inf
    bread = np.linalg.inv(curvature)
    influence = weighted @ bread[:, 0]
    power = _power(influence)
    if in_reference < 1:
        # A signal's noise times its own slope sums to nothing; only times the other one's it moves the delay.
        power = power - in_reference**2 * (bread[0, 0] / scale[0]) ** 2 * _power(noise_slope)
    noise = _noise_variance(power, weighted, fitted.residual, cutoff)
    return math.sqrt(noise + _corner_variance(influence / fitted.step, fitted, corners)) / float(scale[0])


def _power(signal: np.ndarray) -> np.ndarray:
    """Energy spectrum of a signal (t,) at twice its length, so that sums over it do not wrap around."""
    return np.abs(np.fft.rfft(signal, next_fast_len(2 * len(signal), real=True))) ** 2


def _noise_variance(power: np.ndarray, columns: np.ndarray, residual: np.ndarray, cutoff: float) -> float:
    """Variance of influence @ noise for stationary noise with the residual's periodogram.

    Corrected for the noise that the fit has taken out of the residual (as HC2 corrects for leverage), and widened for
    the few frequencies that tell it, as Student's t is wider than the normal distribution at 95 %.

    Parameters
    ----------
    power : ndarray (f,)
        Energy spectrum of the influence of each sample on the delay.
    columns, residual : ndarray (t, p), (t,)
        The fit's columns, and what it leaves.
    """
    count = len(residual)
    length = next_fast_len(2 * count, real=True)
    width = 2 * SMOOTHED * length // count + 1  # in bins of the longer transform
    smooth = np.maximum(scipy.ndimage.uniform_filter1d(power, width, mode="reflect"), 0.0)
    parts = smooth * _power(residual) / count
    total = float(parts.sum())
    if total <= 0:
        return 0.0
    directions, _ = np.linalg.qr(columns)
    taken = sum(float(smooth @ _power(direction)) for direction in directions.T) / count
    in_band = float(smooth[: max(1, int(len(smooth) * min(1.0, cutoff)))].sum())
    total /= max(1 - taken / in_band, LEAST_LEFT) if in_band > 0 else 1.0
    neighbours = length / count  # bins that tell the same
    freedom = max(4 * float(parts.sum()) ** 2 / float(np.sum(parts**2)) / neighbours, 2.0)
    return 2 * total / length * float((stdtrit(freedom, 0.975) / ndtri(0.975)) ** 2)


@cache
def _corner_filter() -> tuple[np.ndarray, float]:
    """A high-pass, and the energy it passes of a corner of unit change of slope, averaged over its place.

    A corner sampled at a random place has the energy spectrum Σₖ (2π(f + k))⁻⁴ = (3 − 2 sin²πf)/(48 sin⁴πf).
    """
    sections = scipy.signal.butter(8, CORNER_BAND, "high", output="sos")
    frequency = np.linspace(0.01, 0.5, 4000)
    response = np.abs(scipy.signal.sosfreqz(sections, 2 * np.pi * frequency)[1]) ** 2  # forwards and backwards
    sine = np.sin(np.pi * frequency) ** 2
    return sections, float(2 * np.trapezoid(response**2 * (3 - 2 * sine) / (48 * sine**2), frequency))


def corner_energy(signal: np.ndarray) -> np.ndarray:
    """Squared changes of slope per sample at the corners of a signal (t,), where they are, noise taken off.

    The median over the signal tells the noise, since corners are rare.
    """
    sections, of_one = _corner_filter()
    high = scipy.signal.sosfiltfilt(sections, signal, padlen=min(20, len(signal) - 1)) ** 2
    return (high - np.median(high) / GAUSS_MEDIAN) / of_one


def _corner_variance(influence: np.ndarray, fitted: FittedDelay, corners: np.ndarray) -> float:
    """Variance that corners at random places between samples leave, with the influence (t,) of a unit of area.

    A corner of change of slope g at the part φ of a step makes the sum of the samples differ from the integral by
    g·B₂(φ)/2 (Euler and Maclaurin). In reference and test φ differs by the delay's fraction d of a sample, and
    the two errors, the Bernoulli polynomials of B₂(φ) and B₂(φ + d), differ by d²(1 − d)²/3 in the mean square.
    """
    fraction = fitted.delay - math.floor(fitted.delay)
    if len(fitted.places) < 2:
        return 0.0
    samples = np.arange(corners.shape[1])
    energies = [
        float(np.interp(samples, places, influence**2, left=0.0, right=0.0) @ corner)
        for places, corner in ((fitted.places - fitted.delay, corners[0]), (fitted.places, corners[1]))
    ]
    mean = 0.5 * (fitted.gain**2 * max(energies[0], 0.0) + max(energies[1], 0.0))
    return mean * fraction**2 * (1 - fraction) ** 2 / 12


# --- Least-squares fit of one delay between two low-passed signals: test(t) ≈ a·reference(t − τ) + b, times in samples.

MOST_ITERATIONS = 25
HIGHEST = 0.5  # of half the sampling rate: highest cut-off, above which a spline between samples is not exact
OVERSAMPLED = 0.25  # cut-off over half the rate to which low-passed signals are thinned: eight samples a period


@dataclass(frozen=True)
class DelayFit:
    """A fitted delay in samples and what the fit leaves.

    Parameters
    ----------
    delay, uncertainty, largest_uncertainty : float
        In samples; the standard uncertainty, and the one if all noise were in the reference, where it hurts most.
    unexplained : float
        Variance of the residual over that of the test signal.
    freedom : float
        Independent samples in the residual's band.
    cutoff : float
        Of the low-pass, over half the sampling rate.
    """

    delay: float
    uncertainty: float
    largest_uncertainty: float
    unexplained: float
    freedom: float
    cutoff: float


@dataclass(frozen=True)
class Pair:
    """Reference and test signal (t,), and the energy of the corners in each, (2, t)."""

    reference: np.ndarray
    test: np.ndarray
    corners: np.ndarray

    @classmethod
    def of(cls, reference: np.ndarray, test: np.ndarray) -> Pair:
        """The pair of signals (t,)."""
        return cls(reference, test, np.stack([corner_energy(reference), corner_energy(test)]))

    def below(self, cutoff: float) -> SmoothedPair:
        """Both signals below a cut-off (dimensionless, over half the sampling rate), thinned as far as that allows."""
        step = max(1, int(OVERSAMPLED / cutoff))
        smooth, response = (
            scipy.signal.sosfiltfilt(_low_pass(cutoff), signal, padlen=_settling(cutoff))[::step]
            for signal in (self.reference, self.test)
        )
        return SmoothedPair(scipy.ndimage.spline_filter1d(smooth, 5), response, cutoff, step, self)


@dataclass(frozen=True)
class SmoothedPair:
    """Signals below a cut-off, every ``step``-th sample (t,): the reference as a quintic spline, the test as it is."""

    spline: np.ndarray
    response: np.ndarray
    cutoff: float
    step: int
    pair: Pair

    def late_reference(self, rows: slice, delay: float) -> tuple[np.ndarray, np.ndarray]:
        """The reference, late by a delay in samples, at rows (t,), and its slope per sample there.

        All rows lie alike between the spline's equal knots, so that six coefficients each have the same weights.
        """
        place = rows.start - delay / self.step
        first = math.floor(place)
        used = self.spline[first - 2 : first + 3 + rows.stop - rows.start]
        value, slope = (basis(place - first - np.arange(-2, 4)) for basis in _basis())
        return np.convolve(used, value[::-1], "valid"), np.convolve(used, slope[::-1], "valid") / self.step


@cache
def _basis() -> tuple[Any, Any]:
    """The quintic B-spline on knots a unit apart, centred at 0, and its derivative."""
    basis = scipy.interpolate.BSpline.basis_element(np.arange(-3.0, 4.0), extrapolate=False)
    return basis, basis.derivative()


def _settling(cutoff: float) -> int:
    """Samples at either end in which the filter has not settled."""
    return math.ceil(3 / cutoff)


@cache
def _low_pass(cutoff: float) -> np.ndarray:
    return scipy.signal.butter(4, cutoff, output="sos")


def refine(pair: Pair, start: float) -> DelayFit | None:
    """The least-squares delay of signals near a whole-sample one (in samples), at the best of several cut-offs.

    From coarse to fine, each cut-off starts from ``start`` and from the best so far, and the better fit counts:
    the former finds the sharp peak of wide-band signals, the latter passes the small peaks of noise on a broad one.
    """
    cutoffs = [HIGHEST]
    while len(pair.test) >= 8 * _settling(cutoffs[-1] / 2):
        cutoffs.append(cutoffs[-1] / 2)
    best: DelayFit | None = None
    for cutoff in reversed(cutoffs):
        starts = [start] if best is None or abs(best.delay - start) < 0.01 else [start, best.delay]
        smoothed = pair.below(cutoff)
        fits = [fit for start in starts if (fit := fit_at_cutoff(smoothed, start)) is not None]
        if fits:
            fit = min(fits, key=lambda fit: fit.unexplained)
            # The larger uncertainty decides: the other takes part of the reference's noise for signal.
            best = fit if best is None or fit.largest_uncertainty < best.largest_uncertainty else best
    return best


def fit_at_cutoff(smoothed: SmoothedPair, start: float) -> DelayFit | None:
    """The least-squares delay of low-passed signals near ``start`` (samples); None where there is none.

    Gauss and Newton's method in the delay alone, gain and offset eliminated.
    """
    count, cutoff, step = len(smoothed.pair.test), smoothed.cutoff, smoothed.step
    settle, shift = _settling(cutoff), start
    if cutoff < HIGHEST and count < 8 * settle + 2 * abs(start):
        return None
    ends = (math.ceil(max(0.0, start)) + settle + 2, count - math.ceil(max(0.0, -start)) - settle - 2)
    rows = slice(-(-ends[0] // step), -(-ends[1] // step))
    if rows.stop - rows.start < 12:
        return None
    target, places = smoothed.response[rows], step * np.arange(rows.start, rows.stop)
    for _ in range(MOST_ITERATIONS):
        shifted, change = smoothed.late_reference(rows, shift)
        swing = shifted - shifted.mean()
        energy = float(swing @ swing)
        if energy == 0:
            return None
        a = float(swing @ target) / energy
        residual = target - target.mean() - a * swing
        column = -a * (change - change.mean())
        column -= float(swing @ column) / energy * swing
        curvature = float(column @ column)
        update = float(column @ residual) / curvature if curvature > 0 else 0.0
        shift += min(max(update, -0.5 * step), 0.5 * step)
        if abs(shift - start) > 1.5 + 0.02 / cutoff * 8:
            return None
        if abs(update) < 1e-7 * step:
            break
    if a <= 0:
        return None
    fitted = FittedDelay(places, shift, a, np.column_stack([-a * change, shifted, np.ones(len(places))]), residual)
    uncertainty, largest = delay_uncertainties(fitted, step * cutoff, smoothed.pair.corners)
    variance = float(np.var(target))
    unexplained = float(np.mean(residual**2)) / variance if variance > 0 else 1.0
    freedom = max(4.0, len(places) * step * cutoff)
    return DelayFit(shift, uncertainty, largest, unexplained, freedom, cutoff)


# --- Delay

SIGNIFICANT = 4.5  # standard deviations of the correlation of unrelated signals, for the largest among many lags
RIVAL = 4.0  # standard deviations of the residual's variance beyond which another lag is no rival any more
FLOOR = 1e-4  # unexplained part of the variance below which two lags cannot be told apart in practice


@dataclass(frozen=True)
class Delay:
    """``value`` and ``standard_uncertainty`` in s (positive: the test lags); None and a reason where undetermined.

    ``nearest`` is the smallest delay that explains the signals as well as any other; None where none does.
    """

    value: float | None
    standard_uncertainty: float | None
    reason: str = ""
    nearest: float | None = None


def delay(reference: np.ndarray, test: np.ndarray, step: float, longest: float | None = None) -> Delay:
    """Delay of ``test`` behind ``reference``, both ``(t,)`` at equal steps of ``step`` s.

    Parameters
    ----------
    longest : float, optional
        Largest delay looked for, in s; by default a quarter of the recording.

    Notes
    -----
    Constant signals, unrelated ones, periodic ones and those whose best delay sits at the end of the range have none.
    """
    if np.array_equal(reference, test):
        return _identical(reference, step, longest)
    count = len(reference)
    reach = min(count // 4 if longest is None else math.ceil(longest / step), count - 8)
    if count < 16 or reach < 1:
        return Delay(None, None, "too few samples")
    for name, signal in (("reference", reference), ("test", test)):
        if np.ptp(signal) <= 1e-12 * np.max(np.abs(signal)):
            return Delay(None, None, f"the {name} signal is constant")
    lags, correlation = overlapped_correlation(reference, test, reach)
    peaks = _peaks(correlation)
    best = int(peaks[0]) if len(peaks) else int(np.argmax(correlation))
    if correlation[best] < _noise_level(reference, test):
        return Delay(None, None, "the signals are not related")
    if best in (0, len(lags) - 1):
        return Delay(None, None, f"it is not within ±{reach * step:.4g} s")
    pair = Pair.of(reference, test)
    first = refine(pair, float(lags[best]))
    if first is None:
        return Delay(None, None, "the signals do not resolve it")
    fits, smoothed = [first], pair.below(first.cutoff)
    for place in [*(int(lags[peak]) for peak in peaks[1:8]), 0]:
        fits += [fit for fit in [fit_at_cutoff(smoothed, float(place))] if fit is not None]
    least = min(fit.unexplained for fit in fits)
    margin = least * (1 + RIVAL * math.sqrt(2 / first.freedom)) + FLOOR
    rivals = [fit.delay for fit in fits if fit.unexplained <= margin]
    nearest = min(rivals, key=abs) * step
    if first.largest_uncertainty > reach / 2:
        return Delay(None, None, "the signals do not resolve it", nearest)
    apart = [abs(a - b) for a in rivals for b in rivals if abs(a - b) > 1 + 6 * first.largest_uncertainty]
    if apart:
        return Delay(None, None, f"delays {min(apart) * step:.4g} s apart explain the signals as well", nearest)
    return Delay(first.delay * step, first.uncertainty * step, "", first.delay * step)


def _identical(reference: np.ndarray, step: float, longest: float | None) -> Delay:
    """Equal signals: delay zero exactly, unless they would fit elsewhere as well."""
    if np.ptp(reference) == 0:
        return Delay(None, None, "the reference signal is constant", 0.0)
    reach = min(len(reference) // 4 if longest is None else math.ceil(longest / step), len(reference) - 8)
    if reach >= 1:
        lags, correlation = overlapped_correlation(reference, reference, reach)
        pair = Pair.of(reference, reference)
        for peak in _peaks(correlation)[:8]:
            other = refine(pair, float(lags[peak])) if lags[peak] else None
            if other is not None and abs(other.delay) > 1 and other.unexplained <= FLOOR:
                return Delay(
                    None, None, f"delays {abs(other.delay) * step:.4g} s apart explain the signals as well", 0.0
                )
    return Delay(0.0, 0.0, "", 0.0)


def overlapped_correlation(reference: np.ndarray, test: np.ndarray, reach: int) -> tuple[np.ndarray, np.ndarray]:
    """Lags −reach…reach in samples, (2·reach + 1,), and the correlation coefficient of what overlaps at each.

    Zero where the overlap holds less than a quarter of either signal's variance: there chance decides.
    """
    x, y = reference - reference.mean(), test - test.mean()
    count = len(x)
    lags = np.arange(-reach, reach + 1)
    products = scipy.signal.correlate(y, x, mode="full", method="fft")[lags + count - 1]
    x_from, y_from = np.maximum(0, -lags), np.maximum(0, lags)
    n = count - np.abs(lags)

    def sums(signal: np.ndarray, start: np.ndarray) -> np.ndarray:
        total = np.concatenate([[0.0], np.cumsum(signal)])
        return total[start + n] - total[start]

    sx, sy = sums(x, x_from), sums(y, y_from)
    vx, vy = sums(x * x, x_from) - sx**2 / n, sums(y * y, y_from) - sy**2 / n
    enough = (vx > 0.25 * np.sum(x * x)) & (vy > 0.25 * np.sum(y * y))
    covariance = products - sx * sy / n
    correlation = np.divide(covariance, np.sqrt(np.where(enough, vx * vy, 1.0)), out=np.zeros(len(lags)), where=enough)
    return lags, correlation


def _peaks(correlation: np.ndarray) -> np.ndarray:
    """Places of local maxima that stand out of the noise, highest first."""
    places, _ = scipy.signal.find_peaks(np.concatenate([[-2.0], correlation, [-2.0]]), prominence=0.05)
    places = places - 1
    return places[np.argsort(-correlation[places])]


def _noise_level(reference: np.ndarray, test: np.ndarray) -> float:
    """Correlation that unrelated signals of these spectra reach by chance (Bartlett's formula)."""
    spectra = [np.abs(np.fft.rfft(signal - signal.mean())) ** 2 for signal in (reference, test)]
    spectra = [spectrum / spectrum.sum() for spectrum in spectra]
    return min(0.9, SIGNIFICANT * math.sqrt(0.5 * float(np.sum(spectra[0] * spectra[1]))))
