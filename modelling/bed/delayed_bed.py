"""The bed's model from sample to sample, with a dead time that need not be a multiple of the sample time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from modelling.bed.bed_model import BedModel

WHOLE_SAMPLE = 1e-9  # of a sample: dead times this little short of a whole number of samples count as whole


@dataclass(frozen=True)
class DelayedBed:
    """x(j + 1) = whole·x(j) + new·u(j − delay) + old·u(j − delay − 1) + torques·w(j), all held over a sample.

    Attributes
    ----------
    whole : ndarray (x, x)
        What a whole sample makes of the state without inputs.
    new, old : ndarray (x, k)
        Commands for the rest of a sample, and those before for its first part, while the newer ones are still delayed.
    torques : ndarray (x, w)
        Measured torques.
    delay : int
        Whole samples of dead time; the rest of it is shared between ``new`` and ``old``.
    """

    whole: np.ndarray
    new: np.ndarray
    old: np.ndarray
    torques: np.ndarray
    delay: int


def delayed_bed(A: np.ndarray, commands: np.ndarray, torques: np.ndarray, dead_time: float, step: float) -> DelayedBed:
    """Exact discretisation of ẋ = A·x + commands·u(t − dead_time) + torques·w over a step, both in s.

    A (x, x), commands (x, k), torques (x, w).
    """
    delay = int(np.floor(dead_time / step + WHOLE_SAMPLE))
    late = max(dead_time - delay * step, 0.0)  # s at the begin of each sample, in which the command before still acts
    k = commands.shape[1]
    before, early = held(A, np.hstack([commands, torques]), late)
    after, new = held(A, np.hstack([commands, torques]), step - late)
    return DelayedBed(after @ before, new[:, :k], after @ early[:, :k], after @ early[:, k:] + new[:, k:], delay)


def held(A: np.ndarray, B: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Exact discretisation (x, x), (x, u) over a step (s) with inputs held."""
    n, m = len(A), B.shape[1]
    block = expm(np.block([[A, B], [np.zeros((m, n + m))]]) * step)
    return block[:n, :n], block[:n, n:]


def of_model(model: BedModel, dead_time: float, step: float) -> DelayedBed:
    """The model of rig, lags and residual vehicle, sampled (s); inputs: the commands, then the measured torques."""
    k = len(model.speed_error)
    plant = model.space
    return delayed_bed(plant.A, plant.B[:, :k], plant.B[:, k:], dead_time, step)
