"""The controller with its supervision, sample by sample, in Python: what the C sources have to equal.

Three modes: zero torque, speed hold and emulation. Emulation begins from the readings, torques and commands of its
first sample, so it begins without a bump at any steady speed. What goes wrong ends it: readings that are not finite, do
not come or do not change, a rotor too fast, a torque that is gone at once, a shaft that opens, or readings that are
not what the controller's model expects. Then the speeds are held, or, where they are not known any more, the torque is
zero, until zero torque is asked for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from modelling.controller import settings as fixed
from modelling.controller.law import ControlLaw
from modelling.controller.opened_shaft import WATCHED_SAMPLES, ShaftWatch, WatchedShafts
from modelling.controller.settings import EMULATION, SPEED_HOLD, ZERO_TORQUE, Settings
from modelling.controller.torque_gone import KEPT_SAMPLES, has_gone


@dataclass(frozen=True)
class Answer:
    """Commands (k,), N·m; the mode that is active and the fault that ended the emulation, numbers of
    :mod:`modelling.controller.settings`."""

    commands: np.ndarray
    mode: int
    fault: int


class SupervisedController:
    """A control law with its supervision.

    Parameters
    ----------
    law : ControlLaw
    settings : Settings
    torque_readings, speed_readings : sequence of int (k)
        Which readings are the dynamometers' flange torques and speeds.
    watched : WatchedShafts
        Shafts whose opening is noticed.
    """

    def __init__(
        self, law: ControlLaw, settings: Settings, torque_readings: list[int], speed_readings: list[int],
        watched: WatchedShafts,
    ):  # fmt: skip
        self.law, self.settings, self._watch = law, settings, ShaftWatch(watched)
        self._torques, self._speeds = torque_readings, speed_readings
        self.reset()

    def reset(self) -> None:
        """Back to zero torque, everything forgotten."""
        k, y = len(self.law.dynamometers), len(self.law.sensors)
        self._mode, self._fault, self._fallback = ZERO_TORQUE, 0, ZERO_TORQUE
        self._sent, self._integral, self._held = np.zeros(k), np.zeros(k), np.zeros(k)
        self._state = np.zeros(len(self.law.A))
        self._start = np.zeros(y), np.zeros(len(self.law.known)), np.zeros(k)
        self._last = np.zeros(y)
        self._past_torques = np.zeros((max(KEPT_SAMPLES, WATCHED_SAMPLES), k))
        self._deviations = np.zeros((WATCHED_SAMPLES, y))
        self._watch.reset()
        self._gone = np.zeros(k, bool)
        self._unchanged = self._lifeless = self._surprised = 0
        self._life: int | None = None

    def step(self, readings: np.ndarray, known: np.ndarray, mode: int, hold: np.ndarray, life: int = 0) -> Answer:
        """One sample.

        Parameters
        ----------
        readings, known, hold : ndarray (y,), (w,), (k,)
            Readings in SI, known torques (N·m), speeds to hold (rad/s).
        mode : int
            That is asked for. Zero torque also ends a fault that is over.
        life : int
            A number that changes from sample to sample as long as the sender lives.
        """
        fault = self._check(readings, known, hold, life)
        if fault and not self._fault and self._mode != ZERO_TORQUE:
            self._fault = fault
            self._fallback = SPEED_HOLD if fault in fixed.HOLDABLE else ZERO_TORQUE
            below = fixed.HELD_BELOW_LIMIT * self.settings.speed_limit
            self._held = np.clip(readings[self._speeds], -below, below) if fault in fixed.HOLDABLE else self._held
        elif fault and fault not in fixed.HOLDABLE:
            self._fallback = ZERO_TORQUE
        if not fault and mode == ZERO_TORQUE:
            self._fault = 0
        unknown = bool(fault) and fault not in fixed.HOLDABLE
        wanted = self._fallback if self._fault else mode
        self._enter(ZERO_TORQUE if unknown else wanted, readings, known, hold)
        self._sent = self._command(readings, known, hold)
        if not np.isfinite(self._sent).all():  # a law that has left all bounds
            self._mode, self._fault, self._fallback = ZERO_TORQUE, 1, ZERO_TORQUE
            self._sent = np.zeros(len(self._sent))
        if not unknown:
            self._last = readings.copy()
            self._past_torques = np.vstack([readings[self._torques], self._past_torques[:-1]])
        return Answer(self._sent / self.settings.torque_gain, self._mode, self._fault)

    def _check(self, readings: np.ndarray, known: np.ndarray, hold: np.ndarray, life: int) -> int:
        """The first of :data:`FAULTS` that shows."""
        settings = self.settings
        self._lifeless = self._lifeless + 1 if life == self._life else 0
        self._life = life
        if not (np.isfinite(readings).all() and np.isfinite(known).all() and np.isfinite(hold).all()):
            return 1
        if 0 < settings.life_samples <= self._lifeless:
            return 2
        speeds = np.abs(readings[self._speeds])
        still = np.array_equal(readings, self._last) and (speeds > fixed.TURNING).any()
        self._unchanged = self._unchanged + 1 if still else 0
        if 0 < settings.frozen_samples <= self._unchanged:
            return 3
        if (speeds > settings.speed_limit).any():
            return 4
        if self._mode != EMULATION:
            self._surprised = 0
            return 0
        deviation = readings - self._start[0] - self.law.E @ self._state
        self._deviations = np.vstack([deviation, self._deviations[:-1]])
        if self._has_lost_torque(readings):
            return fixed.TORQUE_GONE
        self._surprised = self._surprised + 1 if (np.abs(deviation) > settings.unexpected).any() else 0
        return 6 if self._surprised >= fixed.SAMPLES_IN_A_ROW else 0

    def _has_lost_torque(self, readings: np.ndarray) -> bool:
        """A flange torque is gone, or a shaft has opened."""
        settings, before = self.settings, self._past_torques
        self._gone = has_gone(np.vstack([readings[self._torques], before[:KEPT_SAMPLES]]), settings.lost_torque)
        opened = self._watch.opened(
            self._deviations.ravel(), before[WATCHED_SAMPLES - 1], settings.opened_torque, settings.opened_share
        )
        self._gone |= (self._watch.watched.carried[opened] != 0).any(axis=0)  # the rotors that it loaded
        return bool(self._gone.any())

    def _enter(self, mode: int, readings: np.ndarray, known: np.ndarray, hold: np.ndarray) -> None:
        if mode == self._mode:
            return
        self._mode = mode
        if mode == SPEED_HOLD:
            wanted = self._held if self._fault else hold
            # a rotor whose load is gone would be swung by the torque that balanced it
            carried = np.where(self._gone & (self._fault == fixed.TORQUE_GONE), 0.0, self._sent)
            self._integral = carried - self.settings.hold_proportional * (wanted - readings[self._speeds])
        if mode == EMULATION:
            self._start = readings.copy(), known.copy(), self._sent.copy()
            self._state = np.zeros(len(self.law.A))
            self._past_torques[:] = readings[self._torques]
            self._surprised = 0
            self._deviations[:] = 0.0
            self._watch.reset()

    def _torque_limits(self, readings: np.ndarray) -> np.ndarray:
        """Largest torques (k,), N·m, at the speeds that are read."""
        settings, speeds = self.settings, np.abs(readings[self._speeds])
        of_power = settings.power_limit / np.maximum(speeds, fixed.SLOWEST)
        of_curve = np.interp(speeds, settings.curve_speeds, settings.curve_torques)
        return np.minimum(np.minimum(settings.torque_limit, of_power), of_curve)

    def _command(self, readings: np.ndarray, known: np.ndarray, hold: np.ndarray) -> np.ndarray:
        settings, limit = self.settings, self._torque_limits(readings)
        if self._mode == EMULATION:
            law, (y0, w0, u0) = self.law, self._start
            y, w = readings - y0, known - w0
            corrected = self._state + law.L @ (y - law.E @ self._state)
            sent = np.clip(u0 + law.K @ corrected + law.Dy @ y + law.Dw @ w, -limit, limit)
            self._state = law.A @ corrected + law.By @ y + law.Bw @ w + law.Bs @ (sent - u0)
            return sent
        if self._mode == SPEED_HOLD:
            error = (self._held if self._fault else hold) - readings[self._speeds]
            asked = settings.hold_proportional * error + self._integral
            sent = np.clip(asked, -limit, limit)
            within = asked == sent
            self._integral = self._integral + within * settings.hold_integral * self.law.sample_time * error
            return sent
        return np.zeros(len(self._sent))
