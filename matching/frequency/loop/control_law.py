"""The sampled control law of a tuned case, of any structure, as it leaves the computer."""

from __future__ import annotations

import numpy as np

from matching.frequency.loop.parts import Parts
from modelling.bed.residual_vehicle import cut
from modelling.controller.law import ControlLaw, law_of_feed_forward, law_of_feedback, law_of_observer


def control_law(parts: Parts) -> ControlLaw:
    """The law of a tuned case; its readings are those of the rig's sensors, signs as the rig has them.

    Raises
    ------
    InputError
        If a model cannot be made linear or a design has no solution.
    """
    case, loop = parts.case, parts.case.loop
    reference = cut(case.emulated_vehicle, case.rig)
    k = len(loop.dynamometers)
    sensors = (
        *(dynamometer.torque_sensor for dynamometer in loop.dynamometers),
        *(dynamometer.speed_sensor for dynamometer in loop.dynamometers),
    )
    signs = np.concatenate([parts.toward, np.ones(k)])
    observer = loop.structure.observer(case.rig, reference, loop)
    if observer is not None:
        return law_of_observer(observer)
    feed_forward = loop.structure.feed_forward(case.rig, reference, loop)
    if feed_forward is not None:
        return law_of_feed_forward(feed_forward, parts.sampled_controller, signs, sensors)
    return law_of_feedback(parts.sampled_controller, signs, sensors, parts.simulated, loop["sample_time"])
