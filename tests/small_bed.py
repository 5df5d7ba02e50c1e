"""A small bed with one dynamometer: motor, side shaft, rotor; behind the cut a wheel and a body."""

from pathlib import Path

MOTOR = """[inertias.motor]
J = 0.5
drag = 0.01
"""
SENSORS = """[sensors.motor_speed]
measures = "speed"
of = "motor"
[sensors.side_torque]
measures = "torque"
of = "side"
"""
VEHICLE = f"""
{MOTOR}[inertias.wheel]
J = 1.0
[inertias.body]
J = 40
drag = 0.5
[shafts.side]
between = ["motor", "wheel"]
stiffness = 4000
damping = 2
[shafts.tyre]
between = ["wheel", "body"]
stiffness = 8000
damping = 30
[inputs.motor_torque]
on = "motor"
[inputs.road]
on = "body"
{SENSORS}"""
RIG = f"""
{MOTOR}[inertias.adapter]
J = 0.05
[inertias.rotor]
J = 0.9
drag = 0.1
[shafts.side]
between = ["motor", "adapter"]
stiffness = 4000
damping = 2
[shafts.flange]
between = ["adapter", "rotor"]
stiffness = 1e5
damping = 10
[inputs.motor_torque]
on = "motor"
[inputs.dyno]
on = "rotor"
{SENSORS}[sensors.flange_torque]
measures = "torque"
of = "flange"
[sensors.rotor_speed]
measures = "speed"
of = "rotor"
"""
AXLE = f"""
{MOTOR}[inertias.cage]
J = 0.3
[inertias.wheel_left]
J = 0.6
[inertias.wheel_right]
J = 0.6
[inertias.body_left]
J = 20
drag = 0.5
[inertias.body_right]
J = 20
drag = 0.5
[shafts.side]
between = ["motor", "cage"]
stiffness = 4000
damping = 2
[differentials.axle]
cage = "cage"
left = "wheel_left"
right = "wheel_right"
[shafts.tyre_left]
between = ["wheel_left", "body_left"]
stiffness = 5000
damping = 20
[shafts.tyre_right]
between = ["wheel_right", "body_right"]
stiffness = 5000
damping = 20
[inputs.motor_torque]
on = "motor"
[inputs.road]
on = "body_left"
{SENSORS}"""
CASE = """
vehicle = "vehicle.toml"
rig = "rig.toml"
[dynamometers.dyno]
torque_input = "dyno"
torque_sensor = "flange_torque"
speed_sensor = "rotor_speed"
follows = "side"
[loop]
structure = "observer"
knows = ["motor_torque"]
measures = ["motor_speed"]
dead_time = 0.0023
[[targets]]
mode = 2
[response]
compare = [
    { input = "motor_torque", sensor = "motor_speed" },
    { input = "motor_torque", sensor = "side_torque" },
    { input = "road", sensor = "side_torque" },
]
[manoeuvre.motor_torque]
kind = "tip_in"
amplitude = 50
duration = 2
[limits]
dynamometer_torque = 1500
"""


def write(folder: Path, case: str = CASE) -> Path:
    """Model files and a case file in a folder; the case file."""
    for name, text in (("vehicle.toml", VEHICLE), ("rig.toml", RIG), ("case.toml", case)):
        (folder / name).write_text(text, encoding="utf-8")
    return folder / "case.toml"


# What a feedback law may move, to be put behind CASE.
FEEDBACK_GAINS = """
[move]
"loop.proportional_gain" = { lower = 1, upper = 300 }
"loop.integral_gain" = { lower = 1, upper = 3000 }
"loop.torque_feed_forward" = { lower = 0, upper = 1.5 }
"loop.acceleration_feed_forward" = { lower = 0, upper = 1.2 }
"loop.lead_time" = { lower = 0, upper = 0.01 }
"""
