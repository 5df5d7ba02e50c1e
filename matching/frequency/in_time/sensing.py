"""What poor sensors make of the true signals: noise, offset, encoders that count."""

from __future__ import annotations

import numpy as np

from modelling.bed.observer.model import NOISE
from modelling.model.components import Sensor

ANGLE_OF_A_COUNT = 2 * np.pi / 8192  # rad, of an encoder
OFFSET_IN_UNCERTAINTIES = 2.0  # of a torque sensor, one way or the other


class PoorSensors:
    """Sensors of the beds that have poor ones; y sensors, b beds.

    Torques get noise and an offset. Speeds are differences of counts: the angle is known to a count at every sample,
    and noise of the sensor's uncertainty is added. A mean over a sample is half a sample late: that belongs to the
    dead time.

    Parameters
    ----------
    sensors : sequence of Sensor (y)
    poor : ndarray of bool (b,)
    gains : ndarray (y, b)
        Reading over what is measured, of every bed.
    step : float
        s, one sample.
    seed : int
        Of noise and signs.
    """

    def __init__(self, sensors: list[Sensor], poor: np.ndarray, gains: np.ndarray, step: float, seed: int):
        self._random = np.random.default_rng(seed)
        self._poor, self._gains, self._step = poor, gains, step
        self._noise = np.array([sensor.uncertainty or NOISE[sensor.measures] for sensor in sensors])[:, None]
        self._counts = np.array([sensor.measures == "speed" for sensor in sensors])
        sides = self._random.choice([-1.0, 1.0], self._noise.shape)
        self._offset = np.where(self._counts[:, None], 0.0, OFFSET_IN_UNCERTAINTIES * sides * self._noise)
        self._angle, self._last, self._rest = np.zeros(gains.shape), np.zeros(gains.shape), np.zeros(gains.shape)

    def read(self, true: np.ndarray) -> np.ndarray:
        """Readings (y, b) of the true values (y, b), one sample after the other."""
        exact = self._gains * true
        if not self._poor.any():
            return exact
        self._angle, self._last = self._angle + self._step * (self._last + true) / 2, true
        rest = self._angle % ANGLE_OF_A_COUNT
        error = np.where(self._counts[:, None], (self._rest - rest) / self._step, self._offset)
        self._rest = rest
        noise = self._noise * self._random.standard_normal((len(true), 1))
        return np.where(self._poor, exact + error + noise, exact)
