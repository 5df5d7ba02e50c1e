"""One drawn bed under a sampled controller, assembled here once more: from dynamic stiffness, not from state spaces.

What the rig does between samples follows from its masses, dampings and stiffnesses, read off the dynamic stiffness at
three s; what it shows at a frequency from the dynamic stiffness itself. The controller is what is judged: its matrices
are taken as they are, step by step as it runs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import expm

from matching.frequency.case.case import Case
from matching.frequency.independent.chain import Chain, NotCovered
from modelling.controller.law import ControlLaw

POLYNOMIAL = 1e-9  # relative: so well must M·s² + D·s + K give the dynamic stiffness at a further s


@dataclass(frozen=True)
class DrawnBed:
    """A bed with values of its own; n coordinates, k dynamometers, y sensors of the controller.

    ``values`` are named as :class:`matching.frequency.case.uncertainty.Uncertain` has them.
    """

    case: Case
    rig: Chain
    values: Mapping[str, float]

    def _value(self, name: str) -> float:
        return self.values.get(f"loop.{name}", self.case.loop[name])

    @property
    def _delay(self) -> float:
        """From a sample to the moment its command acts, s: the dead time counts half a sample of hold."""
        return max(self._value("dead_time") - self.case.loop["sample_time"] / 2, 0.0)

    @cached_property
    def gains(self) -> np.ndarray:
        """Air-gap torque over command (k,)."""
        names = [dynamometer.name for dynamometer in self.case.loop.dynamometers]
        return np.array([self.values.get(f"dynamometers.{name}.torque_gain", 1.0) for name in names])

    @cached_property
    def sensor_gains(self) -> np.ndarray:
        """Reading over what is measured (y,)."""
        return np.array([self.values.get(f"sensors.{name}.gain", 1.0) for name in self.case.loop.controller_sensors])

    @cached_property
    def drive(self) -> np.ndarray:
        """Generalised torques (n, k) of unit air-gap torques."""
        return self.rig.drive([dynamometer.torque_input for dynamometer in self.case.loop.dynamometers])

    def sensors(self, s: np.ndarray) -> np.ndarray:
        """What the controller's sensors read (f, y, n) of unit coordinates, gains and the flanges' lag included."""
        names, k = self.case.loop.controller_sensors, len(self.gains)
        rows = np.stack([self.rig.reading(name, s) for name in names], axis=1) * self.sensor_gains[:, None]
        rows[:, :k] /= (1 + s * self._value("torque_sensor_lag"))[:, None, None]
        return rows

    def moved(self, s: np.ndarray, torques: np.ndarray) -> np.ndarray:
        """Coordinates (f, n, d) in rad for generalised torques (n, d) in N·m at s (f,)."""
        load = np.broadcast_to(torques.astype(complex), (len(s), *torques.shape))
        return np.linalg.solve(self.rig.stiffness(s), load)

    def command_at(self, s: np.ndarray) -> np.ndarray:
        """Air-gap torques (f, k) at a frequency for sampled commands: hold, dead time, lag and gain."""
        step = self.case.loop["sample_time"]
        hold = (1 - np.exp(-s * step)) / (s * step)
        late = hold * np.exp(-s * self._delay) / (1 + s * self._value("inverter_lag"))
        return late[:, None] * self.gains

    @cached_property
    def rates(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A (x, x), B (x, k), C (y, x) in continuous time; states [coordinates, rates, air gap, flanges, sensors].

        Raises
        ------
        NotCovered
            If the rig's dynamic stiffness is no polynomial of second degree in s.
        """
        K, plus, minus, other = np.real(self.rig.stiffness(np.array([0.0, 1.0, -1.0, 2.0], complex)))
        M, D = (plus + minus) / 2 - K, (plus - minus) / 2
        if np.abs(4 * M + 2 * D + K - other).max() > POLYNOMIAL * np.abs(other).max():
            raise NotCovered("a rig whose dynamic stiffness is no polynomial")
        n, k = len(M), len(self.gains)
        names = self.case.loop.controller_sensors
        first = 2 * n + 2 * k
        size = first + sum(time > 0 for name in names for *_, time in self.rig.sections(name))
        A, B, C = np.zeros((size, size)), np.zeros((size, k)), np.zeros((len(self.sensor_gains), size))
        A[:n, n : 2 * n] = np.eye(n)
        A[n : 2 * n, : 2 * n + 2 * k] = np.linalg.solve(
            M, np.hstack([-K, -D, self.drive * self.gains, np.zeros((n, k))])
        )
        lag, sensor_lag = self._value("inverter_lag"), self._value("torque_sensor_lag")
        A[2 * n : 2 * n + k, 2 * n : 2 * n + k], B[2 * n : 2 * n + k] = -np.eye(k) / lag, np.eye(k) / lag
        for i, name in enumerate(names):
            still, turning = (self.rig.measured(name, np.array([s]))[0] for s in (0.0j, 1.0 + 0j))
            row = np.zeros(size)
            row[: 2 * n] = np.real(np.concatenate([still, turning - still])) * self.sensor_gains[i]
            for direct, lagged, time in self.rig.sections(name):
                before, row = row, direct * row
                if time > 0:
                    A[first] = before / time
                    A[first, first] -= 1 / time
                    row[first] += lagged
                    first += 1
            if i < k:
                A[2 * n + k + i] += row / sensor_lag
                A[2 * n + k + i, 2 * n + k + i] -= 1 / sensor_lag
                C[i, 2 * n + k + i] = 1
            else:
                C[i] = row
        return A, B, C

    @cached_property
    def stepped(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A (x, x), B (x, k), C (y, x) from sample to sample; states end with commands on their way, oldest first."""
        A, B, C = self.rates
        x, k, step = len(A), B.shape[1], self.case.loop["sample_time"]
        late = self._delay / step
        waiting = int(np.ceil(late - 1e-9)) or 1  # commands that a sample may still wait for
        switch = waiting - late  # of the sample, from its beginning to where the next command arrives, counted back
        augmented = np.block([[A, B], [np.zeros((k, x + k))]])
        first, rest = expm(augmented * step * (1 - switch)), expm(augmented * step * switch)
        whole = np.zeros((x + k * waiting,) * 2)
        whole[:x, :x] = rest[:x, :x] @ first[:x, :x]
        whole[:x, x : x + k] += rest[:x, :x] @ first[:x, x:]
        new = rest[:x, x:]
        drive = np.zeros((x + k * waiting, k))
        if waiting > 1:
            whole[:x, x + k : x + 2 * k] += new
            whole[x:-k, x + k :] = np.eye(k * (waiting - 1))
        else:
            drive[:x] = new
        drive[-k:] = np.eye(k)
        return whole, drive, np.hstack([C, np.zeros((len(C), k * waiting))])

    def closed(self, law: ControlLaw) -> np.ndarray:
        """State matrix (x + c, x + c) of bed and law, one sample after the other as they run.

        States of the law that neither readings nor commands reach are left out: no bed changes them.
        """
        A, B, C = self.stepped
        reached = _reached(law.A, np.hstack([law.L, law.By, law.Bs]))
        x, o = len(A), int(reached.sum())
        state = np.eye(x + o)
        bed, predicted, read = state[:x], state[x:], C @ state[:x]
        corrected = predicted + law.L[reached] @ (read - law.E[:, reached] @ predicted)
        sent = law.K[:, reached] @ corrected + law.Dy @ read
        inside = law.A[np.ix_(reached, reached)]
        return np.vstack([A @ bed + B @ sent, inside @ corrected + law.By[reached] @ read + law.Bs[reached] @ sent])


def _reached(A: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """Which states (x,) of x⁺ = A·x + inputs·u the inputs reach."""
    reached: np.ndarray = np.asarray(inputs.any(axis=1))
    for _ in range(len(A)):
        further = reached | (A[:, reached] != 0).any(axis=1)
        if (further == reached).all():
            break
        reached = further
    return reached
