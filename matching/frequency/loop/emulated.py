"""What the residual vehicle of a bed reads while the bed runs: the vehicle's own sensors on the emulated side.

The residual vehicle turns on the torque that the bed measures at each flange, lag included, and on the road torques of
the manoeuvre. In the structure ``pi`` that is the model in the loop, as tuned. A model-based feed-forward
keeps the vehicle's own values, so there, and on the rig without control whose residual vehicle has no effect, it is the
one cut out of the vehicle. Its sensors are compared with the vehicle's for R_RVM (Eq. 21).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from matching.frequency.loop.linear_body import body
from matching.frequency.loop.parts import Parts
from modelling.bed.residual_vehicle import cut
from modelling.linear.propagate import linear_motion
from modelling.model.system import System

PLACE = "residual_vehicle."


def emulated(
    parts: Parts, traces: Mapping[str, np.ndarray], torques: Mapping[str, np.ndarray], *, tuned: bool
) -> dict[str, np.ndarray]:
    """Readings (t,) of the residual vehicle by ``residual_vehicle.SENSOR``, SI.

    Parameters
    ----------
    traces : mapping
        Of a rig from rest at the loop's sample time, by name; the torque sensors of the dynamometers are used.
    torques : mapping
        Of the manoeuvre by input (t,), linear between samples; those that act inside the residual vehicle are used.
    tuned : bool
        Whether it has its tuned values or those of the vehicle.
    """
    loop = parts.case.loop
    bodies = (
        parts.residual
        if tuned
        else tuple(body(part) for part in cut(parts.case.emulated_vehicle, parts.case.rig).parts)
    )
    count = len(next(iter(traces.values())))
    step, rate = loop["sample_time"], np.array([[1 / loop["torque_sensor_lag"]]])
    measured = {
        cut.torque: sign * linear_motion(-rate, rate, traces[dyno.torque_sensor][:, None], step)[:, 0]
        for dyno, cut, sign in zip(parts.dynamometers, parts.cuts, parts.toward, strict=True)
    }
    outputs: dict[str, np.ndarray] = {}
    for part in bodies:
        space, nothing = part.space, np.zeros(count)
        drive = np.stack([measured.get(name, torques.get(name, nothing)) for name in space.inputs], axis=1)
        y = linear_motion(space.A, space.B, drive, step) @ space.C.T + drive @ space.D.T
        outputs |= {PLACE + name: y[:, i] for i, name in enumerate(space.outputs)}
    return outputs


def on_emulated_side(vehicle: System, parts: Parts) -> tuple[str, ...]:
    """Sensors of the vehicle that the residual vehicle has too, less those right at the cuts, which the rotors show."""
    ends = {cut.vehicle_end for cut in parts.cuts}
    there = {sensor.name for part in parts.residual for sensor in part.system.sensors if sensor.of not in ends}
    return tuple(sensor.name for sensor in vehicle.sensors if sensor.name in there)
