"""Firing pulses of an engine beyond a cut: torques over its angle, and what is added to the commands for them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from modelling.system import Effect, System

# --- The engine is simulated, so its angle is known, and with it the pulses that are to come. The law holds a pulse for
# a torque that stays as it is over the dead time; soon that is wrong by a quarter of a period. So at every speed the
# response of the closed loop to a pulse is worked out, and that to a torque added to each command; the sum of both is
# what the vehicle in one piece does. That is a feed-forward: no pole moves. A slow correction in step with the pulse
# takes out what the bed is off from its plan (harmonic control: Sievers and von Flotow, IEEE TSP 40 (1992) 2384).

KIND = "torque_ripple"


@dataclass(frozen=True)
class FiringSettings:
    """The numbers of the pulses that no search tunes.

    Attributes
    ----------
    speed_time : float
        s over which the speed of the engine is averaged, by which the added torques are taken: it turns unevenly with
        each pulse. Chosen by trial: 0.02 to 0.1 do alike.
    finest : float
        Relative, of one speed of the table to the next. A mode with 2 % damping is 4 % wide.
    highest : float
        Of the sampling frequency, up to which pulses are followed: with five samples a period a held command still has
        94 % of its amplitude.
    fades : float
        Relative, above the highest frequency, over which the added torques fall to zero.
    correcting : float
        s, time constant with which what is added is corrected by the speed error at the cut: no bed is as planned.
        Chosen by trial: from 0.1 to 0.5 drawn beds keep the amplitude alike.
    """

    speed_time: float = 0.05
    finest: float = 0.015
    highest: float = 0.2
    fades: float = 0.15
    correcting: float = 0.2


FIRING = FiringSettings()


@dataclass(frozen=True)
class Pulses:
    """Torques over the angle of inertias of a residual vehicle: m pulses, v of its states.

    Attributes
    ----------
    places : tuple of str (m)
        Inertias.
    order, amplitude, phase : ndarray (m,)
        amplitude · sin(order · angle + phase), N·m.
    by : ndarray (v, m)
        Rates for 1 N·m of each.
    turns : ndarray (m, v)
        Speed of its inertia by state, rad/s.
    """

    places: tuple[str, ...]
    order: np.ndarray
    amplitude: np.ndarray
    phase: np.ndarray
    by: np.ndarray
    turns: np.ndarray

    @property
    def count(self) -> int:
        """Number m of them."""
        return len(self.places)


def pulses_in(system: System) -> list[Effect]:
    """Torques over an angle in a model."""
    return [effect for effect in system.effects if effect.kind == KIND]


@dataclass(frozen=True)
class PulseFollowing:
    """Torques that are added to the commands for each pulse; p speeds, m pulses, k dynamometers.

    Attributes
    ----------
    speeds : ndarray (m, p)
        rad/s of the pulse's inertia, rising.
    gains : ndarray (m, p, k), complex
        Added torque over the pulse, both as turning phasors at the begin of a sample.
    answers : ndarray (m, p), complex
        Speed error at the pulse's cut, rad/s, for 1 N·m added to the command of the machine there.
    machines : tuple of int (m)
        Which dynamometer that is.
    speed_time, correcting : float
        s, see :class:`FiringSettings`.
    """

    speeds: np.ndarray
    gains: np.ndarray
    answers: np.ndarray
    machines: tuple[int, ...]
    speed_time: float
    correcting: float

    def at(self, number: int, speed: float) -> np.ndarray:
        """Gains (k,), complex, of a pulse at a speed, rad/s; beyond the table those of its ends."""
        low, share = self._place(number, speed)
        table = self.gains[number]
        gains: np.ndarray = table[low] + share * (table[low + 1] - table[low])
        return gains

    def corrected(
        self, number: int, speed: float, correction: complex, error: float, phase: float, step: float
    ) -> complex:
        """The correction of a pulse, N·m as a turning phasor, a sample (s) later; ``error`` at its cut in rad/s.

        Twice the error, turned back by the phase (rad), is in the mean the phasor of the error. Beyond the table the
        correction is forgotten.
        """
        known, share = self.speeds[number], step / self.correcting
        if not known[0] <= speed < known[-1]:
            return correction * (1 - share)
        low, part = self._place(number, speed)
        answer = self.answers[number, low] + part * (self.answers[number, low + 1] - self.answers[number, low])
        return complex(correction - share * 2j * error * np.exp(-1j * phase) / answer)

    def _place(self, number: int, speed: float) -> tuple[int, float]:
        known = self.speeds[number]
        low = int(np.clip(np.searchsorted(known, speed, side="right") - 1, 0, len(known) - 2))
        return low, float(np.clip((speed - known[low]) / (known[low + 1] - known[low]), 0.0, 1.0))


def no_following(dynamometers: int) -> PulseFollowing:
    """Of a vehicle without pulses."""
    gains = np.zeros((0, 2, dynamometers), complex)
    return PulseFollowing(np.zeros((0, 2)), gains, np.ones((0, 2), complex), (), FIRING.speed_time, FIRING.correcting)
