"""Statistics of a residual: its size against the noise, and whether it is white."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import fft

BLOCK_LENGTHS = (1, 4, 16, 64, 256, 1024)  # samples over which the residual is averaged
FEWEST_BLOCKS = 4
SOKAL_WINDOW = 5.0  # autocorrelation times; Sokal (1997) recommends 4 to 10


@dataclass(frozen=True)
class WhitenessTest:
    """A sensor's residual against white noise of its stated uncertainty.

    Attributes
    ----------
    ratio : float
        Root mean square in times the noise.
    excess : ndarray (l,)
        Power of the means over ``BLOCK_LENGTHS`` samples beyond that of white noise, in times the noise power.
    score : ndarray (l,)
        The same in standard deviations of its estimate for white noise.
    """

    ratio: float
    excess: np.ndarray
    score: np.ndarray


def whiteness(residual: Sequence[np.ndarray]) -> WhitenessTest:
    """Compare a sensor's residual, (t,) in times the noise for each segment, with white noise; NaN is not counted.

    The mean square of n independent normal values of variance 1 has the variance 2/n.
    """
    every = np.concatenate([part[np.isfinite(part)] for part in residual])
    excess, score = [], []
    for length in BLOCK_LENGTHS:
        means = np.concatenate([_block_means(part, length) for part in residual])
        if len(means) < FEWEST_BLOCKS:
            break
        beyond = float(np.mean(means**2)) - 1.0
        excess.append(beyond / length)
        score.append(beyond / np.sqrt(2 / len(means)))
    return WhitenessTest(float(np.sqrt(np.mean(every**2))) if len(every) else 0.0, np.array(excess), np.array(score))


def _block_means(residual: np.ndarray, length: int) -> np.ndarray:
    """Sums over blocks of a white signal of variance 1, scaled to variance 1; blocks less than half full are left
    out."""
    blocks = residual[: len(residual) // length * length].reshape(-1, length)
    count = np.isfinite(blocks).sum(axis=1)
    full = count > length / 2
    return np.nansum(blocks, axis=1)[full] / np.sqrt(count[full])


def effective_share(residual: np.ndarray) -> float:
    """Share of a residual's samples (t,) that count as independent: 1 if it is white.

    The inverse of the integrated autocorrelation time 1 + 2·Σρ(k), summed up to the first k that is five times that
    time itself (Sokal, Monte Carlo Methods in Statistical Mechanics, 1997, section 3).
    """
    values = residual[np.isfinite(residual)]
    values = values - values.mean()
    length = fft.next_fast_len(2 * len(values), real=True)
    spectrum = fft.rfft(values, length)
    correlation = fft.irfft(spectrum * np.conj(spectrum), length)[: len(values)]
    if correlation[0] <= 0:
        return 1.0
    times = 2 * np.cumsum(correlation / correlation[0]) - 1
    beyond = np.arange(len(times)) >= SOKAL_WINDOW * times
    stop = int(np.argmax(beyond)) if beyond.any() else len(times) - 1
    return float(1 / max(times[stop], 1.0))


def mean_square(part: np.ndarray) -> np.ndarray:
    """Mean squares (y,) of residuals (t, y); NaN without readings."""
    count = np.isfinite(part).sum(axis=0)
    return np.where(count, np.nansum(part**2, axis=0) / np.maximum(count, 1), np.nan)


def shares_of_ranges(errors: np.ndarray, readings: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Root mean square errors (y,) over the ranges of the readings; NaN without readings, or where they never change.

    Parameters
    ----------
    errors : ndarray (t, y)
        In times the noise; NaN without a reading.
    readings : ndarray (r, y)
        SI; NaN without a reading.
    noise : ndarray (y,)
        SI.
    """
    measured = np.isfinite(readings).any(axis=0) & np.isfinite(errors).any(axis=0)
    width = np.zeros(len(measured))
    width[measured] = np.nanmax(readings[:, measured], axis=0) - np.nanmin(readings[:, measured], axis=0)
    return np.where(width > 0, np.sqrt(mean_square(errors)) * noise / np.where(width > 0, width, 1.0), np.nan)
