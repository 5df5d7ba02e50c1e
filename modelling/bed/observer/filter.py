"""The Kalman filter of an observer: rig, lags, unmeasured torques, and what they say of the residual vehicle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from modelling.bed.observer.model import ObserverModel
from modelling.bed.riccati import riccati

STATE_NOISE = 1e-12  # variance on every state of the rig, so that none counts as known exactly
DOUBLINGS = 40  # of the time over which a sum runs: 2⁴⁰ samples are for ever
# The weight that states how far the sensors of each kind are trusted.
TRUST = {"torque": "torque_sensor_noise", "speed": "rotor_speed_noise", "further": "further_sensor_noise"}


@dataclass(frozen=True)
class Filter:
    """What the filter's Riccati equation gives; o = n + e states of rig, lags and estimated torques.

    Attributes
    ----------
    L, of_vehicle : ndarray (o, y), (v, y)
        Correction of these states and of the residual vehicle for a reading off by one.
    A, C, P, innovation : ndarray (o, o), (y, o), (o, o), (y, y)
        The model, the covariance before a reading, and that of what a reading is off.
    from_rig, shared : ndarray (v, o), (v, o)
        What the states do to the residual vehicle, and its covariance with them.
    """

    L: np.ndarray
    of_vehicle: np.ndarray
    A: np.ndarray
    C: np.ndarray
    P: np.ndarray
    innovation: np.ndarray
    from_rig: np.ndarray
    shared: np.ndarray

    @property
    def correction(self) -> np.ndarray:
        """Of rig and lags, estimated torques and residual vehicle (o + v, y) for a reading off by one."""
        return np.vstack([self.L, self.of_vehicle])

    @property
    def left(self) -> np.ndarray:
        """What a reading leaves (o, o) of the states' error."""
        return np.eye(len(self.L)) - self.L @ self.C


def filter_of(model: ObserverModel, weights: Mapping[str, float]) -> Filter:
    """The stationary Kalman filter of a model.

    Parameters
    ----------
    model : ObserverModel
    weights : mapping of str to float
        By the names that the model's ``drifts``, ``noises`` and :data:`TRUST` have, in the units of
        :data:`modelling.bed.structures.observer.QUANTITIES`.

    Raises
    ------
    InputError
        If the filter's Riccati equation has no stabilising solution.
    """
    bed, n, e, root = model.bed, model.states, model.estimated, np.sqrt(model.sample_time)
    push = bed.torques[:n, :e]
    A = np.block([[bed.whole[:n, :n], push], [np.zeros((e, n)), model.wandering]])
    C = np.hstack([model.readings.rows, np.zeros((len(model.readings.rows), e))])
    drift = np.array([weights[name] for name in model.drifts]) * root
    white = np.hstack([columns * (weights[name] / root) for name, columns in model.noises.items()])
    Q = np.zeros((n + e, n + e))
    Q[:n, :n] = white[:n] @ white[:n].T + STATE_NOISE * np.eye(n)
    Q[n:, n:] = np.diag(drift**2)
    R = np.diag((model.readings.noise * [weights[TRUST[kind]] for kind in model.readings.kinds]) ** 2)
    P = riccati(A.T, C.T, Q, R, what="estimate of the rig's state")
    innovation = C @ P @ C.T + R
    L = np.linalg.solve(innovation, C @ P).T
    left = np.eye(n + e) - L @ C
    # covariance of the residual vehicle with rig and torques: M = V·M·(A·left)ᵀ + drive
    from_rig = np.hstack([bed.whole[n:, :n], bed.torques[n:, :e]])
    M = from_rig @ left @ P @ A.T
    M[:, :n] += white[n:] @ white[:n].T
    M = summed(bed.whole[n:, n:], (A @ left).T, M)
    return Filter(L, np.linalg.solve(innovation, C @ M.T).T, A, C, P, innovation, from_rig, M)


def summed(left: np.ndarray, right: np.ndarray, drive: np.ndarray) -> np.ndarray:
    """The solution of M = left·M·right + drive (…, a, b), summed by doubling; left (a, a) or right has to decay."""
    M = drive
    for _ in range(DOUBLINGS):
        M, left, right = M + left @ M @ right, left @ left, right @ right
        if min(np.abs(left).max(), np.abs(right).max()) < 1e-20:
            break
    return M
