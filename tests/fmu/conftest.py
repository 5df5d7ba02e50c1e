"""FMUs made once a session through the command line, and a hand on them through fmpy."""

from importlib.util import find_spec
from pathlib import Path

import pytest

from matching.cli import main

collect_ignore_glob = [] if find_spec("fmpy") else ["test_*.py"]  # the extra `fmu`

EXAMPLES = Path(__file__).parents[2] / "examples"
LASHED = """
title = "Two-mass drive with all that bends"
[inertias.motor]
J = 0.1
drag = 0.01
[inertias.load]
J = 1.0
[shafts.link]
between = ["motor", "load"]
stiffness = { value = 200, tolerance = 0.1 }
damping = 0.5
[inputs.motor_torque]
on = "motor"
[inputs.load_torque]
on = "load"
[sensors.motor_speed]
measures = "speed"
of = "motor"
[sensors.link_torque]
measures = "torque"
of = "link"
[sensors.load_acceleration]
measures = "acceleration"
of = "load"
[[effects]]
kind = "backlash"
at = "shafts.link"
gap = 0.02
[[effects]]
kind = "coulomb_friction"
at = "inertias.load"
torque = 2.0
[[effects]]
kind = "hysteresis"
at = "shafts.link"
torque = 1.5
angle = 0.01
[[effects]]
kind = "lag"
at = "sensors.link_torque"
time_constant = 0.002
[[effects]]
kind = "sensor_drift"
at = "sensors.motor_speed"
rate = 0.01
"""

DELAYED = """
[[effects]]
kind = "dead_time"
at = "inputs.motor_torque"
delay = 0.0123
[[effects]]
kind = "sensor_delay"
at = "sensors.motor_speed"
delay = 0.0047
[[effects]]
kind = "sensor_delay"
at = "sensors.load_acceleration"
delay = 0.008
"""


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("fmu")


@pytest.fixture(scope="session")
def lashed_model(folder):
    path = folder / "lashed.toml"
    path.write_text(LASHED, encoding="utf-8")
    return path


@pytest.fixture(scope="session")
def delayed_model(folder):
    path = folder / "delayed.toml"
    path.write_text(LASHED + DELAYED, encoding="utf-8")
    return path


@pytest.fixture(scope="session")
def export(folder):
    """Export by the command line: (source, fmi) → path of the FMU; every pair once."""
    made = {}

    def run(source, fmi="2.0"):
        key = str(source), fmi
        if key not in made:
            target = folder / f"{len(made)}.fmu"
            assert main(["export", str(source), "--fmu", str(target), "--fmi", fmi]) == 0
            made[key] = target
        return made[key]

    return run


@pytest.fixture(scope="session")
def reference_case():
    return EXAMPLES / "road_to_rig" / "case.toml"
