"""Drives in which gearboxes shift: the case in another gear, and with live clutches."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from matching.match.case import Case, Drive
from matching.match.gearboxes import carried
from matching.match.requirements import requirements
from modelling.equations.casadi_code import compiled
from modelling.linear.steady_motion import operating_motion
from modelling.simulation.clutch_steps import most_steps
from modelling.simulation.simulate import simulate


@dataclass(frozen=True)
class ShiftSettings:
    """How drives that shift are stepped.

    Attributes
    ----------
    tolerance : float
        Of the vehicle's motion, a share of each reading's range, from which the steps follow: they need no more.
    margin : float
        Steps of vehicles and beds over those that the vehicle needs: drawn ones slip faster.
    """

    tolerance: float = 1e-2
    margin: float = 1.5


SHIFTS = ShiftSettings()


def in_gears(case: Case, gears: Mapping[str, int]) -> Case:
    """The case with gearboxes of vehicle and rig in other gears; its loop has the requirements of its own gear."""
    boxes = case.gearboxes
    if boxes is None or all(boxes.gears[name] == gear for name, gear in gears.items()):
        return case
    wanted = {**boxes.gears, **gears}
    vehicle, rig = (
        system.in_gear({box.name: wanted[box.name] for box in system.gearboxes if box.capacities})
        for system in boxes.as_in_files(case.vehicle, case.rig)
    )
    limits = {**case.limits, "margin_from": requirements(case).margin_from}
    return replace(case, vehicle=vehicle, rig=rig, targets=(), limits=limits)


def held_clutches(case: Case) -> dict[str, float | None]:
    """What clutches of a bed carry in the gear of its case, N·m by input; None where nothing says."""
    boxes = case.gearboxes
    if boxes is None:
        return {}
    held: dict[str, float | None] = dict.fromkeys(boxes.rig.capacities, 0.0)
    drives = [drive.torques for drive in (case.operating_range.drives if case.operating_range is not None else ())]
    for box in boxes.rig.gearboxes:
        for gear, name in enumerate(box.capacities, 1):
            if gear == boxes.gears[box.name]:
                stated = [torques[name].largest for torques in drives if name in torques]
                held[name] = boxes.closed.get(name) or max(stated, default=0.0) or None
    return held


def with_live_clutches(case: Case, drive: Drive, time: np.ndarray) -> tuple[Case, dict[str, np.ndarray], float]:
    """A case in time: gearboxes whose clutches the drive names are live in vehicle and rig.

    Parameters
    ----------
    case : Case
        At the operating point where the drive begins, in its gear.
    drive : Drive
    time : ndarray (t,)
        s, samples of the controller.

    Returns
    -------
    Case, dict of str to ndarray (t,), float
        The case, torques (N·m) by input less those of the operating point, and the steps a second that the clutches
        need.
    """
    boxes = case.gearboxes
    clutches = () if boxes is None else tuple(name for name in boxes.driven if name in drive.torques)
    torques = {name: one.torque(time) for name, one in drive.torques.items() if name not in clutches}
    if boxes is None or not clutches:
        return case, torques, 0.0
    torques |= {name: carried(drive.torques[name], time) for name in clutches}
    begun = {name: float(torques[name][0]) for name in clutches}
    vehicle, rig = case.vehicle.shifting(boxes.vehicle, begun), case.rig.shifting(boxes.rig, begun)
    point, model = operating_motion(vehicle), compiled(vehicle)
    held = dict(zip(model.inputs, point.inputs.tolist(), strict=True))
    torques |= {name: torques[name] - held[name] for name in clutches}
    live = replace(case, vehicle=vehicle, rig=rig)
    if set(clutches) <= {*boxes.emulated_clutches}:  # these need no further steps
        return live, torques, 0.0
    inputs = np.stack([held[name] + torques.get(name, np.zeros(len(time))) for name in model.inputs], axis=1)
    motion = simulate(model, time, inputs, start=point.state, tolerance=SHIFTS.tolerance)
    needed = most_steps(model, motion.states, inputs, case.loop["sample_time"])
    return live, torques, SHIFTS.margin * needed
