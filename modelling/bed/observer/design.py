"""Design of the observer-based controller: Kalman filter, prediction across the dead time, optimal state feedback.

The model is that of :mod:`modelling.bed.bed_model`, with a torque that wanders (a random walk) at every input of the
rig and at every dynamometer's rotor: unmeasured torques are estimated from their effect. What a dynamometer gives
wrong (gain, lag, dead time) swings with the emulated modes, so at every rotor a torque that swings with them is
estimated as well, and predicted in phase across the dead time (internal model principle: Francis and Wonham,
Automatica 12 (1976) 457). Noise in the cut shafts says that their torque is not the model's. The filter corrects rig,
lags and these torques; the residual vehicle, whose rigid motion is not observable from the rig, is corrected by its
covariance with their errors. Commands on their way are known, so the prediction across the dead time is exact
(Kwakernaak and Sivan, Linear Optimal Control Systems, 1972). Such a loop has no margin of its own accord (Doyle, IEEE
Trans. Autom. Control 23 (1978) 756): its weights are what a search over drawn beds has to set.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from modelling.bed.feed_forward import FeedForward
from modelling.bed.observer.filter import filter_of, summed
from modelling.bed.observer.model import FORGETTING_PER_SAMPLE, ObserverModel
from modelling.bed.observer_controller import ObserverController
from modelling.bed.riccati import riccati

FREE_COMMAND_WEIGHT = 1e-12  # (rad/s per N·m)², of commands that known torques ask for: practically free
# A known torque is a sample of a continuous one. Over the sample that begins it counts with its value half a sample on,
# by the line through it and the last one, 1.5·w − 0.5·w(last): held as it is, it would come half a sample late.
NOW = 1.5
STATE_WEIGHT = 1e-14  # on every state, so that the Riccati equation sees also what the speed error does not show


def design(model: ObserverModel, weights: Mapping[str, float], ahead: Ahead | None = None) -> ObserverController:
    """The controller for a model and weights, see :data:`modelling.bed.structures.observer.QUANTITIES`.

    A model runs ahead on the known torques alone, with commands that are nearly free; the observer estimates what bed
    and vehicle really do, and its feedback, whose commands have the weights given, acts on the difference. So known
    torques do not depend on how hard the feedback may work. States [observer; model that runs ahead].

    Parameters
    ----------
    ahead : Ahead, optional
        The model that runs ahead, if it is there already: it does not depend on the weights.

    Raises
    ------
    InputError
        If a Riccati equation has no stabilising solution.
    """
    ahead = runs_ahead(model) if ahead is None else ahead
    F = state_feedback(model, weights["command_weight"], weights["command_change_weight"])
    return assembled(model, ahead, F, filter_of(model, weights).correction)


def assembled(model: ObserverModel, ahead: Ahead, F: np.ndarray, corrected: np.ndarray) -> ObserverController:
    """The controller of a model that runs ahead, a state feedback F (k, …) and a correction (n + e + v, y)."""
    A, B, W = _shifting(model)
    size, y, more = len(A), len(model.readings.rows), len(ahead.A)
    m = size - model.estimated
    L, C = np.vstack([laid_out(model, corrected), np.zeros((more, y))]), np.zeros((y, size + more))
    C[:, : model.states] = model.readings.rows
    whole = block_diag(A, ahead.A)
    whole[:size, size + m :] = (1 - NOW) * W
    difference = ahead.F.copy()
    difference[:, :m] -= F[:, :m]
    return ObserverController(
        whole, np.vstack([B, np.zeros((more, B.shape[1]))]), np.vstack([NOW * W, ahead.W]), C, L,
        np.hstack([F[:, :size], difference]), ahead.G,
        model.readings.sensors, model.known, model.dynamometers, model.sample_time, size,
    )  # fmt: skip


def laid_out(model: ObserverModel, corrected: np.ndarray) -> np.ndarray:
    """A correction (n + e + v, y) by state of the observer (o, y): [rig, lags, vehicle; commands; torques]."""
    n, e = model.states, model.estimated
    commands = np.zeros((len(model.dynamometers) * (model.bed.delay + 1), corrected.shape[1]))
    return np.vstack([corrected[:n], corrected[n + e :], commands, corrected[n : n + e]])


@dataclass(frozen=True)
class Ahead:
    """The model that runs ahead on known torques: ξ⁺ = A·ξ + W·w, u = −F·ξ − G·w.

    Attributes
    ----------
    A, W, F, G : ndarray (m, m), (m, w), (k, m), (k, w)
        States [x; commands on their way, newest first; known torques of the last sample].
    """

    A: np.ndarray
    W: np.ndarray
    F: np.ndarray
    G: np.ndarray


def runs_ahead(model: ObserverModel) -> Ahead:
    """The model that runs ahead."""
    m, w = len(model.bed.whole) + len(model.dynamometers) * (model.bed.delay + 1), len(model.known)
    gains = state_feedback(model, FREE_COMMAND_WEIGHT, 0.0)
    A, B, W = (part[:m] for part in _shifting(model))
    F, G = gains[:, :m], gains[:, m + model.estimated :]
    W = W - B @ G
    return Ahead(
        np.block([[A[:, :m] - B @ F, (1 - NOW) * W], [np.zeros((w, m + w))]]),
        np.vstack([NOW * W, np.eye(w)]),
        np.hstack([F, (1 - NOW) * G]),
        NOW * G,
    )


def regulator(model: ObserverModel, command_weight: float = FREE_COMMAND_WEIGHT, change: float = 0.0) -> FeedForward:
    """What the controller makes of bed and residual vehicle when it knows all: state [x; commands of the last step].

    Raises
    ------
    InputError
        If the design's Riccati equation has no stabilising solution.
    """
    feedback = feedback_on_all(model, command_weight, change).F
    A, B = _arriving(model)
    bed, k, w = model.bed, len(model.dynamometers), len(model.known)
    W = np.vstack([bed.torques[:, model.estimated :], np.zeros((k, w))])
    C = np.zeros((len(model.readings.rows), len(A)))
    C[:, : model.states] = model.readings.rows
    D = np.zeros((len(C), w))
    return FeedForward(
        A, B, W, C, D, feedback, np.zeros((k, w)), bed.delay, model.sample_time, model.known, model.readings.sensors
    )  # fmt: skip


def _arriving(model: ObserverModel) -> tuple[np.ndarray, np.ndarray]:
    """A, B of [x; commands of the last step] for commands as they arrive."""
    bed, k = model.bed, len(model.dynamometers)
    A = np.vstack([np.hstack([bed.whole, bed.old]), np.zeros((k, len(bed.whole) + k))])
    return A, np.vstack([bed.new, np.eye(k)])


def _shifting(model: ObserverModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, B, W of [x; commands on their way, newest first; estimated torques] for commands as they are issued."""
    bed, k, e = model.bed, len(model.dynamometers), model.estimated
    x, fifo = len(bed.whole), k * (bed.delay + 1)
    A, B = np.zeros((x + fifo + e,) * 2), np.zeros((x + fifo + e, k))
    A[:x, :x] = bed.whole
    if bed.delay:
        A[:x, x + fifo - 2 * k : x + fifo - k] = bed.new
    else:
        B[:x] = bed.new
    A[:x, x + fifo - k : x + fifo] = bed.old
    A[:x, x + fifo :] = bed.torques[:, :e]
    A[x + k : x + fifo, x : x + fifo - k] = np.eye(fifo - k)
    B[x : x + k] = np.eye(k)
    A[x + fifo :, x + fifo :] = model.wandering
    W = np.vstack([bed.torques[:, e:], np.zeros((fifo + e, len(model.known)))])
    return A, B, W


