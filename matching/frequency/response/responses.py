"""The compared transfer functions of vehicle, rig without control and matched rig."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from matching.frequency.case.case import Case
from matching.frequency.loop.linear_body import Body, body
from matching.frequency.loop.parts import Parts, parts_of
from matching.frequency.response.sampled_data import SampledLoop, feed_forward_action
from modelling.bed.feed_forward import FeedForward
from modelling.bed.residual_vehicle import cut


@dataclass(frozen=True)
class Responses:
    """Responses (f, h) of the compared functions at frequencies (f,), Hz; SI unit of the sensor per N·m.

    Attributes
    ----------
    pairs : tuple of (str, str)
        Input and sensor of every function, h of them.
    vehicle : ndarray (f, h)
    rig : ndarray (f, h)
        The rig without control, dynamometers torqueless; NaN where a torque has no path, as one on a road has none.
    matched : ndarray (f, h)
        The tuned rig with its sampled controller: feed-forward where the torque is measured, else feedback alone.
    unmeasured : ndarray (f, h)
        The same by feedback alone.
    """

    frequencies: np.ndarray
    pairs: tuple[tuple[str, str], ...]
    vehicle: np.ndarray
    rig: np.ndarray
    matched: np.ndarray
    unmeasured: np.ndarray


class ComparedBed:
    """A tuned bed and the vehicle that it is compared with, at any frequencies.

    Parameters
    ----------
    case : Case
        Tuned.
    parts : Parts, optional
        The case's own, with the untuned rig for comparison; else the tuned one is that. Its rig may differ from the
        one in the case, which the controller was designed for.
    feed_forward : FeedForward, optional
        The case's own if given already.
    vehicle : Body, optional
        That of the case unless given.
    dead_time : float, optional
        s, of the bed; that of the case unless given.

    Raises
    ------
    InputError
        If a model cannot be made linear or the feed-forward has no solution.
    """

    def __init__(
        self,
        case: Case,
        parts: Parts | None = None,
        feed_forward: FeedForward | None = None,
        vehicle: Body | None = None,
        dead_time: float | None = None,
    ):
        self.parts = parts_of(case) if parts is None else parts
        self.vehicle = body(case.vehicle) if vehicle is None else vehicle
        self.case, self._feed_forward, self._dead_time = case, feed_forward, dead_time
        self.pairs = tuple((pair.input, pair.sensor) for pair in case.compared)
        self._inputs = list(dict.fromkeys(source for source, _ in self.pairs))
        self._sensors = list(dict.fromkeys(sensor for _, sensor in self.pairs))

    @cached_property
    def feed_forward(self) -> FeedForward | None:
        """That of the controller, None where its structure has none."""
        return feed_forward_of(self.case) if self._feed_forward is None else self._feed_forward

    @property
    def measured(self) -> np.ndarray:
        """Which of the compared functions (h,) begin at a torque that the feed-forward takes as measured."""
        return np.array([source in self.parts.measured for source, _ in self.pairs])

    def at(self, frequencies: np.ndarray) -> Responses:
        """Responses at frequencies (f,), Hz, above 0 and below half the loop's sampling frequency."""
        f = np.asarray(frequencies, float)
        rig, parts = self.parts.free, self.parts
        vehicle = self.of_vehicle(f)
        free = self._picked(_response(rig, f), rig.space.outputs, rig.space.inputs)
        loop = SampledLoop(parts, f, self._dead_time)
        unmeasured = self._picked(loop.response(self._inputs, self._sensors), self._sensors, self._inputs)
        matched = unmeasured
        if self.measured.any():
            assert self.feed_forward is not None, "what takes measured torques has a feed-forward"
            names = [dynamometer.name for dynamometer in parts.dynamometers]
            action = feed_forward_action(self.feed_forward, parts.toward, names, f)
            answered = loop.response(self.feed_forward.measured, self._sensors, action)
            picked = self._picked(answered, self._sensors, self.feed_forward.measured)
            matched = np.where(self.measured, picked, unmeasured)
        return Responses(f, self.pairs, vehicle, free, matched, unmeasured)

    def of_vehicle(self, frequencies: np.ndarray) -> np.ndarray:
        """Responses (f, h) of the vehicle."""
        return self._picked(_response(self.vehicle, frequencies), self.vehicle.space.outputs, self.vehicle.space.inputs)

    def _picked(self, values: np.ndarray, outputs: Sequence[str], inputs: Sequence[str]) -> np.ndarray:
        """The compared functions (f, h) of responses (f, y, u); NaN where there is no such input."""
        picked = np.full((len(values), len(self.pairs)), np.nan, complex)
        for h, (source, sensor) in enumerate(self.pairs):
            if source in inputs:
                picked[:, h] = values[:, outputs.index(sensor), inputs.index(source)]
        return picked


def feed_forward_of(case: Case) -> FeedForward | None:
    """The feed-forward of a case's control structure, None where it has none.

    Raises
    ------
    InputError
        If there is no stabilising solution.
    """
    return case.loop.structure.feed_forward(case.rig, cut(case.emulated_vehicle, case.rig), case.loop)


def _response(system: Body, frequencies: np.ndarray) -> np.ndarray:
    return system.response(2j * np.pi * frequencies)
