"""Systems and inputs that the tests of this folder share."""

from __future__ import annotations

import tomllib

import numpy as np

from modelling.model_file import from_dict
from modelling.system import System

TWO_MASS = """
[inertias.motor]
J = 0.09
drag = 0.02
[inertias.load]
J = 1.3
drag = 0.15
[shafts.link]
between = ["motor", "load"]
stiffness = 300
damping = 0.4
[inputs.motor_torque]
on = "motor"
[inputs.brake_torque]
on = "load"
[sensors.motor_speed]
measures = "speed"
of = "motor"
[sensors.load_speed]
measures = "speed"
of = "load"
[sensors.load_acceleration]
measures = "acceleration"
of = "load"
[sensors.link_torque]
measures = "torque"
of = "link"
"""

EFFECTS: dict[str, tuple] = {
    "backlash": ("shafts.link", {"gap": 0.02}),
    "hardening": ("shafts.link", {"cubic": 4e4}),
    "hysteresis": ("shafts.link", {"torque": 2.0, "angle": 0.01}),
    "slip": ("shafts.link", {"coefficient": 15.0}),
    "tyre_slip": ("shafts.link", {"slip_stiffness": 300.0, "peak": 8.0}),
    "compliance": ("shafts.link", {"stiffness": 900.0, "J": 0.02}),
    "coulomb_friction": ("inertias.load", {"torque": 1.2, "torque_reverse": 0.8}),
    "stribeck_friction": ("inertias.motor", {"torque": 0.5, "breakaway": 0.9, "speed": 0.8}),
    "quadratic_drag": ("inertias.load", {"coefficient": 0.02}),
    "imposed_motion": ("inertias.load", {}),  # the brake's input is the speed of the load then
    "brake": ("inputs.brake_torque", {"deflection": 0.05}),  # which is sometimes negative: then it drives
    "constant_torque": ("inertias.load", {"torque": 1.1}),
    "torque_ripple": ("inertias.motor", {"order": 3.0, "amplitude": 0.5, "phase": 0.3}),
    "dead_time": ("inputs.motor_torque", {"delay": 0.0047}),
    "lag": ("inputs.motor_torque", {"time_constant": 0.006}),
    "input_gain": ("inputs.motor_torque", {"factor": 1.08}),
    "sensor_offset": ("sensors.motor_speed", {"offset": 0.4}),
    "sensor_gain": ("sensors.link_torque", {"factor": 0.95}),
    "sensor_drift": ("sensors.link_torque", {"rate": 0.1}),
    "sensor_delay": ("sensors.load_speed", {"delay": 0.0033}),
    "all_pass": ("sensors.load_speed", {"delay": 0.0033}),
    "gain_drift": ("inputs.motor_torque", {"change": 0.3, "time_constant": 1.2}),
    "parameter_drift": ("shafts.link.stiffness", {"change": -0.3, "time_constant": 1.2}),
    "wrong_parameter": ("inertias.load.J", {"value": 1.5}),
    "input_offset": ("inputs.motor_torque", {"offset": 0.4}),
    "gear_loss": ("shafts.link", {"efficiency": 0.92, "efficiency_reverse": 0.85}),
    "position_torque": ("inertias.motor", {"period": 1.5, "amplitude": 0.5, "phase": 0.3, "amplitude_2": 0.2}),
    "geared_ripple": (["inertias.motor", "inertias.load"], {"order": 3.0, "amplitude": 0.5, "phase": 0.3}),
    "recording_friction": ("inertias.load", {"torque_1": 0.6, "torque_2": 1.4}),
    "clock_offset": ("sensors.load_speed", {"offset": 0.0033}),
    "load_friction": ("inertias.motor", {"coefficient": 0.06}),
}


def system_with(*kinds: str, **changes: dict[str, float]) -> System:
    """The two-mass drive with effects; ``changes`` replaces an effect's parameters by kind."""
    effects = [{"kind": kind, "at": EFFECTS[kind][0], **changes.get(kind, EFFECTS[kind][1])} for kind in kinds]
    return from_dict(tomllib.loads(TWO_MASS) | {"effects": effects}, "test")


def excitation(seconds: float = 4.0, rate: float = 1000.0) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Torques that reverse, slow and fast."""
    time = np.arange(round(seconds * rate) + 1) / rate
    motor = 5 * np.sin(2 * np.pi * 0.7 * time) + 2.5 * np.sin(2 * np.pi * 3.1 * time + 1)
    return time, {"motor_torque": motor, "brake_torque": 1.5 * np.sin(2 * np.pi * 0.4 * time + 2)}