@dataclass(frozen=True)
class Feedback:
    """What the state feedback's Riccati equation gives, on [x; commands of the last step].

    Attributes
    ----------
    F, of_torques : ndarray (k, x + k), (k, e + w)
        Gains, the latter on torques that go on as they do by themselves.
    B, X, weight, closed : ndarray (x + k, k), (x + k, x + k), (k, k), (x + k, x + k)
        Of the commands, the equation's solution, BᵀXB + R, and A − B·F.
    push, gradient, on : ndarray (x + k, e + w), (x + k, e + w), (e + w, e + w)
        What torques do, what they add to the cost's gradient, and how they go on.
    """

    F: np.ndarray
    of_torques: np.ndarray
    B: np.ndarray
    X: np.ndarray
    weight: np.ndarray
    closed: np.ndarray
    push: np.ndarray
    gradient: np.ndarray
    on: np.ndarray


def feedback_on_all(model: ObserverModel, command_weight: float, change: float) -> Feedback:
    """Gains on all that is known when the commands arrive.

    Minimises the squared speed errors at the cuts, the squared commands and their squared changes. Torques stay out
    of the Riccati equation: what they add to the cost's gradient solves a linear equation.

    Raises
    ------
    InputError
        If the design's Riccati equation has no stabilising solution.
    """
    A, B = _arriving(model)
    k, x = len(model.dynamometers), len(model.bed.whole)
    E = np.hstack([model.speed_error, np.zeros((k, k))])
    last = last_command(model)
    Q = E.T @ E + STATE_WEIGHT * np.eye(x + k) + change * last.T @ last
    R, S = (command_weight + change) * np.eye(k), -change * last.T
    X = riccati(A, B, Q, R, S, what="command that makes the rig follow the vehicle")
    weight = B.T @ X @ B + R
    F = np.linalg.solve(weight, B.T @ X @ A + S.T)
    on, closed = _torques_on(model), A - B @ F
    push = np.vstack([model.bed.torques, np.zeros((k, model.bed.torques.shape[1]))])
    gradient = summed(closed.T, on, closed.T @ X @ push)
    of_torques = np.linalg.solve(weight, B.T @ (X @ push + gradient @ on))
    return Feedback(F, of_torques, B, X, weight, closed, push, gradient, on)


