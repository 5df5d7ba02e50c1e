"""How residuals are weighted where the model is not perfect: model error is no white noise.

Each sensor has a scale and a memory of its own: what the model leaves of it is taken as a first-order autoregressive
process e[t] = memory·e[t − 1] + scale·w[t] with white w. The slow drift of an encoder angle then does not hide that the
same encoder follows a vibration to a microradian, and no sensor outvotes the others because it is precise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

LARGEST_MEMORY = 0.9999  # of one sample; a drift over ten thousand samples is a random walk
SMALLEST_MEMORY = 0.0
SMALLEST_SCALE = 1e-6  # times the noise; less is rounding


@dataclass(frozen=True)
class Weighting:
    """Memory of one sample and scale, in times the noise, of what a model leaves of each sensor.

    Attributes
    ----------
    memory, scale : ndarray (y,)
    """

    memory: np.ndarray
    scale: np.ndarray

    @property
    def without_memory(self) -> Weighting:
        """The same standard deviations as white noise: for a free simulation whose whole error counts."""
        return Weighting(np.zeros_like(self.memory), self.scale / np.sqrt(1 - self.memory**2))

    def with_slow_part(self, power: np.ndarray) -> Weighting:
        """Weights by which the innovation (the part of the error that its past does not predict) counts half, and the
        error itself, slow parts included, the other half.

        The sum of squares of both whitenings is that of one first-order filter, whose zero follows from the spectrum
        |1 − memory·z|²/scale² + 1/power (spectral factorization).

        Parameters
        ----------
        power : ndarray (y,)
            Mean square of each sensor's error, in times the noise.
        """
        square = np.maximum(self.scale, SMALLEST_SCALE) ** 2
        constant = ((1 + self.memory**2) / square + 1 / np.maximum(power, square)) / 2
        neighbours = self.memory / square / 2
        # constant = (1 + zero²)·weight and neighbours = zero·weight
        weight = (constant + np.sqrt(constant**2 - 4 * neighbours**2)) / 2
        return Weighting(neighbours / weight, 1 / np.sqrt(weight))

    def weigh(self, errors: np.ndarray, measured: np.ndarray) -> np.ndarray:
        """Errors (b, t, y), in times the noise, as white noise of variance 1; 0 where nothing was measured.

        A first sample, and one after a missing one, counts with the standard deviation of the process.
        """
        follows = np.zeros_like(measured)
        follows[1:] = measured[1:] & measured[:-1]
        out = np.where(measured, errors, 0.0)
        out[:, 1:] -= np.where(follows[1:], self.memory * np.where(measured[:-1], errors[:, :-1], 0.0), 0.0)
        return out * np.where(follows, 1.0, np.sqrt(1 - self.memory**2)) / self.scale

    def weigh_transposed(self, weighted: np.ndarray, measured: np.ndarray) -> np.ndarray:
        """The adjoint of :meth:`weigh` on one signal (t, y): the gradient by the errors of half its sum of squares."""
        follows = np.zeros_like(measured)
        follows[1:] = measured[1:] & measured[:-1]
        scaled = np.where(measured, weighted, 0.0) / self.scale
        out = scaled * np.where(follows, 1.0, np.sqrt(1 - self.memory**2))
        out[:-1] -= np.where(follows[1:], self.memory * scaled[1:], 0.0)
        return out


def weighting_of(errors: Sequence[np.ndarray], measured: Sequence[np.ndarray]) -> Weighting:
    """Memory and scale of what a model leaves of the sensors.

    The memory is the correlation of neighbours, which maximises the likelihood but for the first samples. Both are what
    the errors show, whatever uncertainty is stated: that of an encoder may be one of its mounting, not of its steps.

    Parameters
    ----------
    errors : sequence of ndarray (t, y)
        Of each segment, in times the noise.
    measured : sequence of ndarray (t, y)
    """
    pairs = [m[1:] & m[:-1] for m in measured]
    before = np.concatenate([np.where(pair, e[:-1], 0.0) for e, pair in zip(errors, pairs, strict=True)])
    after = np.concatenate([np.where(pair, e[1:], 0.0) for e, pair in zip(errors, pairs, strict=True)])
    count = np.maximum(np.concatenate(pairs).sum(axis=0), 1)
    square = np.sum(before**2, axis=0)
    memory = np.sum(before * after, axis=0) / np.where(square > 0, square, 1.0)
    memory = np.clip(memory, SMALLEST_MEMORY, LARGEST_MEMORY)
    scale = np.sqrt(np.sum((after - memory * before) ** 2, axis=0) / count)
    return Weighting(memory, np.maximum(scale, SMALLEST_SCALE))
