"""A controller as it runs in the simulation, from sample to sample: feedback law, feed-forward, observer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from matching.frequency.loop.parts import Parts
from modelling.bed.feed_forward import FeedForward
from modelling.bed.observer_controller import ObserverController

Running = FeedForward | ObserverController | None  # beside the feedback law, in its place, or nothing beside it


def running_controller(
    parts: Parts, running: Running, torques: Mapping[str, np.ndarray], count: int
) -> _Feedback | _Observer:  # fmt: skip
    """The controller at rest, ready for ``count`` samples under torques (t,) in N·m by input."""
    if isinstance(running, ObserverController):
        return _Observer(parts, running, torque_columns(torques, running.known, count))
    return _Feedback(parts, running, torques, count)


class _Feedback:
    """The feedback law as it runs, and beside it the feed-forward if there is one."""

    def __init__(
        self, parts: Parts, feed_forward: FeedForward | None, torques: Mapping[str, np.ndarray], count: int
    ) -> None:  # fmt: skip
        self._law = _Sampled(parts, parts.case.loop["sample_time"])
        self._count = 2 * len(parts.dynamometers)
        self._ahead = None if feed_forward is None else _RunningFeedForward(parts, feed_forward, count)
        self._roads = torque_columns(torques if feed_forward is None else {}, parts.simulated, count)
        if feed_forward is not None:
            measured = {name: torques[name] for name in parts.measured if name in torques}
            self._measured = torque_columns(measured, feed_forward.measured, count)

    def command(self, k: int, readings: np.ndarray) -> np.ndarray:
        """Commands (k,) of feed-forward and feedback together."""
        readings, ahead = readings[: self._count], np.zeros(self._count // 2)
        if self._ahead is not None:
            ahead, expected = self._ahead.command(k, self._measured[k])
            readings = readings - expected
        return ahead + self._law.command(np.concatenate([readings, self._roads[k]]))


class _Observer:
    """An observer with state feedback as it runs, its commands within the dynamometers' torque limit."""

    def __init__(self, parts: Parts, controller: ObserverController, known: np.ndarray):
        self._controller, self._known = controller, known
        self._state = np.zeros(len(controller.A))
        further = len(controller.sensors) - 2 * len(parts.toward)
        self._signs = np.concatenate([1 / parts.toward, np.ones(len(parts.toward) + further)])
        self._limit = parts.case.limits.get("dynamometer_torque", np.inf)

    def command(self, k: int, readings: np.ndarray) -> np.ndarray:
        """Commands (k,), N·m."""
        corrected = self._controller.correct(self._state, self._signs * readings)
        sent = np.clip(self._controller.command(corrected, self._known[k]), -self._limit, self._limit)
        self._state = self._controller.predict(corrected, sent, self._known[k])
        return sent


class _Sampled:
    """The feedback controller as it runs from sample to sample."""

    def __init__(self, parts: Parts, step: float):
        law = parts.sampled_controller
        self._A, self._B, self._C, self._D = law.A, law.B, law.C, law.D
        self._x = np.zeros(len(self._A))

    def command(self, readings: np.ndarray) -> np.ndarray:
        out = self._C @ self._x + self._D @ readings
        self._x = self._A @ self._x + self._B @ readings
        return out


class _RunningFeedForward:
    """The feed-forward as the controller runs it: predicts, commands, and states what the sensors should read."""

    def __init__(self, parts: Parts, feed_forward: FeedForward, count: int):
        names = [dyno.name for dyno in parts.dynamometers]
        rows = [feed_forward.outputs.index(f"{name} {what}") for what in ("torque", "speed") for name in names]
        sign = np.concatenate([parts.toward, np.ones(len(names))])
        self._C, self._D = sign[:, None] * feed_forward.C[rows], sign[:, None] * feed_forward.D[rows]
        self._model, self._state = feed_forward, np.zeros(len(feed_forward.A))
        self._gains = np.hstack(feed_forward.gains())
        self._sent = np.zeros((count + feed_forward.delay, len(names)))  # begins with a dead time of silence

    def command(self, k: int, measured: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        model = self._model
        expected = self._C @ self._state + self._D @ measured
        known = np.concatenate([self._state, self._sent[k : k + model.delay].ravel(), measured])
        self._sent[k + model.delay] = self._gains @ known
        self._state = model.A @ self._state + model.B @ self._sent[k] + model.W @ measured
        return self._sent[k + model.delay], expected


def torque_columns(torques: Mapping[str, np.ndarray], names: Sequence[str], count: int) -> np.ndarray:
    """Torques (t, u) in N·m in the order of ``names``; 0 where one is not given for the ``count`` samples."""
    columns = [np.asarray(torques.get(name, np.zeros(count)), float) for name in names]
    return np.stack(columns, axis=1) if columns else np.zeros((count, 0))
