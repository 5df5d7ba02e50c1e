"""Runs on a bed: the identification recording under a slow speed hold, and the proof of the controlled bed."""

from __future__ import annotations

import numpy as np

from matching.commissioning.fmu_bed import FmuBed, FmuController, columns, held_as_linear
from matching.excitation.proof import Proof
from matching.excitation.result import ExcitationPlan
from matching.frequency.case.case import Case
from modelling.common.errors import InputError
from modelling.controller.law import ControlLaw
from modelling.controller.settings import EMULATION, FAULTS, SPEED_HOLD
from modelling.controller.supervised import SupervisedController
from modelling.measurement.write import csv_text

SETTLING_SECONDS = 2.0  # of speed hold before anything is recorded


def excited_recording(bed: FmuBed, case: Case, plan: ExcitationPlan) -> str:
    """Text of the CSV recording of a planned excitation on a bed."""
    step, k = case.loop["sample_time"], len(case.loop.dynamometers)
    speeds = [bed.sensors.index(dynamometer.speed_sensor) for dynamometer in case.loop.dynamometers]
    proportional, integral = (np.array([hold[i] for hold in plan.hold.values()]) for i in (0, 1))
    before = round(SETTLING_SECONDS / step)
    demands = np.vstack([np.zeros((before, len(plan.inputs))), plan.torques])
    bed.begin(plan.speed)
    sent, readings, total = np.zeros_like(demands), np.zeros((len(demands), len(bed.sensors))), np.zeros(k)
    for i, demand in enumerate(demands):
        readings[i] = bed.readings()
        error = plan.speed - readings[i, speeds]
        sent[i] = demand
        sent[i, :k] += proportional * error + total
        total += integral * step * error
        bed.step(sent[i], step)
    return _csv(case, bed, step, held_as_linear(sent)[before:], readings[before:], plan.inputs)


def proof_recording(  # bed and controller are both stepped: one more than six
    bed: FmuBed,
    case: Case,
    law: ControlLaw,
    controller: FmuController | SupervisedController,
    wanted: Proof,
    speed: float,
) -> str:
    """Text of the CSV recording of the controlled bed under a proof's torques, emulation on.

    Raises
    ------
    InputError
        If the controller's watchdogs end the emulation.
    """
    step = wanted.step
    k, before = len(law.dynamometers), round(SETTLING_SECONDS / step)
    drives = [
        name for name in bed.inputs if name not in {dynamometer.torque_input for dynamometer in case.loop.dynamometers}
    ]
    at = [bed.sensors.index(name) for name in law.sensors]
    torques = np.vstack([np.zeros((before, len(wanted.inputs))), wanted.torques])
    readings, hold = np.zeros((len(torques), len(bed.sensors))), np.full(k, speed)
    driven = [dynamometer.torque_input for dynamometer in case.loop.dynamometers]
    sent = np.zeros((len(torques), k))
    bed.begin(speed)
    # the bed holds a motor's torque over a sample; one of the road is only read by the controller, at the sample
    as_linear = np.where([name in drives for name in wanted.inputs], held_as_linear(torques), torques)
    for i, torque in enumerate(torques):
        now, meant = (dict(zip(wanted.inputs, values, strict=True)) for values in (torque, as_linear[i]))
        readings[i] = bed.readings()
        known = np.array([meant.get(name, 0.0) for name in law.known])
        answer = controller.step(readings[i, at], known, SPEED_HOLD if i < before // 2 else EMULATION, hold, i)
        if answer.fault:
            raise InputError(
                "bed", f"{(i - before) * step:.3f} s after the start the controller gave up: {FAULTS[answer.fault]}",
                "look at the recording, limits and watchdogs",
            )  # fmt: skip
        sent[i] = answer.commands
        bed.step(np.concatenate([sent[i], [now.get(name, 0.0) for name in drives]]), step)
    held = np.hstack([as_linear, held_as_linear(sent)])[before:]
    return _csv(case, bed, step, held, readings[before:], (*wanted.inputs, *driven))


def _csv(
    case: Case, bed: FmuBed, step: float, torques: np.ndarray, readings: np.ndarray, inputs: tuple[str, ...]
) -> str:
    units = {sensor.name: sensor.unit for sensor in case.rig.sensors} | dict.fromkeys(inputs, "N*m")
    return csv_text(
        np.arange(len(torques)) * step, {**columns(inputs, torques), **columns(bed.sensors, readings)}, units
    )
