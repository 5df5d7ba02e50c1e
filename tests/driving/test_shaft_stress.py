"""Torques that the drives of a case put into a shaft by its drawing: the balance of the car, and the limits."""

import shutil
from dataclasses import replace
from math import pi

import numpy as np
import pytest
from structure.imports import ROOT

from matching.match.case_file import load_case
from matching.match.driving import DRIVING, driving, stresses_beyond

pytestmark = pytest.mark.long
DIAMETER, LENGTH = 0.04, 0.0996  # m: the stiffness of the example's flange, 2e5 N·m/rad, of steel
PER_TORQUE = 16 / (pi * DIAMETER**3)  # Pa/(N·m)
RATIO, BEFORE_GEAR, BEHIND_GEAR, BEYOND_CUT = 10.05, 0.0493 + 0.0099, 0.05, 0.69 + 0.456 + 90.1  # kg·m²
RISE, RADIUS = 100.0, 0.3  # N·m of the motor; m
DRAG, LINEAR_DRAG, ROLLING = 0.0053, 0.05, 29.0  # N·m·s²/rad², N·m·s/rad, N·m a side


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    folder = tmp_path_factory.mktemp("stress")
    for path in (ROOT / "examples" / "drive_away").glob("*.*"):
        shutil.copy(path, folder)
    rig = (folder / "rig.toml").read_text()
    for side in ("left", "right"):
        before = f'between = ["adapter_{side}", "rotor_{side}"]\nstiffness = 2.0e5\n'
        assert before in rig
        rig = rig.replace(
            before, f'between = ["adapter_{side}", "rotor_{side}"]\nlength = {LENGTH}\ndiameter = {DIAMETER}\n'
        )
    (folder / "rig.toml").write_text(rig)
    return load_case(folder / "case.toml")


@pytest.fixture(scope="module")
def drives(case):
    return driving(case, settings=replace(DRIVING, drawn=1)).drives


def test_the_torque_in_a_shaft_is_that_of_the_car(case, drives):
    """A second after a tip-in at 80 km/h: what accelerates the car behind the cut, and what its drag takes."""
    drive = next(one for one in drives if one.title == "tip-in at 80 km/h")
    speed = 80 / 3.6 / RADIUS
    per_side = BEYOND_CUT + (BEFORE_GEAR * RATIO**2 + BEHIND_GEAR) / 2
    steady = DRAG * speed**2 + LINEAR_DRAG * speed + ROLLING
    wanted = steady + RISE * RATIO / 2 * BEYOND_CUT / per_side
    time = np.arange(len(drive.torques["flange_left"])) * case.loop["sample_time"]
    settled = (time > 0.9) & (time < 1.5)
    for side in ("left", "right"):
        assert drive.torques[f"flange_{side}"][settled].mean() == pytest.approx(wanted, rel=0.02)
        assert drive.torques[f"flange_{side}"][0] == pytest.approx(steady, rel=0.1)


def test_a_stress_beyond_its_limit_is_said_with_the_drive_that_takes_most(case, drives):
    own = [one for one in drives if not one.title.startswith("drawn")]
    largest = {one.title: np.ptp(one.torques["flange_left"]) / 2 for one in own}
    worst = max(largest, key=largest.get)
    amplitude = PER_TORQUE * largest[worst]
    limit = "shafts.flange_left.shear_stress_amplitude"
    beyond = replace(case, limits={**case.limits, limit: 0.9 * amplitude})
    (said,) = stresses_beyond(beyond, drives)
    assert said.startswith(f"{worst}: the drive takes an amplitude of the shear stress in flange_left of ")
    assert f"of {amplitude / 1e6:.4g} MPa, {0.9 * amplitude / 1e6:.4g} MPa is the limit" in said
    assert not stresses_beyond(replace(case, limits={**case.limits, limit: 1.1 * amplitude}), drives)
    peak = PER_TORQUE * max(np.abs(one.torques["flange_right"]).max() for one in own)
    (said,) = stresses_beyond(
        replace(case, limits={**case.limits, "shafts.flange_right.shear_stress": 0.9 * peak}), drives
    )
    assert f"a shear stress in flange_right of {peak / 1e6:.4g} MPa" in said
