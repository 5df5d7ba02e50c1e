"""The controller of a match as it leaves the computer: law, limits, speed hold and watchdogs from the tuned case."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from matching.fmu.opened_shafts import opened_shaft_rule
from matching.frequency.case.case import Case
from matching.frequency.loop.control_law import control_law
from matching.frequency.loop.parts import Parts, parts_of
from modelling.controller.exported import ExportedController
from modelling.controller.law import ControlLaw
from modelling.controller.settings import NO_LIMIT, Settings
from modelling.controller.speed_hold import hold_gains
from modelling.linear.state_space import StateSpace

LOST_TORQUE = 0.2  # of the torque limit: what has to be on the flange before its loss counts
UNEXPECTED_TORQUE = 0.4  # of the torque limit: how far a flange torque may be from what the controller expects


def exported_controller(case: Case) -> ExportedController:
    """The controller of a tuned case.

    Raises
    ------
    InputError
        If a model cannot be made linear, a design has no solution or no speed hold is stable.
    """
    parts = parts_of(case)
    law = control_law(parts)
    dynamometers = case.loop.dynamometers
    torques = tuple(law.sensors.index(dynamometer.torque_sensor) for dynamometer in dynamometers)
    speeds = tuple(law.sensors.index(dynamometer.speed_sensor) for dynamometer in dynamometers)
    units = {sensor.name: sensor.unit for sensor in case.rig.sensors}
    settings = _settings(parts, law, torques)
    rule = opened_shaft_rule(case, law, float(settings.lost_torque.max()))
    return ExportedController(
        f"Controller: {case.title or case.path}",
        law,
        replace(settings, opened_torque=rule.least),
        tuple(units[name] for name in law.sensors),
        torques,
        speeds,
        rule.watched,
        rule.rows,
    )


def _settings(parts: Parts, law: ControlLaw, torques: tuple[int, ...]) -> Settings:
    case, loop, k = parts.case, parts.case.loop, len(parts.case.loop.dynamometers)
    torque = case.limits.get("dynamometer_torque", NO_LIMIT)
    speed = case.limits.get("dynamometer_speed", NO_LIMIT)
    bed = parts.bed
    speeds = StateSpace(
        bed.A, bed.B, bed.C[k : 2 * k], bed.D[k : 2 * k], bed.inputs, tuple(bed.outputs[k : 2 * k])
    )  # fmt: skip
    rotors = [
        next(part.on for part in case.rig.inputs if part.name == dynamometer.torque_input)
        for dynamometer in loop.dynamometers
    ]
    inertias = np.array([case.rig.parameters[f"inertias.{rotor}.J"].value for rotor in rotors])
    proportional, integral = hold_gains(speeds, inertias, loop["dead_time"], loop["inverter_lag"], loop["sample_time"])
    unexpected = np.full(len(law.sensors), NO_LIMIT)
    if torque < NO_LIMIT:
        # a controller without a model of the rig expects nothing
        expecting = [at for at in torques if law.E[at].any()]
        unexpected[expecting] = UNEXPECTED_TORQUE * torque
    lost = LOST_TORQUE * torque if torque < NO_LIMIT else NO_LIMIT
    return Settings(
        np.full(k, torque), np.full(k, speed), proportional, integral, np.full(k, lost),
        np.array([dynamometer.torque_gain for dynamometer in loop.dynamometers]), unexpected,
        np.full(k, case.limits.get("dynamometer_power", NO_LIMIT)), *_curve(case),
    )  # fmt: skip


def _curve(case: Case) -> tuple[np.ndarray, np.ndarray]:
    """Speeds (p,), rad/s, and largest torques (p,), N·m, of the case's curve; one point without any limit else."""
    curve = case.torque_curve
    if curve is None:
        return np.zeros(1), np.full(1, NO_LIMIT)
    return np.array(curve.speeds), np.array(curve.torques)