def last_command(model: ObserverModel) -> np.ndarray:
    """The commands of the last step (k, x + k) by state [x; commands of the last step]."""
    k, x = len(model.dynamometers), len(model.bed.whole)
    return np.hstack([np.zeros((k, x)), np.eye(k)])


def _torques_on(model: ObserverModel) -> np.ndarray:
    """Estimated and known torques from sample to sample (e + w, e + w)."""
    return block_diag(model.wandering, (1 - FORGETTING_PER_SAMPLE) * np.eye(len(model.known)))


def state_feedback(model: ObserverModel, command_weight: float, change: float) -> np.ndarray:
    """Gains (k, x + fifo + e + w) on what is known now, the state predicted across the dead time.

    Raises
    ------
    InputError
        If the design's Riccati equation has no stabilising solution.
    """
    made = feedback_on_all(model, command_weight, change)
    return predicted(model, made.F, made.of_torques)


def predicted(model: ObserverModel, feedback: np.ndarray, of_torques: np.ndarray) -> np.ndarray:
    """Gains (…, k, x + fifo + e + w) on what is known now, of those on what is known when the commands arrive.

    ``feedback`` (…, k, x + k) is on [x; commands of the last step], ``of_torques`` (…, k, e + w), N·m per N·m, on the
    torques.
    """
    bed, k, x = model.bed, len(model.dynamometers), len(model.bed.whole)
    fifo, step, on = k * (bed.delay + 1), _torques_on(model), np.eye(bed.torques.shape[1])
    now = np.zeros((x, x + fifo + bed.torques.shape[1]))
    now[:, :x] = np.eye(x)
    for j in range(bed.delay):  # commands of delay − j and delay − j + 1 samples ago arrive
        ahead = bed.whole @ now
        newest = x + k * (bed.delay - j - 1)
        ahead[:, newest : newest + k] += bed.new
        ahead[:, newest + k : newest + 2 * k] += bed.old
        ahead[:, x + fifo :] += bed.torques @ on
        now, on = ahead, step @ on
    last = np.zeros((k, now.shape[1]))
    last[:, x : x + k] = np.eye(k)
    gains: np.ndarray = feedback @ np.vstack([now, last])
    gains[..., x + fifo :] += of_torques @ on
    return gains
