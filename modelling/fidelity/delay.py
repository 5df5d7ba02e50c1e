"""The delay between two signals to a fraction of a sample, with its uncertainty, or the reason why there is none.

Cross-covariance at whole samples, normalised over what overlaps, gives the candidates (Knapp and Carter 1976 call the
peak of it the plain correlator). Each is refined by least squares: test(t) ≈ a·reference(t − τ) + b, both low-passed
alike without phase. The cut-off is the one with the smallest standard uncertainty, which is the sandwich estimate with
the residual's own autocovariance, so coloured noise and model mismatch count.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import scipy
from scipy.fft import next_fast_len

SIGNIFICANT = 4.5  # standard deviations of the correlation of unrelated signals, for the largest among many lags
RIVAL = 4.0  # standard deviations of the residual's variance beyond which another lag is no rival any more
SMOOTHED = 2  # frequencies on either side over which a periodogram is averaged: some ten degrees of freedom
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


@dataclass(frozen=True)
class _Fit:
    delay: float  # samples
    uncertainty: float  # samples
    unexplained: float  # residual variance over that of the test
    freedom: float  # independent samples in the residual's band
    cutoff: float  # of the half sampling frequency


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
    first = refine(reference, test, float(lags[best]))
    if first is None:
        return Delay(None, None, "the signals do not resolve it")
    fits, smoothed = [first], _Smoothed.of(reference, test, first.cutoff)
    for place in [*(int(lags[peak]) for peak in peaks[1:8]), 0]:
        fits += [fit for fit in [_at_cutoff(smoothed, float(place))] if fit is not None]
    least = min(fit.unexplained for fit in fits)
    margin = least * (1 + RIVAL * math.sqrt(2 / first.freedom)) + FLOOR
    rivals = [fit.delay for fit in fits if fit.unexplained <= margin]
    nearest = min(rivals, key=abs) * step
    if first.uncertainty > reach / 2:
        return Delay(None, None, "the signals do not resolve it", nearest)
    apart = [abs(a - b) for a in rivals for b in rivals if abs(a - b) > 1 + 6 * first.uncertainty]
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
        for peak in _peaks(correlation)[:8]:
            other = refine(reference, reference, float(lags[peak])) if lags[peak] else None
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


def refine(reference: np.ndarray, test: np.ndarray, start: float) -> _Fit | None:
    """The least-squares delay of signals (t,) near a whole-sample one (in samples), at the best of several cut-offs.

    From coarse to fine, each cut-off starts from ``start`` and from the best so far, and the better fit counts:
    the former finds the sharp peak of wide-band signals, the latter passes the small peaks of noise on a broad one.
    """
    best: _Fit | None = None
    for cutoff in (0.015625, 0.03125, 0.0625, 0.125, 0.25, 0.5):
        starts = [start] if best is None or abs(best.delay - start) < 0.01 else [start, best.delay]
        if cutoff < 0.5 and len(reference) < 8 * _settling(cutoff):
            continue
        smoothed = _Smoothed.of(reference, test, cutoff)
        fits = [fit for start in starts if (fit := _at_cutoff(smoothed, start)) is not None]
        if fits:
            fit = min(fits, key=lambda fit: fit.unexplained)
            best = fit if best is None or fit.uncertainty < best.uncertainty else best
    return best


@dataclass(frozen=True)
class _Smoothed:
    """Signals below a cut-off (of half the sampling rate): a curve through the reference, its slope, the test (t,)."""

    curve: Any
    slope: Any
    response: np.ndarray
    cutoff: float

    @classmethod
    def of(cls, reference: np.ndarray, test: np.ndarray, cutoff: float) -> _Smoothed:
        smooth, response = (
            scipy.signal.sosfiltfilt(_low_pass(cutoff), signal, padlen=_settling(cutoff))
            for signal in (reference, test)
        )
        spline = scipy.interpolate.make_interp_spline(np.arange(len(smooth)), smooth, k=5)
        curve = scipy.interpolate.PPoly.from_spline(spline)
        return cls(curve, curve.derivative(), response, cutoff)


def _settling(cutoff: float) -> int:
    """Samples at either end in which the filter has not settled."""
    return math.ceil(3 / cutoff)


@cache
def _low_pass(cutoff: float) -> np.ndarray:
    return scipy.signal.butter(4, cutoff, output="sos")


def _at_cutoff(smoothed: _Smoothed, start: float) -> _Fit | None:
    curve, slope, response, cutoff = smoothed.curve, smoothed.slope, smoothed.response, smoothed.cutoff
    settle, shift = _settling(cutoff), start
    if cutoff < 0.5 and len(response) < 8 * settle + 2 * abs(start):
        return None
    ends = (math.ceil(max(0.0, start)) + settle + 2, len(response) - math.ceil(max(0.0, -start)) - settle - 2)
    places = np.arange(*ends)
    if len(places) < 12:
        return None
    target = response[ends[0] : ends[1]]
    for _ in range(25):
        shifted, change = curve(places - shift), slope(places - shift)
        swing = shifted - shifted.mean()
        energy = float(swing @ swing)
        if energy == 0:
            return None
        a = float(swing @ target) / energy
        residual = target - target.mean() - a * swing
        # Gauss-Newton in the delay alone: what of its column the other two, gain and offset, do not explain.
        column = -a * (change - change.mean())
        column -= float(swing @ column) / energy * swing
        curvature = float(column @ column)
        update = float(column @ residual) / curvature if curvature > 0 else 0.0
        shift += min(max(update, -0.5), 0.5)
        if abs(shift - start) > 1.5 + 0.02 / cutoff * 8:
            return None
        if abs(update) < 1e-7:
            break
    if a <= 0:
        return None
    jacobian = np.column_stack([-a * change, shifted, np.ones(len(places))])
    variance = float(np.var(target))
    unexplained = float(np.mean(residual**2)) / variance if variance > 0 else 1.0
    freedom = max(4.0, len(places) * cutoff)
    # The reference's own noise has slope too, and no information: the residual's slope bounds what to take off.
    spoilt = float(np.sum(np.gradient(residual) ** 2))
    return _Fit(shift, _standard_uncertainty(jacobian, residual, spoilt, cutoff), unexplained, freedom, cutoff)


def _standard_uncertainty(jacobian: np.ndarray, residual: np.ndarray, spoilt: float, cutoff: float) -> float:
    """Standard uncertainty of the first parameter of a fit with coloured residuals.

    The larger of two estimates: one for noise that is stationary, of any colour, and one for residuals that are larger
    where the signal moves, as those of a model that does not fit (Newey and West 1987).

    Parameters
    ----------
    jacobian, residual : ndarray (t, p), (t,)
    spoilt : float
        Taken off the first parameter's curvature; where it eats all of it, nothing is known.
    cutoff : float
        Of the low-pass, over half the sampling frequency.
    """
    scale = np.linalg.norm(jacobian, axis=0)
    scale[scale == 0] = 1.0
    weighted = jacobian / scale
    curvature = weighted.T @ weighted
    curvature[0, 0] -= spoilt / scale[0] ** 2
    if np.linalg.eigvalsh(curvature).min() < 1e-12:
        return math.inf
    bread = np.linalg.inv(curvature)
    influence = weighted @ bread[:, 0]
    # What the taper drops can make the sum too small or negative; white noise in the band is the least there is.
    least = float(np.mean(residual**2)) * bread[0, 0] / cutoff
    variance = max(_newey_west(influence * residual, cutoff), least, _stationary(influence, residual))
    return math.sqrt(variance) / float(scale[0])


def _newey_west(scores: np.ndarray, cutoff: float) -> float:
    """Variance of the sum of scores (t,) that are correlated over a few periods of the cut-off frequency."""
    width = min(math.ceil(4 / cutoff), len(scores) // 4)
    total = float(scores @ scores)
    for lag in range(1, width + 1):
        total += 2 * (1 - lag / (width + 1)) * float(scores[lag:] @ scores[:-lag])
    return total


def _stationary(influence: np.ndarray, residual: np.ndarray) -> float:
    """Variance of influence @ noise, both (t,), for stationary noise with the residual's smoothed periodogram.

    What so few frequencies leave uncertain of it widens it as Student's t is wider than the normal distribution at
    95 %.
    """
    count = len(residual)
    length = next_fast_len(2 * count, real=True)  # twice the length: no wrap-around
    power = np.abs(np.fft.rfft(influence, length)) ** 2
    periodogram = np.abs(np.fft.rfft(residual, length)) ** 2 / (count - 3)
    width = 2 * SMOOTHED * length // count + 1  # in bins of the longer transform
    smooth = scipy.ndimage.uniform_filter1d(power, width, mode="reflect")
    parts = smooth * periodogram
    total = float(parts.sum())
    if total <= 0:
        return 0.0
    neighbours = length / count  # bins that tell the same
    freedom = max(4 * total**2 / float(np.sum(parts**2)) / neighbours, 2.0)
    return 2 * total / length * float((scipy.stats.t.ppf(0.975, freedom) / scipy.stats.norm.ppf(0.975)) ** 2)
