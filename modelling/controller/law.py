"""The sampled control law in one form for every structure, with what was really sent fed back to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_discrete_are

from modelling.bed.feed_forward import FeedForward
from modelling.bed.observer_controller import ObserverController
from modelling.linear.state_space import StateSpace


@dataclass(frozen=True)
class ControlLaw:
    """What a controller computes at every sample, in deviations from where it was switched on.

    The form in which a controller is exported and run on the bed, the same for feedback, feed-forward and observer
    (:func:`law_of_feedback`, :func:`law_of_feed_forward`, :func:`law_of_observer`), each of which is tuned in a form of
    its own.

    xc = x + L·(y − E·x), u = K·xc + Dy·y + Dw·w, x⁺ = A·xc + By·y + Bw·w + Bs·sent, where ``sent`` is u after the
    limits: a command that was cut is known to the law, so nothing winds up.

    Attributes
    ----------
    A, By, Bw, Bs : ndarray (x, x), (x, y), (x, w), (x, k)
    K, Dy, Dw : ndarray (k, x), (k, y), (k, w)
    L, E : ndarray (x, y), (y, x)
        Correction by, and expectation of, the readings.
    sensors, known, dynamometers : tuple of str
        Names of y (sensors of the rig), w (torques that are measured or demanded) and u (dynamometers).
    sample_time : float
        s.
    """

    A: np.ndarray
    By: np.ndarray
    Bw: np.ndarray
    Bs: np.ndarray
    K: np.ndarray
    Dy: np.ndarray
    Dw: np.ndarray
    L: np.ndarray
    E: np.ndarray
    sensors: tuple[str, ...]
    known: tuple[str, ...]
    dynamometers: tuple[str, ...]
    sample_time: float

    def step(
        self, state: np.ndarray, readings: np.ndarray, known: np.ndarray, limits: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Commands (k,), N·m, within ±``limits`` (k,), and the state (x,) of the next sample."""
        corrected = state + self.L @ (readings - self.E @ state)
        sent = np.clip(self.K @ corrected + self.Dy @ readings + self.Dw @ known, -limits, limits)
        return sent, self.A @ corrected + self.By @ readings + self.Bw @ known + self.Bs @ sent


def law_of_feedback(
    feedback: StateSpace, signs: np.ndarray, sensors: tuple[str, ...], known: tuple[str, ...], sample_time: float
) -> ControlLaw:
    """The law of a sampled feedback that knows no limits, made to follow what was sent.

    The difference between what was sent and what was asked for corrects the states as an observer would (Åström and
    Wittenmark, Computer-Controlled Systems, 1997, section 3.5); without a cut nothing changes.

    Parameters
    ----------
    feedback : StateSpace
        Inputs [flange torques (k), rotor speeds (k), known torques (w)], outputs commands (k).
    signs : ndarray (2k,)
        What a reading is multiplied by before it enters.
    sensors : tuple of str (2k)
    known : tuple of str (w)
    sample_time : float
        s.
    """
    count = len(signs)
    follow = _following(feedback.A, feedback.C)
    of_readings, of_known = feedback.B[:, :count] * signs, feedback.B[:, count:]
    direct, direct_known = feedback.D[:, :count] * signs, feedback.D[:, count:]
    x = len(feedback.A)
    return ControlLaw(
        feedback.A - follow @ feedback.C, of_readings - follow @ direct, of_known - follow @ direct_known, follow,
        feedback.C, direct, direct_known, np.zeros((x, count)), np.zeros((count, x)), sensors, known,
        feedback.outputs, sample_time,
    )  # fmt: skip


def _following(A: np.ndarray, C: np.ndarray) -> np.ndarray:
    """Gain (x, k) with which the states follow the commands that were sent; 0 where the commands do not show them."""
    try:
        P = solve_discrete_are(A.T, C.T, np.eye(len(A)), np.eye(len(C)))
    except (np.linalg.LinAlgError, ValueError):
        return np.zeros((len(A), len(C)))
    return A @ P @ C.T @ np.linalg.inv(C @ P @ C.T + np.eye(len(C)))


def law_of_feed_forward(
    feed_forward: FeedForward, feedback: StateSpace, signs: np.ndarray, sensors: tuple[str, ...]
) -> ControlLaw:
    """The law of a model-based feed-forward whose model's readings the feedback acts on the deviations from.

    States [model and last command, commands on their way (oldest first), feedback]. What the limits cut off reaches
    the model, which then expects what the bed does.

    Parameters
    ----------
    feed_forward, feedback : FeedForward, StateSpace
        As in :func:`law_of_feedback`; known torques are those of the feed-forward.
    signs : ndarray (y,)
        As in :func:`law_of_feedback`.
    sensors : tuple of str
        As in :func:`law_of_feedback`.
    """
    names, delay = feedback.outputs, feed_forward.delay
    k, n, w, y = len(names), len(feed_forward.A), len(feed_forward.measured), len(sensors)
    rows = [feed_forward.outputs.index(f"{name} {what}") for what in ("torque", "speed") for name in names]
    expected, through = feed_forward.C[rows], feed_forward.D[rows]
    fifo, size = k * delay, n + k * delay + len(feedback.A)
    model, of_feedback = slice(0, n), slice(n + fifo, size)
    B, D = feedback.B[:, :y] * signs, feedback.D[:, :y] * signs
    of_state, of_known = feed_forward.gains()
    K, Kw = np.zeros((k, size)), of_known - D @ through
    K[:, : n + fifo] = of_state
    K[:, model] -= D @ expected
    K[:, of_feedback] = feedback.C
    A, Bw, By, Bs = np.zeros((size, size)), np.zeros((size, w)), np.zeros((size, y)), np.zeros((size, k))
    A[model, model], Bw[model] = feed_forward.A, feed_forward.W
    A[of_feedback, of_feedback], A[of_feedback, model], By[of_feedback], Bw[of_feedback] = (
        feedback.A,
        -B @ expected,
        B,
        -B @ through,
    )
    # the command as the model takes it: the command sent, less the part of the feedback
    part_x, part_w = np.zeros((k, size)), D @ through
    part_x[:, of_feedback], part_x[:, model] = -feedback.C, D @ expected
    if delay:
        A[model, n : n + k] = feed_forward.B
        A[n : n + fifo - k, n + k : n + fifo] = np.eye(fifo - k)
        newest = slice(n + fifo - k, n + fifo)
        A[newest], By[newest], Bw[newest], Bs[newest] = part_x, -D, part_w, np.eye(k)
    else:
        A[model] += feed_forward.B @ part_x
        By[model], Bs[model] = -feed_forward.B @ D, feed_forward.B
        Bw[model] = Bw[model] + feed_forward.B @ part_w
    E = np.zeros((y, size))
    E[:, model] = expected
    return ControlLaw(
        A, By, Bw, Bs, K, D, Kw, np.zeros((size, y)), E, sensors, feed_forward.measured, names,
        feed_forward.sample_time,
    )  # fmt: skip


def law_of_observer(controller: ObserverController) -> ControlLaw:
    """The law of an observer with state feedback, which predicts with what was sent as it is."""
    k, y, x = len(controller.dynamometers), len(controller.sensors), len(controller.A)
    return ControlLaw(
        controller.A, np.zeros((x, y)), controller.W, controller.B, -controller.F, np.zeros((k, y)), -controller.G,
        controller.L, controller.C, controller.sensors, controller.known, controller.dynamometers,
        controller.sample_time,
    )  # fmt: skip
