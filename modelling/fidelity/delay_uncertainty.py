"""The standard uncertainty of a fitted delay, from the spectrum of what the fit leaves and from corners of the signal.

Three things move a fitted delay. Noise, of any colour: its part follows from the residual's periodogram. Noise in the
reference: its slope looks like curvature of the misfit and holds no information. And corners: where between two samples
a ramp begins cannot be known, and no interpolation gives it back.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy
from scipy.fft import next_fast_len

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
    return 2 * total / length * float((scipy.stats.t.ppf(0.975, freedom) / scipy.stats.norm.ppf(0.975)) ** 2)


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
