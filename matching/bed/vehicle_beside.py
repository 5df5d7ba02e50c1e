"""The vehicle of others on the bed: beside the bed's controller, and as what a recording is judged by, simulated."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from matching.match.case import Case, once_per_case
from matching.match.coupled import run_in_of
from matching.match.exported import exported_controller
from matching.match.imperfections import BedRun, Imperfection, bed_motions, known_at_operating_point, vehicle_motions
from matching.match.operating_range import RANGE, at_speed, rotor_speed
from modelling.bed.foreign_vehicle import ForeignVehicleLaw
from modelling.bed.stepped import Law
from modelling.errors import InputError, listed
from modelling.recordings.recording import Recording
from modelling.running.controllers import unsupervised
from modelling.running.vehicles import TimedVehicle

BEGIN = 0.1  # s at the begin of a recording whose mean says how fast the rotors turn: an encoder's counts average out


@once_per_case
def reached_by_torques(case: Case) -> tuple[Case, list[str]]:
    """The case with those compared functions whose torque acts on its vehicle, and what is said of the others.

    A vehicle of others has the rig's torques and those that the case connects to an input of its FMU. A pedal is no
    torque: a proof does not press it.

    Raises
    ------
    InputError
        If no compared torque acts on it.
    """
    case, said = _without_pedals(case)
    if case.vehicle_in_the_loop is None:
        return case, said
    has = {part.name for part in case.rig.inputs} | set(dict(case.vehicle_in_the_loop.inputs))
    kept = tuple(pair for pair in case.compared if pair.input in has)
    missing = listed(list(dict.fromkeys(pair.input for pair in case.compared if pair.input not in has)))
    if not kept:
        raise InputError(
            f"{case.path}: response.compare", f"the FMU of the vehicle has no input for {missing}",
            "compare a torque of the rig, or name the FMU's input in vehicle_in_the_loop.inputs",
        )  # fmt: skip
    if len(kept) == len(case.compared):
        return case, said
    more = f"the FMU of the vehicle has no input for {missing}: responses to this torque are not judged"
    return replace(case, compared=kept), [*said, more]


def _without_pedals(case: Case) -> tuple[Case, list[str]]:
    """The case without compared functions of pedals, and what is said of them.

    Raises
    ------
    InputError
        If none is left.
    """
    kept = tuple(pair for pair in case.compared if pair.input not in case.vehicle.pedals)
    if len(kept) == len(case.compared):
        return case, []
    pedals = listed(list(dict.fromkeys(pair.input for pair in case.compared if pair.input in case.vehicle.pedals)))
    if not kept:
        wrong = f"compares responses to {pedals} alone, a pedal, and on the bed torques are judged"
        raise InputError(f"{case.path}: response.compare", wrong, "compare a torque of the road or of the rig, too")
    said = f"{pedals} is a pedal, and on the bed torques are judged: responses to it are not"
    return replace(case, compared=kept), [said]


def turning_at(case: Case, speed: float) -> Case:
    """A case over a range of speeds about the motion in which its rotors turn at a speed, rad/s; at rest at 0."""
    about = case.operating_range
    assert about is not None
    moving = speed * about.highest / rotor_speed(at_speed(case, about.highest).rig, case.loop)
    return at_speed(case, moving if abs(moving) > RANGE.slowest else 0.0)


@contextmanager
def vehicle_beside(case: Case, law: Law, speed: float) -> Iterator[TimedVehicle | None]:
    """The FMU of a case beside one controller, brought to rotors that turn at a speed, rad/s; None without an FMU."""
    vehicle = case.vehicle_in_the_loop
    if vehicle is None or not isinstance(law, ForeignVehicleLaw):
        yield None
        return
    with vehicle.started(run_in_of(case), 1) as fmu:
        timed = TimedVehicle(fmu, law.timing, law.sample_time)
        timed.begin(np.full((len(law.over), 1), speed) / law.over[:, None])
        yield timed


@dataclass(frozen=True)
class InTime:
    """What answers to the torques of a recording; at its samples, less the begin.

    Attributes
    ----------
    vehicle, predicted : ndarray (t, y)
        The FMU with the specimen before it, and the bed as planned with the FMU beside its controller.
    commands : mapping of str to ndarray (t,)
        Of the bed as planned, N·m by input.
    """

    vehicle: np.ndarray
    predicted: np.ndarray
    commands: Mapping[str, np.ndarray]


def motions_in_time(case: Case, recording: Recording, sensors: Sequence[str]) -> InTime:
    """What vehicle and predicted bed answer to the torques of a recording, simulated.

    Both begin as the recording does, at the speed of its rotors, and get the torques that it holds.

    Parameters
    ----------
    recording : Recording
        Evenly sampled.
    sensors : sequence of str (y)

    Raises
    ------
    InputError
        If the recording lacks a rotor's speed, or the FMU fails.
    """
    controller, loop = exported_controller(case), case.loop
    own = turning_at(case, _begin_speed(case, recording))
    step, trim = loop["sample_time"], known_at_operating_point(own)
    grid = np.arange(int(np.ptp(recording.time) / step + 1e-9) + 1) * step
    named = [part.name for part in own.rig.inputs if part.name not in {one.torque_input for one in loop.dynamometers}]
    assert case.vehicle_in_the_loop is not None
    named += list(dict(case.vehicle_in_the_loop.inputs))
    began = recording.time - recording.time[0]
    torques: Mapping[str, np.ndarray] = {
        name: np.interp(grid, began, recording[name]) - trim.get(name, 0.0)
        for name in named if name in recording.channels
    }  # fmt: skip
    run = BedRun(Imperfection(""), torques, loop.measured)
    vehicle = vehicle_motions(own, [run], sensors)[0]
    planned = bed_motions(own, unsupervised(controller), [run], sensors)[0]
    if planned is None:
        raise InputError(
            recording.source, "would drive the bed as planned out of bounds with the FMU of the vehicle beside it",
            "look at the torques that it holds, and match the case again",
        )  # fmt: skip
    at, of_bed, sent = (
        np.stack([np.interp(began, grid, each) for each in one[: len(grid)].T], axis=1)
        for one in (vehicle, planned.readings, planned.commands)
    )
    return InTime(at, of_bed, {one.torque_input: sent[:, j] for j, one in enumerate(loop.dynamometers)})


def _begin_speed(case: Case, recording: Recording) -> float:
    """Mean speed of the rotors at the begin of a recording, rad/s."""
    found, early = [], recording.time <= recording.time[0] + BEGIN
    for one in case.loop.dynamometers:
        if one.speed_sensor not in recording.channels:
            raise InputError(
                recording.source, f"has no {one.speed_sensor!r}",
                "record the rotors' speeds: the vehicle's FMU begins at them",
            )  # fmt: skip
        found.append(float(recording[one.speed_sensor][early].mean()))
    return float(np.mean(found))
