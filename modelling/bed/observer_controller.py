"""The control structure ``observer`` as it runs: estimate, command, prediction to the next sample."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from modelling.linear.state_space import StateSpace


@dataclass(frozen=True)
class ObserverController:
    """Observer with state feedback; x states, k commands, y sensors, w known torques.

    What the search tunes and the verification judges of this structure. What leaves the computer is a
    :class:`modelling.controller.law.ControlLaw`: one form for all structures, with the limits.

    At every sample the predicted state ξ is corrected by what the sensors read, the command follows, and the state is
    predicted to the next sample with the command as it was sent: ξ̂ = ξ + L·(y − C·ξ), u = −F·ξ̂ − G·w,
    ξ⁺ = A·ξ̂ + B·u + W·w. A command that was limited enters the prediction as limited, so nothing winds up.

    Attributes
    ----------
    A, B, W, C, L, F, G : ndarray
        (x, x), (x, k), (x, w), (y, x), (x, y), (k, x), (k, w).
    sensors, known, dynamometers : tuple of str
        Names of y, w and u: sensors of the rig; measured torques, those of the residual vehicle last.
    sample_time : float
        s. A command is issued at the sample whose readings it uses; the dead time is in A.
    observed : int
        The first states, which the sensors correct and commands reach; the others run on known torques alone.
    """

    A: np.ndarray
    B: np.ndarray
    W: np.ndarray
    C: np.ndarray
    L: np.ndarray
    F: np.ndarray
    G: np.ndarray
    sensors: tuple[str, ...]
    known: tuple[str, ...]
    dynamometers: tuple[str, ...]
    sample_time: float
    observed: int

    @cached_property
    def space(self) -> StateSpace:
        """The same as x⁺ = A·x + B·[y, w], u = C·x + D·[y, w], commands not limited."""
        keep = np.eye(len(self.A)) - self.L @ self.C
        closed = self.A - self.B @ self.F
        return StateSpace(
            closed @ keep,
            np.hstack([closed @ self.L, self.W - self.B @ self.G]),
            -self.F @ keep,
            np.hstack([-self.F @ self.L, -self.G]),
            (*self.sensors, *self.known),
            self.dynamometers,
        )

    @cached_property
    def feedback(self) -> StateSpace:
        """From sensors to commands alone: what decides on stability."""
        o, y, whole = self.observed, len(self.sensors), self.space
        return StateSpace(
            whole.A[:o, :o], whole.B[:o, :y], whole.C[:, :o], whole.D[:, :y], self.sensors, self.dynamometers
        )

    def correct(self, state: np.ndarray, readings: np.ndarray) -> np.ndarray:
        """The predicted state (x,) corrected by readings (y,)."""
        return state + self.L @ (readings - self.C @ state)

    def command(self, corrected: np.ndarray, known: np.ndarray) -> np.ndarray:
        """Commands (k,) for a corrected state (x,) and known torques (w,)."""
        return -self.F @ corrected - self.G @ known

    def predict(self, corrected: np.ndarray, sent: np.ndarray, known: np.ndarray) -> np.ndarray:
        """The state (x,) at the next sample after commands ``sent`` (k,)."""
        return self.A @ corrected + self.B @ sent + self.W @ known
