"""What sensors make of true values: gain, zero, drift, noise, counts of encoders, drop-outs. One model for all rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

DRAWN_AT_ONCE = 2000  # samples of noise (speed and memory only)
NEVER = 1 << 60  # a sample that no run reaches


@dataclass(frozen=True)
class SensorErrors:
    """Errors of s sensors on b rows.

    Attributes
    ----------
    sensors : tuple of str (s)
    gain : ndarray (b, s)
        Reading over true value.
    zero : ndarray (b, s)
        SI, constant.
    drift : ndarray (b, s)
        SI, by which the zero moves from sample ``drift_from`` on, evenly over ``drift_samples``; 0: at once.
    noise : ndarray (b, s)
        Standard deviation of white noise, SI.
    count : ndarray (b, s)
        rad of one count of an encoder; 0: no encoder. A speed is the difference of two counted angles over a sample,
        and its mean over a sample is half a sample late, which the dead time counts.
    out : ndarray of int (2, b, s)
        First sample in which a sensor reads 0, and the first after it.
    drift_from, drift_samples : int
    noise_from : int
        Sample from which on there is noise, and encoders count.
    seed : int
        Of noise and of where encoders stand at the begin.
    """

    sensors: tuple[str, ...]
    gain: np.ndarray
    zero: np.ndarray
    drift: np.ndarray
    noise: np.ndarray
    count: np.ndarray
    out: np.ndarray
    drift_from: int = 0
    drift_samples: int = 0
    noise_from: int = 0
    seed: int = 0

    @classmethod
    def none(cls, sensors: Sequence[str], rows: int) -> SensorErrors:
        """Sensors that read what is true."""
        shape = rows, len(sensors)
        zero = np.zeros(shape)
        return cls(tuple(sensors), np.ones(shape), zero, zero, zero, zero, np.full((2, *shape), NEVER, dtype=np.int64))

    @property
    def noisy(self) -> bool:
        """Whether any sensor is."""
        return bool(self.noise.any())


@dataclass
class Sensing:
    """Sensors with these errors in a run; NumPy's version of ``sense`` in ``rows.c``, operation by operation."""

    errors: SensorErrors
    span: float
    angle: np.ndarray = field(init=False)
    last: np.ndarray = field(init=False)
    rest: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """Back to the first sample."""
        self._random = np.random.default_rng(self.errors.seed)
        self._noise, self._used = np.zeros((0, *self.errors.gain.shape)), 0
        self.angle = np.ascontiguousarray(self._random.uniform(0.0, 1.0, self.errors.count.shape) * self.errors.count)
        self.last, self.rest, self._sample = np.zeros(self.angle.shape), self.angle.copy(), 0

    def drawn(self, samples: int) -> np.ndarray | None:
        """Noise (samples, b, s) of the next samples, SI; None without any."""
        if not self.errors.noisy:
            return None
        return self.errors.noise * self._random.standard_normal((samples, *self.errors.noise.shape))

    def read(self, true: np.ndarray) -> np.ndarray:
        """Readings (s, b) of the next sample's true values (s, b)."""
        errors, n = self.errors, self._sample
        exact = errors.gain * true.T
        if n == 0:
            self.last = exact.copy()  # it turned as fast before
        read = exact
        if errors.count.any():
            size = np.where(errors.count > 0, errors.count, 1.0)
            self.angle = self.angle + self.span * (self.last + exact) / 2
            self.last, rest = exact, np.mod(self.angle, size)
            if n >= errors.noise_from:
                read = np.where(errors.count > 0, read + (self.rest - rest) / self.span, read)
            self.rest = rest
        if errors.noisy:
            if self._used == len(self._noise):
                noise = self.drawn(DRAWN_AT_ONCE)
                assert noise is not None
                self._noise, self._used = noise, 0
            if n >= errors.noise_from:
                read = read + self._noise[self._used]
            self._used += 1
        read = read + errors.zero
        if n > errors.drift_from:
            read = read + errors.drift * min((n - errors.drift_from) / max(errors.drift_samples, 1), 1.0)
        read = np.where((n >= errors.out[0]) & (n < errors.out[1]), 0.0, read)
        self._sample += 1
        return read.T
