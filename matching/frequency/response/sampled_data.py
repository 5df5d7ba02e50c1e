"""The loop as it runs: a continuous rig, a sampled controller; its response to continuous torques.

The controller samples the dynamometers' sensors and the measured torques, and holds each command for one sample time.
A torque exp(jωt) makes every sampled signal U·exp(jωkT); the held command has the same frequency beside its images at
ω ± 2πn/T. Inside the loop all of them count, as the rig is discretised exactly; of what the rig shows, the part at ω is
its response (Chen and Francis, Optimal Sampled-Data Control Systems, 1995, chapter 3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from matching.frequency.loop.linear_body import transfer
from matching.frequency.loop.parts import Parts
from modelling.bed.feed_forward import FeedForward
from modelling.common.errors import unknown
from modelling.linear.discretise import discretise


@dataclass(frozen=True)
class ControllerAction:
    """What the controller issues and expects at every sample for sampled torques w of 1 N·m.

    Attributes
    ----------
    commands : ndarray (f, k, w)
        N·m, as issued.
    expected : ndarray (f, 2k, w)
        Signed flange torques and rotor speeds that the feedback subtracts from what is measured.
    """

    commands: np.ndarray
    expected: np.ndarray


def feed_forward_action(
    feed_forward: FeedForward, sensor_signs: np.ndarray, names: Sequence[str], frequencies: np.ndarray
) -> ControllerAction:
    """What the feed-forward does about all torques that it takes as measured.

    Parameters
    ----------
    sensor_signs : ndarray (k,)
        Torque that drives the rotor for a flange reading of 1 N·m.
    names : sequence of str
        Of the dynamometers, k.
    frequencies : ndarray (f,)
        Hz.
    """
    issued, state = feed_forward.motion(frequencies)
    rows = [feed_forward.outputs.index(f"{name} {what}") for what in ("torque", "speed") for name in names]
    sign = np.concatenate([sensor_signs, np.ones(len(names))])[:, None]
    expected = sign * (feed_forward.C[rows] @ state + feed_forward.D[rows])
    return ControllerAction(issued, expected)


class SampledLoop:
    """Rig and controller of a case at frequencies (f,) in Hz with the controller sampled; k dynamometers.

    Parameters
    ----------
    parts : Parts
        Its rig may be another than the one that the controller was tuned for.
    frequencies : ndarray (f,)
        Hz, above 0.
    dead_time : float, optional
        s; that of the case unless given.
    """

    def __init__(self, parts: Parts, frequencies: np.ndarray, dead_time: float | None = None):
        self.parts, self._s = parts, 2j * np.pi * np.asarray(frequencies, float)
        step, k = parts.case.loop["sample_time"], len(parts.dynamometers)
        delay = parts.case.loop.command_delay(dead_time)
        bed, law, z = parts.bed, parts.sampled_controller, np.exp(self._s * step)
        self._step, self._delay = step, delay
        self._states = transfer(bed.A, bed.B, np.eye(len(bed.A)), np.zeros_like(bed.B), self._s)  # (f, x, k + d)
        self._read = bed.C[: 2 * k]
        self.control = transfer(law.A, law.B, law.C, law.D, z)
        self.of_commands = self._read @ _sampled_states(bed.A, bed.B[:, :k], step, delay, z)
        self._held = self._hold(self._s)

    def _hold(self, s: np.ndarray) -> np.ndarray:
        """What a held and delayed command has of the issued one, (f, 1, 1), at s (f,)."""
        return (-np.expm1(-s * self._step) / (s * self._step) * np.exp(-s * self._delay))[:, None, None]

    def image(self, n: int) -> np.ndarray:
        """What the ``n``-th image of the held commands, at ω + 2πn/T, adds to the sampled readings, (f, 2k, k)."""
        s, bed, k = self._s + 2j * np.pi * n / self._step, self.parts.bed, len(self.parts.dynamometers)
        return transfer(bed.A, bed.B[:, :k], self._read, np.zeros((2 * k, k)), s) * self._hold(s)

    def response(
        self, inputs: Sequence[str], sensors: Sequence[str], action: ControllerAction | None = None
    ) -> np.ndarray:
        """Response (f, y, u) of the rig's sensors to torques on the rig or in the residual vehicle.

        Parameters
        ----------
        action : ControllerAction or None
            Of the feed-forward on these inputs (w = u); None where they are not measured.

        Raises
        ------
        InputError
            If a name is unknown.
        """
        parts, k = self.parts, len(self.parts.dynamometers)
        state = np.zeros((len(self._s), self._states.shape[1], len(inputs)), complex)
        law = np.zeros((len(self._s), k, len(inputs)), complex)
        for i, name in enumerate(inputs):
            if name in parts.drives:
                state[:, :, i] = self._states[:, :, k + parts.drives.index(name)]
            elif name in parts.simulated:  # inside the controller
                column = 2 * k + parts.simulated.index(name)
                law[:, :, i] = self.control[:, :, column] if action is None else 0
            else:
                raise unknown(name, [*parts.drives, *parts.simulated], "response")
        measured = self._read @ state
        if action is not None:
            law = law + action.commands
            measured = measured - action.expected
        feedback = self.control[:, :, : 2 * k]
        issued = np.linalg.solve(np.eye(k) - feedback @ self.of_commands, law + feedback @ measured)
        return self._outputs(state + self._states[:, :, :k] @ (self._held * issued), inputs, sensors)

    def _outputs(self, state: np.ndarray, inputs: Sequence[str], sensors: Sequence[str]) -> np.ndarray:
        """Readings (f, y, u) of the rig for states (f, x, u) of the bed."""
        rig, n, k = self.parts.rig.space, len(self.parts.rig.space.A), len(self.parts.dynamometers)
        rows = [rig.outputs.index(name) for name in sensors]
        columns = [rig.inputs.index(dynamometer.torque_input) for dynamometer in self.parts.dynamometers]
        values = rig.C[rows] @ state[:, :n] + rig.D[np.ix_(rows, columns)] @ state[:, n : n + k]
        for i, name in enumerate(inputs):
            if name in rig.inputs:
                values[:, :, i] += rig.D[rows, rig.inputs.index(name)]
        return values


def _sampled_states(A: np.ndarray, B: np.ndarray, step: float, delay: float, z: np.ndarray) -> np.ndarray:
    """Sampled states (f, x, k) for commands (k) that are held for a step (s) and act after a delay (s), exactly."""
    whole = int(np.floor(delay / step + 1e-9))
    late = max(delay - whole * step, 0.0)
    new, old = discretise(A, B, step - late), discretise(A, B, late)
    z, after = z[:, None, None], new.transition
    return np.linalg.solve(z * np.eye(len(A)) - after @ old.transition, (new.held + after @ old.held / z) * z**-whole)
