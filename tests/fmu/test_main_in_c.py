"""An engineer with the C sources and nothing else closes the loop: an empty folder, a main of 60 lines."""

import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy
from needs import compiles

from matching.match.case_file import load_case
from matching.match.exported import exported_controller
from modelling.bed.controllers import STRUCTURES
from modelling.controller.c_source import c_sources
from modelling.linear.state_space import state_space
from modelling.simulation.compiled import compiler

pytestmark = compiles
MAIN = Path(__file__).parents[2] / "examples" / "controller_in_c" / "main.c"
WARNINGS = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover"]
EMULATED, TIP_IN, RISE = 1000, 2200, 50  # samples


@pytest.fixture(scope="module")
def case(reference_case):
    case = load_case(reference_case)
    structure = STRUCTURES["model_based"]
    values = {name: quantity.start for name, quantity in structure.quantities.items()}
    return replace(case, loop=replace(case.loop, structure=structure, values={**values, **case.loop.values}))


@pytest.fixture(scope="module")
def controller(case):
    return exported_controller(case)


@pytest.fixture(scope="module")
def printed(controller, tmp_path_factory):
    """Rows of mode, fault, readings, known torque, commands, motor speed."""
    folder = tmp_path_factory.mktemp("empty")
    for name, text in c_sources(controller).items():
        (folder / name).write_text(text, encoding="utf-8")
    shutil.copy(MAIN, folder)
    subprocess.run([compiler(), *WARNINGS, "main.c", "controller.c", "-lm", "-o", "bed"], cwd=folder, check=True)
    ran = subprocess.run([folder / "bed"], capture_output=True, text=True, check=True)
    return np.array([line.split() for line in ran.stdout.splitlines()], float)


def test_its_commands_are_those_of_the_sampled_controller(controller, printed):
    running, y, k = controller.running(), len(controller.law.sensors), len(controller.law.dynamometers)
    known = np.zeros(len(controller.law.known))
    for n, row in enumerate(printed):
        known[controller.law.known.index("motor_torque")] = row[2 + y]
        answer = running.step(row[2 : 2 + y], known, 1 if n < EMULATED else 2, np.full(k, 30.0), n)
        np.testing.assert_allclose(row[3 + y : 3 + y + k], answer.commands, rtol=1e-9, atol=1e-9)
    assert set(printed[EMULATED:, 0]) == {2.0}
    assert set(printed[:, 1]) == {0.0}


def test_emulation_begins_without_a_bump(printed):
    commands = printed[:, -3:-1]
    assert np.abs(np.diff(commands[EMULATED - 2 : EMULATED + 3], axis=0)).max() < 0.5  # N·m


def test_the_bed_answers_the_tip_in_as_the_vehicle_does(case, printed):
    """Motor speed against the vehicle's equations from rest, both as deviations from before the tip-in."""
    time = np.arange(len(printed) - TIP_IN) * case.loop["sample_time"]
    torque = 20.0 * np.minimum(np.arange(len(time)) / RISE, 1.0)
    vehicle = state_space(case.vehicle)
    drive = np.zeros((len(time), len(vehicle.inputs)))
    drive[:, vehicle.inputs.index("motor_torque")] = torque
    system = scipy.signal.cont2discrete((vehicle.A, vehicle.B, vehicle.C, vehicle.D), time[1], "foh")
    wanted = scipy.signal.dlsim((*system[:4], time[1]), drive)[1][:, vehicle.outputs.index("motor_speed")]
    settled = np.polynomial.Polynomial.fit(np.arange(400), printed[TIP_IN - 400 : TIP_IN, -1], 1)
    found = printed[TIP_IN:, -1] - settled(400 + np.arange(len(time)))
    assert np.abs(found - wanted).max() < 0.05 * np.abs(wanted).max()
