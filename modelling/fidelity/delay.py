"""The delay between two signals to a fraction of a sample, with its uncertainty, or the reason why there is none.

Cross-covariance at whole samples, normalised over what overlaps, gives the candidates (Knapp and Carter 1976 call the
peak of it the plain correlator). Each is refined by least squares: test(t) ≈ a·reference(t − τ) + b, both low-passed
alike without phase (:mod:`modelling.fidelity.delay_fit`). The cut-off is the one with the smallest uncertainty, which
follows from the residual's own spectrum, so coloured noise and model mismatch count
(:mod:`modelling.fidelity.delay_uncertainty`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy

from modelling.fidelity.delay_fit import Pair, fit_at_cutoff, refine

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
