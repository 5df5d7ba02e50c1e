"""What a residual says of itself: its size against the noise, and whether it is white."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import fft

SCALES = (1, 4, 16, 64, 256, 1024)  # samples over which the residual is averaged


@dataclass(frozen=True)
class Noise:
    """A sensor's residual against white noise of its stated uncertainty.

    Attributes
    ----------
    ratio : float
        Root mean square in times the noise.
    excess : ndarray (scales,)
        Power of the means over ``SCALES`` samples beyond that of white noise, in times the noise power.
    score : ndarray (scales,)
        The same in standard deviations of its estimate for white noise.
    """

    ratio: float
    excess: np.ndarray
    score: np.ndarray


def noise_of(residual: Sequence[np.ndarray]) -> Noise:
    """Compare a sensor's residual, (t,) in times the noise for each segment, with white noise; NaN is not counted."""
    total = np.concatenate([part[np.isfinite(part)] for part in residual])
    excess, score = [], []
    for scale in SCALES:
        means = np.concatenate([_means(part, scale) for part in residual])
        if len(means) < 4:
            break
        beyond = float(np.mean(means**2)) - 1.0
        excess.append(beyond / scale)
        score.append(beyond / np.sqrt(2 / len(means)))
    return Noise(float(np.sqrt(np.mean(total**2))) if len(total) else 0.0, np.array(excess), np.array(score))


def _means(part: np.ndarray, scale: int) -> np.ndarray:
    """Block means of a white signal of variance 1, scaled back to variance 1; blocks with missing samples are
    weighed."""
    n = len(part) // scale * scale
    blocks = part[:n].reshape(-1, scale)
    there = np.isfinite(blocks)
    counted = there.sum(axis=1)
    sums = np.where(there, blocks, 0.0).sum(axis=1)
    return sums[counted > scale / 2] / np.sqrt(counted[counted > scale / 2])


def effective_share(residual: np.ndarray) -> float:
    """Share of a residual's samples (t,) that count as independent: 1 if it is white (Sokal 1997).

    The autocorrelation is summed up to the first window that is five times the sum itself.
    """
    own = residual[np.isfinite(residual)]
    own = own - own.mean()
    length = fft.next_fast_len(2 * len(own), real=True)
    spectrum = fft.rfft(own, length)
    correlation = fft.irfft(spectrum * np.conj(spectrum), length)[: len(own)]
    if correlation[0] <= 0:
        return 1.0
    time = 2 * np.cumsum(correlation / correlation[0]) - 1
    window = np.arange(len(time)) >= 5 * time
    stop = int(np.argmax(window)) if window.any() else len(time) - 1
    return float(1 / max(time[stop], 1.0))
