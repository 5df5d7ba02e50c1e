"""Least-squares fit of one delay between two low-passed signals: test(t) ≈ a·reference(t − τ) + b, times in samples."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import scipy

from modelling.fidelity.delay_uncertainty import FittedDelay, corner_energy, delay_uncertainties

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
