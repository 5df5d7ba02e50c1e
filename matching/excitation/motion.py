"""What an excitation does to beds under a slow speed hold, from sample to sample; b beds at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from matching.excitation.recorded_bed import RecordedBed
from modelling.bed.delayed_bed import delayed_bed
from modelling.controller.settings import Settings

SLOWER = 0.05  # crossover of the speed hold that runs beside an excitation, over that of the controller's own


@dataclass(frozen=True)
class SpeedHold:
    """Gains (k,) of the speed hold of each dynamometer, N·m·s/rad and N·m/rad."""

    proportional: np.ndarray
    integral: np.ndarray

    @classmethod
    def of(cls, settings: Settings) -> SpeedHold:
        """Slow enough to leave an excitation alone: the controller's own, slowed down."""
        return cls(SLOWER * settings.hold_proportional, SLOWER**2 * settings.hold_integral)


@dataclass(frozen=True)
class ExcitedMotion:
    """Deviations from the steady motion; b beds, t samples, k dynamometers.

    Attributes
    ----------
    commands : ndarray (t, b, k)
        Torque commands, speed hold included, N·m.
    outputs : ndarray (t, b, y + 2s)
        Sensors of the rig, then torques and twists of its shafts.
    """

    commands: np.ndarray
    outputs: np.ndarray

    def scaled(self, factor: float) -> ExcitedMotion:
        """The motion under that many times the torques: all is linear."""
        return ExcitedMotion(factor * self.commands, factor * self.outputs)


class ExcitedBeds:
    """Several beds of a case, ready to be excited.

    Parameters
    ----------
    bed : RecordedBed
    values : sequence of mappings (b)
        Values of what is uncertain.
    hold : SpeedHold
    """

    def __init__(self, bed: RecordedBed, values: Sequence[Mapping[str, float]], hold: SpeedHold):
        loop = bed.case.loop
        self._hold, self._step = hold, loop["sample_time"]
        beds = [bed.at(bed_values) for bed_values in values]
        sampled = [delayed_bed(linear.A, linear.commands, linear.torques, linear.delay, self._step) for linear in beds]
        self._whole, self._new, self._old, self._torques = (
            np.stack([getattr(delayed, name) for delayed in sampled]) for name in ("whole", "new", "old", "torques")
        )
        self._delays = np.array([linear.delay for linear in sampled])
        rows = [bed.rows(linear, bed_values) for linear, bed_values in zip(beds, values, strict=True)]
        self._C, self._D = np.stack([C for C, _ in rows]), np.stack([D for _, D in rows])
        at = [bed.sensors.index(dynamometer.speed_sensor) for dynamometer in loop.dynamometers]
        self._speeds = at
        self._continuous = beds

    def steady(self, speed: float) -> tuple[np.ndarray, np.ndarray]:
        """Commands (b, k) and outputs (b, y + 2s) of the steady motion with every rotor at a speed, rad/s."""
        commands, outputs = [], []
        for linear, C in zip(self._continuous, self._C, strict=True):
            n, k = linear.commands.shape
            equations = np.block([[linear.A, linear.commands], [C[self._speeds], np.zeros((k, k))]])
            solution = np.linalg.lstsq(equations, np.append(np.zeros(n), np.full(k, speed)), rcond=None)[0]
            commands.append(solution[n:])
            outputs.append(C @ solution[:n])
        return np.stack(commands), np.stack(outputs)

    def run(self, demands: np.ndarray) -> ExcitedMotion:
        """Deviations under demanded torques (t, u), linear between samples, from the steady motion on.

        What is applied in a sample is the mean of the demand over it.
        """
        t, b, k = len(demands), len(self._whole), self._new.shape[2]
        applied = np.vstack([(demands[:-1] + demands[1:]) / 2, demands[-1:]])
        pushed = np.einsum("bxd,td->tbx", self._torques, applied[:, k:])
        direct = np.einsum("byd,td->tby", self._D[:, :, k:], demands[:, k:])
        x, integral = self._whole.shape[1], np.zeros((b, k))
        lead = self._delays.max() + 1
        sent = np.zeros((t + lead, b, k))  # shifted: commands before the first are zero
        each = np.arange(b)
        # one product a sample: [state, newest and older command that act] → next state
        both = np.concatenate([self._whole, self._new, self._old], axis=2)
        states = np.zeros((t + 1, b, x + 2 * k))
        speed_rows = self._C[:, self._speeds]
        for i in range(t):
            z = states[i]
            error = -np.matmul(speed_rows, z[:, :x, None])[:, :, 0]
            sent[lead + i] = applied[i, :k] + self._hold.proportional * error + integral
            integral += self._hold.integral * self._step * error
            now = lead + i - self._delays
            z[:, x : x + k], z[:, x + k :] = sent[now, each], sent[now - 1, each]
            states[i + 1, :, :x] = np.matmul(both, z[:, :, None])[:, :, 0] + pushed[i]
        outputs = np.swapaxes(np.matmul(self._C, np.moveaxis(states[:-1, :, :x], 0, 2)), 0, 2)
        return ExcitedMotion(sent[lead:], np.swapaxes(outputs, 1, 2) + direct)
