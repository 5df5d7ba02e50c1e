"""The loop with its exact dead time, frequency by frequency, in NumPy."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from matching.frequency.loop.parts import Parts
from modelling.common.errors import unknown


class ExactLoop:
    """The feedback loop of a case; k dynamometers, complex s (f,).

    Parameters
    ----------
    parts : Parts
    dead_time : float, optional
        s; that of the case unless given.
    """

    def __init__(self, parts: Parts, dead_time: float | None = None):
        self.parts = parts
        self.dead_time = parts.case.loop["dead_time"] if dead_time is None else dead_time

    def return_difference(self, s: np.ndarray) -> np.ndarray:
        """I + L at the dynamometers' commands, (f, k, k)."""
        k = len(self.parts.dynamometers)
        plant = self._measured(s, [dynamometer.torque_input for dynamometer in self.parts.dynamometers])
        return np.eye(k) - self._controller(s)[:, :, : 2 * k] @ plant

    def response(self, s: np.ndarray, inputs: Sequence[str], sensors: Sequence[str]) -> np.ndarray:
        """Response (f, y, u) of the rig's sensors to torques on the rig or in the residual vehicle, by feedback alone.

        Raises
        ------
        InputError
            If a name is unknown.
        """
        parts, k = self.parts, len(self.parts.dynamometers)
        rig, s = parts.rig.space, np.asarray(s, complex)
        for name in inputs:
            if name not in (*rig.inputs, *parts.simulated):
                raise unknown(name, [*rig.inputs, *parts.simulated], "response")
        H, act = parts.rig.response(s), self._controller(s)
        here = [i for i, name in enumerate(inputs) if name in rig.inputs]
        drive = np.zeros((len(s), k, len(inputs)), complex)
        drive[:, :, here] = act[:, :, : 2 * k] @ self._measured(s, [inputs[i] for i in here])
        for i, name in enumerate(inputs):
            if name in parts.simulated:
                drive[:, :, i] = act[:, :, 2 * k + parts.simulated.index(name)]
        torque = np.linalg.solve(self.return_difference(s), drive)
        rows = [rig.outputs.index(name) for name in sensors]
        columns = [rig.inputs.index(dynamometer.torque_input) for dynamometer in parts.dynamometers]
        total = H[:, rows][:, :, columns] @ torque
        total[:, :, here] += H[:, rows][:, :, [rig.inputs.index(inputs[i]) for i in here]]
        return total

    def _measured(self, s: np.ndarray, inputs: Sequence[str]) -> np.ndarray:
        """Signed, lagged flange torques and rotor speeds (f, 2k, u) of the rig alone for its inputs."""
        parts, rig = self.parts, self.parts.rig.space
        H = parts.rig.response(s)[:, :, [rig.inputs.index(name) for name in inputs]]
        torque = H[:, [rig.outputs.index(dyno.torque_sensor) for dyno in parts.dynamometers]]
        speed = H[:, [rig.outputs.index(dyno.speed_sensor) for dyno in parts.dynamometers]]
        lag = 1 / (1 + np.asarray(s) * parts.case.loop["torque_sensor_lag"])
        return np.concatenate([torque * parts.toward[:, None] * lag[:, None, None], speed], axis=1)

    def _controller(self, s: np.ndarray) -> np.ndarray:
        """Air-gap torques (f, k, 2k + r) for flange torques, rotor speeds, simulated torques; lags included."""
        parts, loop, k = self.parts, self.parts.case.loop, len(self.parts.dynamometers)
        s = np.asarray(s, complex)
        sources = [*(cut.torque for cut in parts.cuts), *parts.simulated]
        count = len(sources) + k  # columns: flange torques (k), rotor speeds (k), simulated torques (r)
        reference = np.zeros((len(s), k, count), complex)
        columns = [*range(k), *range(2 * k, count)]
        for part in parts.residual:
            H, space = part.response(s), part.space
            for j, cut in enumerate(parts.cuts):
                for column, name in zip(columns, sources, strict=True):
                    if cut.speed in space.outputs and name in space.inputs:
                        reference[:, j, column] = H[:, space.outputs.index(cut.speed), space.inputs.index(name)]
        signals = np.eye(2 * k, count)
        law = loop.structure.commands(
            loop.values, s[:, None], [reference[:, j] for j in range(k)], list(signals[k:]), list(signals[:k])
        )
        act = np.exp(-s * self.dead_time) / (1 + s * loop["inverter_lag"])
        return act[:, None, None] * np.stack(law, axis=1)
