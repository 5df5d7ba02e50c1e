"""Torque, power and torque over speed limit the commands, in Python and in C."""

from dataclasses import replace

import numpy as np
import pytest
from fmu.slave import slave
from needs import compiles

from matching.match.case_file import load_case
from matching.match.exported import exported_controller
from modelling.bed.controllers import STRUCTURES
from modelling.bed.vehicle import TorqueCurve
from modelling.fmu.export import controller_fmu

pytestmark = compiles
SPEED_HOLD, POWER = 1, 30e3
# speed (rad/s), largest torque (N·m): 1500 everywhere, 30 kW, 1400 to 20 rad/s and straight to 200 at 80 rad/s
LIMITS = {
    -90.0: 200.0,
    5.0: 1400.0,
    20.0: 1400.0,
    25.0: 1200.0 * 55 / 60 + 200.0,
    50.0: 600.0,
    70.0: 400.0,
    100.0: 200.0,
}


@pytest.fixture(scope="module")
def controller(reference_case):
    case = load_case(reference_case)
    structure = STRUCTURES["pi"]
    values = {name: quantity.start for name, quantity in structure.quantities.items()}
    case = replace(
        case, loop=replace(case.loop, structure=structure, values={**values, **case.loop.values}),
        limits={**case.limits, "dynamometer_torque": 1500.0, "dynamometer_speed": 120.0, "dynamometer_power": POWER},
        torque_curve=TorqueCurve((20.0, 80.0), (1400.0, 200.0)),
    )  # fmt: skip
    return exported_controller(case)


def inputs(controller, speed):
    """Readings with both rotors at a speed, and speeds to hold: that one, then one far above."""
    readings = np.zeros(len(controller.law.sensors))
    readings[list(controller.speed_readings)] = speed
    return readings, [np.full(len(controller.law.dynamometers), asked) for asked in (speed, 1e4)]


@pytest.mark.parametrize("speed", LIMITS)
def test_the_least_of_the_limits_holds(controller, speed):
    readings, hold = inputs(controller, speed)
    running, known = controller.running(), np.zeros(len(controller.law.known))
    answer = [running.step(readings, known, SPEED_HOLD, asked) for asked in hold][-1]
    np.testing.assert_allclose(answer.commands, min(LIMITS[speed], 1500.0, POWER / abs(speed)), rtol=1e-12)


def test_c_limits_alike(controller, tmp_path):
    path = tmp_path / "controller.fmu"
    path.write_bytes(controller_fmu(controller).content)
    law = controller.law
    with slave(path) as one:
        one.begin()
        for speed, largest in LIMITS.items():
            readings, hold = inputs(controller, speed)
            read = dict(zip(law.sensors, readings, strict=True))
            for mode, asked in ((0, hold[0]), (SPEED_HOLD, hold[0]), (SPEED_HOLD, hold[1])):
                held = {f"{name}.hold_speed": value for name, value in zip(law.dynamometers, asked, strict=True)}
                one.set(read | held | {"mode": float(mode)})
                one.step(law.sample_time)
            commands = np.array(one.get([f"{name}.command" for name in law.dynamometers]))
            np.testing.assert_allclose(commands, min(largest, 1500.0, POWER / abs(speed)), rtol=1e-12)
