from dataclasses import replace
from pathlib import Path

import pytest

from matching.match.case_file import load_case
from modelling.bed.controllers import STRUCTURES

EXAMPLES = Path(__file__).parents[2] / "examples"
STABLE = {  # of the reference case, with a poor margin
    "proportional_gain": 100.0,
    "integral_gain": 50.0,
    "torque_feed_forward": 1.0,
    "acceleration_feed_forward": 0.8,
}

COMPACT = """
vehicle = "{folder}/vehicle.toml"
rig = "{folder}/rig.toml"
[dynamometers.left]
torque_input = "dyno_left"
torque_sensor = "flange_left_torque"
speed_sensor = "rotor_left_speed"
follows = "side_left"
[dynamometers.right]
torque_input = "dyno_right"
torque_sensor = "flange_right_torque"
speed_sensor = "rotor_right_speed"
follows = "side_right"
[loop]
structure = "model_based"
knows = ["motor_torque"]
proportional_gain = 30
integral_gain = 20
torque_feed_forward = 0.5
acceleration_feed_forward = 0.2
[[targets]]
mode = 2
[[targets]]
mode = 3
[response]
compare = [
    {{ input = "motor_torque", sensor = "motor_speed" }},
    {{ input = "motor_torque", sensor = "side_left_torque" }},
    {{ input = "road_torque", sensor = "side_right_torque" }},
]
[manoeuvre.motor_torque]
kind = "tip_in"
amplitude = 60
offset = 10
duration = 3
"""


@pytest.fixture(scope="session")
def reference():
    """The reference case, feedback stable; targets show in the feed-forward."""
    case = load_case(EXAMPLES / "road_to_rig" / "case.toml")
    return replace(case, loop=case.loop.with_values(STABLE))


@pytest.fixture(scope="session")
def feedback(reference):
    """The reference case with the structure pi."""
    return replace(reference, loop=replace(reference.loop, structure=STRUCTURES["pi"]))


@pytest.fixture(scope="session")
def compact(tmp_path_factory):
    """One residual vehicle with two interfaces, an open differential and slip."""
    path = tmp_path_factory.mktemp("compact") / "case.toml"
    path.write_text(COMPACT.format(folder=(EXAMPLES / "compact_bev").as_posix()))
    return load_case(path)


CHAIN = """
[inertias.motor]
J = 4.0
drag = 0.02
[shafts.side]
between = ["motor", "{end}"]
stiffness = 9000
damping = 6
{beyond}
[inputs.motor_torque]
on = "motor"
[sensors.motor_speed]
measures = "speed"
of = "motor"
[sensors.side_torque]
measures = "torque"
of = "side"
"""
WHEEL = """
[inertias.wheel]
J = 1.5
[inertias.body]
J = 160
drag = 2
[shafts.tyre]
between = ["wheel", "body"]
stiffness = 60000
damping = 300
[inputs.road]
on = "body"
"""
ROTOR = """
[inertias.adapter]
J = 0.1
[inertias.rotor]
J = 1.2
drag = 0.05
[shafts.flange]
between = [{flange}]
stiffness = 300000
damping = 30
[inputs.dyno]
on = "rotor"
[sensors.flange_torque]
measures = "torque"
of = "flange"
[sensors.rotor_speed]
measures = "speed"
of = "rotor"
"""
SINGLE = """
vehicle = "vehicle.toml"
rig = "rig.toml"
[dynamometers.one]
torque_input = "dyno"
torque_sensor = "flange_torque"
speed_sensor = "rotor_speed"
follows = "side"
[loop]
structure = "pi"
dead_time = 0.002
proportional_gain = 60
integral_gain = 50
torque_feed_forward = 0.4
[[targets]]
mode = 2
[response]
compare = [{ input = "motor_torque", sensor = "motor_speed" }, { input = "road", sensor = "side_torque" }]
[manoeuvre.motor_torque]
kind = "sweep"
amplitude = 30
duration = 3
"""


@pytest.fixture(scope="session")
def single(tmp_path_factory):
    """(flange ends) → a case with one dynamometer."""

    def build(*ends):
        folder = tmp_path_factory.mktemp("single")
        flange = ", ".join(f'"{end}"' for end in ends)
        (folder / "vehicle.toml").write_text(CHAIN.format(end="wheel", beyond=WHEEL))
        (folder / "rig.toml").write_text(CHAIN.format(end="adapter", beyond=ROTOR.format(flange=flange)))
        (folder / "case.toml").write_text(SINGLE)
        return load_case(folder / "case.toml")

    return build
