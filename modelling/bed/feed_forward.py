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

    State ξ = [x; commands of the last step]: ξ⁺ = A·ξ + B·u(k − delay) + W·w, y = C·ξ + D·w.

    Attributes
    ----------
    A, B, W, C, D : ndarray
        (x, x), (x, u), (x, w), (y, x), (y, w).
    F : ndarray (u, x)
        u(k) = −F·ξ(k + delay), predicted.
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

    def response(self, frequencies: np.ndarray) -> np.ndarray:
        """Response (f, y, w) of the rig to the measured torques at frequencies (f,), Hz, sampled and held."""
        closed = self.A - self.B @ self.F
        response = np.empty((len(frequencies), len(self.C), self.W.shape[1]), complex)
        powers = [self.W]
        for _ in range(self.delay - 1):
            powers.append(self.A @ powers[-1])
        for k, frequency in enumerate(frequencies):
            z = np.exp(2j * np.pi * frequency * self.sample_time)
            # the prediction holds the torques of its moment: what it misses of those that came in since
            missed = sum(
                (power * (z**j - 1) for j, power in enumerate(reversed(powers[: self.delay]))), np.zeros_like(self.W)
            )
            drive = self.W + self.B @ (self.F @ missed) * z**-self.delay
            response[k] = self.C @ np.linalg.solve(z * np.eye(len(closed)) - closed, drive) + self.D
        return response
