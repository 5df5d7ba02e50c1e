"""The model-based feed-forward: a model of rig and vehicle that commands the dynamometers ahead of the dead time.

It runs in the controller on measured torques. :mod:`modelling.bed.feed_forward_design` makes it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

SHORTEST_MEMORY = 1e-6  # of z: what decays faster from sample to sample has no pole in s worth a number


@dataclass(frozen=True)
class FeedForward:
    """Rig, actuators and residual vehicle in discrete time, with the optimal feedback on the predicted state.

    State ξ: ξ⁺ = A·ξ + B·u(k − delay) + W·w, y = C·ξ + D·w. Torques vary linearly between samples: then ξ, which is
    [x; commands of the last step] less what the newest torques did, is exact (first-order hold).

    Attributes
    ----------
    A, B, W, C, D : ndarray
        (x, x), (x, u), (x, w), (y, x), (y, w).
    F, G : ndarray (u, x), (u, w)
        u(k) = −F·ξ(k + delay) − G·w(k), with ξ predicted.
    delay : int
        Whole samples of dead time; the rest of it is in A and B.
    sample_time : float
        s.
    measured, outputs : tuple of str
        Names of w and y: the rig's sensors, each dynamometer's lagged torque ``NAME torque`` and speed ``NAME speed``.
    """

    A: np.ndarray
    B: np.ndarray
    W: np.ndarray
    C: np.ndarray
    D: np.ndarray
    F: np.ndarray
    G: np.ndarray
    delay: int
    sample_time: float
    measured: tuple[str, ...]
    outputs: tuple[str, ...]

    @property
    def poles(self) -> np.ndarray:
        """Poles (x,) of the model's own loop, taken back to s, rad/s."""
        z = np.linalg.eigvals(self.A - self.B @ self.F)
        return np.log(z[np.abs(z) > SHORTEST_MEMORY]) / self.sample_time

    def predict(self, state: np.ndarray, commands: Sequence[np.ndarray], measured: np.ndarray) -> np.ndarray:
        """The state (x,) ``delay`` samples ahead, measured torques (w,) held.

        ``commands`` (delay of (u,)) are those still on their way, oldest first.
        """
        for command in commands:
            state = self.A @ state + self.B @ command + self.W @ measured
        return state

    def gains(self) -> tuple[np.ndarray, np.ndarray]:
        """Gains of the command on what is known now: (u, x + delay·u) on [state; commands on their way], (u, w).

        Commands on their way stand oldest first: the prediction across the dead time in one product.
        """
        powers = [np.eye(len(self.A))]
        for _ in range(self.delay):
            powers.append(self.A @ powers[-1])
        pending = [power @ self.B for power in reversed(powers[:-1])]
        held = sum((power @ self.W for power in powers[:-1]), np.zeros_like(self.W))
        return -self.F @ np.hstack([powers[-1], *pending]), -self.F @ held - self.G

    def command(self, state: np.ndarray, commands: Sequence[np.ndarray], measured: np.ndarray) -> np.ndarray:
        """The command (u,) to issue; arguments as for :meth:`predict`."""
        return -self.F @ self.predict(state, commands, measured) - self.G @ measured

    def motion(self, frequencies: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Commands as issued (f, u, w) and states (f, x, w) for measured torques of 1 N·m at frequencies (f,), Hz."""
        closed, z = self.A - self.B @ self.F, np.exp(2j * np.pi * np.asarray(frequencies, float) * self.sample_time)
        z = z[:, None, None]
        power, missed = self.W, np.zeros((len(z), *self.W.shape), complex)
        for j in range(self.delay - 1, -1, -1):  # the prediction holds the torques of its moment
            missed += power * (z**j - 1)
            power = self.A @ power
        torques = (self.F @ missed - self.G) * z**-self.delay
        states = np.linalg.solve(z * np.eye(len(closed)) - closed, self.W + self.B @ torques)
        return (torques - self.F @ states) * z**self.delay, states

    def response(self, frequencies: np.ndarray) -> np.ndarray:
        """Response (f, y, w) of the rig at the samples, to measured torques that vary linearly between them."""
        return self.C @ self.motion(frequencies)[1] + self.D
