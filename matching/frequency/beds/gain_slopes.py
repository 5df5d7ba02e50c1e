"""Derivatives of an observer's gains with respect to the logarithms of its weights, exact; w weights.

A Riccati equation differentiated at its solution is a Lyapunov equation with the matrix of its closed loop (implicit
function theorem; Kao and Hennequin, arXiv:2011.11430): no further Riccati equation is solved.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from modelling.bed.observer.design import Feedback, last_command, predicted
from modelling.bed.observer.filter import TRUST, Filter, summed
from modelling.bed.observer.model import ObserverModel


def feedback_slopes(model: ObserverModel, made: Feedback, by_command: float, by_change: float) -> np.ndarray:
    """Of the state feedback's gains (2, k, x + fifo + e + w) by the weights on commands and on their changes.

    ``by_command``, ``by_change``: what a unit of each logarithm changes of the weight.
    """
    last, k = last_command(model), len(model.dynamometers)
    F, B, X, closed, on = made.F, made.B, made.X, made.closed, made.on
    # of Q, S and R together, seen along u = −F·x: a command costs FᵀF, its change (last + F)ᵀ(last + F)
    price = np.stack([by_command * F.T @ F, by_change * (last + F).T @ (last + F)])
    dX = summed(closed.T, closed, price)
    dR = np.array([by_command, by_change])[:, None, None] * np.eye(k)
    dS = np.stack([np.zeros_like(last), -by_change * last])
    dF = np.linalg.solve(made.weight, B.T @ dX @ closed + dS - dR @ F)
    bent = -np.swapaxes(B @ dF, 1, 2)  # of closedᵀ
    drive = bent @ (made.gradient @ on + X @ made.push) + closed.T @ dX @ made.push
    gradient = summed(closed.T, on, drive)
    of_torques = B.T @ (dX @ made.push + gradient @ on) - (B.T @ dX @ B + dR) @ made.of_torques
    return predicted(model, dF, np.linalg.solve(made.weight, of_torques))


def filter_slopes(
    model: ObserverModel, made: Filter, weights: Mapping[str, float], names: Sequence[str]
) -> np.ndarray:  # fmt: skip
    """Of the correction (w, n + e + v, y) by the logarithms of some of the filter's weights."""
    n, v, root = model.states, len(made.shared), model.sample_time
    decade = 2 * np.log(10)  # of a square by its root's decimal logarithm, over the square
    count, o, y = len(names), len(made.L), len(made.C)
    dQ, dR, across = np.zeros((count, o, o)), np.zeros((count, y, y)), np.zeros((count, v, n))
    for i, name in enumerate(names):
        square = decade * weights[name] ** 2
        dQ[i, n:, n:] = np.diag([square * root if drift == name else 0.0 for drift in model.drifts])
        if name in model.noises:
            columns = model.noises[name]
            dQ[i, :n, :n] = square / root * columns[:n] @ columns[:n].T
            across[i] = square / root * columns[n:] @ columns[:n].T
        trusts = np.array([TRUST[kind] == name for kind in model.readings.kinds])
        dR[i] = np.diag(np.where(trusts, square * model.readings.noise**2, 0.0))
    A, C, P, L, left = made.A, made.C, made.P, made.L, made.left
    on, gain = A @ left, A @ L
    dP = summed(on, on.T, dQ + gain @ dR @ gain.T)
    off = C @ dP @ C.T + dR
    dL = np.swapaxes(np.linalg.solve(made.innovation, C @ dP - off @ L.T), 1, 2)
    bent = -np.swapaxes(A @ dL @ C, 1, 2)  # of (A·left)ᵀ
    V = model.bed.whole[n:, n:]
    drive = made.from_rig @ (left @ dP - dL @ C @ P) @ A.T + V @ made.shared @ bent
    drive[:, :, :n] += across
    shared = summed(V, on.T, drive)
    of_vehicle = np.linalg.solve(made.innovation, C @ np.swapaxes(shared, 1, 2) - off @ made.of_vehicle.T)
    return np.concatenate([dL, np.swapaxes(of_vehicle, 1, 2)], axis=1)
