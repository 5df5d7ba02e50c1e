"""The vehicle of others beside the controllers of a case."""

from __future__ import annotations

import numpy as np

from matching.match.case import Case
from modelling.bed.foreign_vehicle import ForeignVehicleLaw, RunIn, VehicleTiming, run_in_gains
from modelling.controller.law import ExportedController
from modelling.running.controllers import ControllerRows, Schedule
from modelling.running.vehicles import TimedVehicle


def run_in_of(case: Case, timing: VehicleTiming | None = None) -> RunIn:
    """How the vehicle of a case, or another one with steps of its own, is brought to the rotors' speeds."""
    loop, residual = case.loop, case.residual_vehicle
    if timing is None:
        assert case.vehicle_in_the_loop is not None
        timing = case.vehicle_in_the_loop.timing(loop["sample_time"])
    cuts = [residual.cut_at(one.follows) for one in loop.dynamometers]
    parts = [residual.part_of(cut) for cut in cuts]
    shared = [sum(residual.part_of(other) is part for other in cuts) for part in parts]
    inertia = [part.parameters[f"inertias.{cut.vehicle_end}.J"].value for part, cut in zip(parts, cuts, strict=True)]
    whole = [
        sum(each.J.value for each in part.inertias) / number for part, number in zip(parts, shared, strict=True)
    ]  # fmt: skip
    return run_in_gains(np.array(inertia), np.array(whole), case.limits_of("torque"), timing, loop["sample_time"])


def controller_rows(case: Case, controller: ExportedController, schedule: Schedule, count: int) -> ControllerRows:
    """An exported controller on rows of beds; with a vehicle of others beside it where its law is made for one."""
    vehicle, law = case.vehicle_in_the_loop, controller.law
    if vehicle is None or not isinstance(law, ForeignVehicleLaw):
        return ControllerRows(controller, schedule, count)
    timed = TimedVehicle(vehicle.started(run_in_of(case), count), law.timing, law.sample_time)
    return ControllerRows(controller, schedule, count, timed)
