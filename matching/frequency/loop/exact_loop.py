"""The loop with its exact dead time, frequency by frequency, in NumPy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from matching.frequency.loop.parts import Parts
from modelling.common.errors import unknown


@dataclass(frozen=True)
class FeedForwardAction:
    """What the model-based feed-forward does about measured torques w.

    Attributes
    ----------
    commands : ndarray (f, k, w)
        As the inverters get them, dead time included.
    expected : ndarray (f, 2k, w)
        Signed flange torques and rotor speeds.
    """

    commands: np.ndarray
    expected: np.ndarray


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
        own = self._measured(s, [dyno.torque_input for dyno in self.parts.dynamometers])
        return np.eye(k) - self._controller(s)[:, :, : 2 * k] @ own

    def response(
        self,
        s: np.ndarray,
        inputs: Sequence[str],
        sensors: Sequence[str],
        feed_forward: FeedForwardAction | None = None,
    ) -> np.ndarray:
        """Response (f, y, u) of the rig's sensors to inputs of the rig or of the residual vehicle.

        Without ``feed_forward``, the feedback reacts to rig inputs only by what they do, and simulated inputs act in
        its residual vehicle.

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
        seen = np.zeros((len(s), 2 * k, len(inputs)), complex)
        seen[:, :, here] = self._measured(s, [inputs[i] for i in here])
        drive = act[:, :, : 2 * k] @ (seen if feed_forward is None else seen - feed_forward.expected)
        if feed_forward is not None:
            drive = drive + feed_forward.commands / (1 + s * parts.case.loop["inverter_lag"])[:, None, None]
        else:
            for i, name in enumerate(inputs):
                if name in parts.simulated:
                    drive[:, :, i] += act[:, :, 2 * k + parts.simulated.index(name)]
        torque = np.linalg.solve(self.return_difference(s), drive)
        rows = [rig.outputs.index(name) for name in sensors]
        columns = [rig.inputs.index(dyno.torque_input) for dyno in parts.dynamometers]
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
