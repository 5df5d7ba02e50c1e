"""The compared transfer functions of vehicle, free rig and matched rig, and how far apart they are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import cont2discrete

from matching.frequency.case.case import Case
from matching.frequency.loop.exact_loop import ExactLoop
from matching.frequency.loop.linear_body import Body, body, transfer
from matching.frequency.loop.parts import Parts, parts_of
from modelling.bed.feed_forward import FeedForward
from modelling.bed.residual_vehicle import cut


@dataclass(frozen=True)
class Responses:
    """Responses (f, h) of the compared functions at frequencies (f,), Hz; SI unit of the sensor per N·m.

    Attributes
    ----------
    vehicle : ndarray (f, h)
    reference : ndarray (f, h)
        What ``matched`` is to equal: the vehicle; for measured torques sampled and held as the feed-forward is.
    rig : ndarray (f, h)
        The free rig before tuning, dynamometers torqueless; NaN where a torque has no path, as one on a road has none.
    matched : ndarray (f, h)
        The tuned rig: feed-forward where the torque is measured, else the feedback loop.
    unmeasured : ndarray (f, h)
        The feedback loop alone.
    """

    frequencies: np.ndarray
    pairs: tuple[tuple[str, str], ...]
    vehicle: np.ndarray
    reference: np.ndarray
    rig: np.ndarray
    matched: np.ndarray
    unmeasured: np.ndarray


def responses(
    case: Case, frequencies: np.ndarray, parts: Parts | None = None, feed_forward: FeedForward | None = None
) -> Responses:
    """Responses of the compared functions.

    Parameters
    ----------
    case : Case
        Tuned.
    frequencies : ndarray (f,)
        Hz, above 0 and below half the loop's sampling frequency.
    parts : Parts, optional
        The case's own, with the untuned rig for comparison; else the tuned one is that.
    feed_forward : FeedForward, optional
        The case's own if given already.

    Raises
    ------
    InputError
        If a model cannot be made linear or the feed-forward has no solution.
    """
    parts = parts_of(case) if parts is None else parts
    f = np.asarray(frequencies, float)
    s = 2j * np.pi * f
    pairs = tuple((pair.input, pair.sensor) for pair in case.compared)
    inputs = list(dict.fromkeys(source for source, _ in pairs))
    sensors = list(dict.fromkeys(sensor for _, sensor in pairs))
    vehicle, rig = body(case.vehicle), parts.free

    def picked(
        values: np.ndarray, outputs: tuple[str, ...] | list[str], columns: tuple[str, ...] | list[str]
    ) -> np.ndarray:
        found = np.full((len(f), len(pairs)), np.nan, complex)
        for h, (source, sensor) in enumerate(pairs):
            if source in columns:
                found[:, h] = values[:, outputs.index(sensor), columns.index(source)]
        return found

    own = picked(vehicle.response(s), vehicle.space.outputs, vehicle.space.inputs)
    free = picked(rig.response(s), rig.space.outputs, rig.space.inputs)
    alone = picked(ExactLoop(parts).response(s, inputs, sensors), sensors, inputs)
    matched, reference = alone.copy(), own.copy()
    if parts.measured:
        if feed_forward is None:
            feed_forward = case.loop.structure.feed_forward(case.rig, cut(case.vehicle, case.rig), case.loop)
        assert feed_forward is not None, "what takes measured torques has a feed-forward"
        known = [source in parts.measured for source, _ in pairs]
        matched[:, known] = picked(feed_forward.response(f), feed_forward.outputs, feed_forward.measured)[:, known]
        held = picked(sampled(vehicle, feed_forward.sample_time, f), vehicle.space.outputs, vehicle.space.inputs)
        reference[:, known] = held[:, known]
    return Responses(f, pairs, own, reference, free, matched, alone)


def sampled(own: Body, step: float, frequencies: np.ndarray) -> np.ndarray:
    """Response (f, y, u) of a body whose inputs are held over a step (s) and whose outputs are sampled."""
    space = own.space
    A, B, C, D, _ = cont2discrete((space.A, space.B, space.C, space.D), step)
    return transfer(A, B, C, D, np.exp(2j * np.pi * frequencies * step))
