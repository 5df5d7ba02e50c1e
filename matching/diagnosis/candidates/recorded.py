"""The range of a recording, from the data and the motion of a fitted model over them."""

from __future__ import annotations

import numpy as np

from matching.diagnosis.data.segments import FitData
from modelling.effects.first_guess import FittedMotion
from modelling.effects.recorded_range import RecordedRange
from modelling.model.system import System

TORQUE_MARGIN = 1.5  # times the largest torque on an inertia, as the base model has it


def recorded_range(system: System, data: FitData, motion: FittedMotion) -> RecordedRange:
    """What a recording has shown.

    The largest torque on an inertia is that of its shafts and of all inputs, which gears may have raised, or what
    accelerates it, whichever is larger.
    """
    readings = np.concatenate([segment.readings for segment in data.segments])
    measured = {
        sensor.name: values[np.isfinite(values)] for sensor, values in zip(system.sensors, readings.T, strict=True)
    }
    ratio = float(np.prod([max(gear.ratio.value, 1 / gear.ratio.value) for gear in system.gears], initial=1.0))
    inputs = ratio * sum(float(np.abs(torque).max()) for torque in motion.input.values())
    torque = {}
    for part in system.inertias:
        shafts = sum(float(np.abs(motion.torque[s.name]).max()) for s in system.shafts if part.name in s.between)
        J = motion.value[f"inertias.{part.name}.J"]
        accelerating = J * float(np.abs(motion.acceleration[part.name]).max())
        torque[part.name] = TORQUE_MARGIN * max(inputs + shafts, accelerating)
    return RecordedRange(
        max(float(np.ptp(segment.time)) for segment in data.segments),
        torque,
        {name: float(np.abs(values).max(initial=0.0)) for name, values in measured.items()},
        {name: float(np.ptp(values)) if len(values) else 0.0 for name, values in measured.items()},
        {
            name: sum(float(np.abs(np.diff(angle[p])).sum()) for p in motion.segments) / (2 * np.pi)
            for name, angle in motion.angle.items()
        },
        {
            name: max(float(np.ptp(angle[p])) for p in motion.segments) / (2 * np.pi)
            for name, angle in motion.angle.items()
        },
        sum(
            float(np.abs(motion.input[part.name]).max()) for part in system.inputs if part.name not in system.imposed_by
        ),
    )
