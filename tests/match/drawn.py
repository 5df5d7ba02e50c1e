"""Cases drawn at random: vehicle, rig, bed and what may move."""

import numpy as np

SHARED = """
[inertias.motor]
J = {motor}
drag = 0.01
[inertias.hub]
J = {hub}
[shafts.drive]
between = ["motor", "hub"]
ratio = {ratio}
stiffness = {drive}
damping = {drive_damping}
[inputs.motor_torque]
on = "motor"
[sensors.motor_speed]
measures = "speed"
of = "motor"
"""
VEHICLE_SIDE = """
[inertias.wheel{side}]
J = {wheel}
[shafts.side{side}]
between = ["hub", "wheel{side}"]
stiffness = {half}
damping = {half_damping}
[inertias.body{side}]
J = {body}
drag = {drag}
[shafts.tyre{side}]
between = ["wheel{side}", "body{side}"]
stiffness = {tyre}
damping = {tyre_damping}
[[effects]]
kind = "slip"
at = "shafts.tyre{side}"
coefficient = {slip}
[sensors.side{side}_torque]
measures = "torque"
of = "side{side}"
"""
RIG_SIDE = """
[inertias.adapter{side}]
J = {adapter}
[inertias.rotor{side}]
J = {rotor}
drag = 0.05
[shafts.side{side}]
between = ["hub", "adapter{side}"]
stiffness = {half}
damping = {half_damping}
[shafts.flange{side}]
between = ["adapter{side}", "rotor{side}"]
stiffness = {flange}
damping = {flange_damping}
[inputs.dyno{side}]
on = "rotor{side}"
[sensors.side{side}_torque]
measures = "torque"
of = "side{side}"
[sensors.flange{side}_torque]
measures = "torque"
of = "flange{side}"
[sensors.rotor{side}_speed]
measures = "speed"
of = "rotor{side}"
"""
CASE = """
vehicle = "vehicle.toml"
rig = "rig.toml"
{dynamometers}
[loop]
structure = "{structure}"
{knows}
dead_time = {dead_time}
inverter_lag = {inverter}
torque_sensor_lag = 0.0005
sample_time = 0.0005
[[targets]]
mode = {mode}
[response]
band = [0.5, 25]
compare = [
    {{ input = "motor_torque", sensor = "motor_speed" }},
    {{ input = "motor_torque", sensor = "side{first}_torque" }},
]
[manoeuvre.motor_torque]
kind = "tip_in"
amplitude = {amplitude}
duration = 4
[limits]
modulus_margin = {margin}
dynamometer_torque = {torque}
[move]
"loop.proportional_gain" = {{ lower = 1, upper = 400 }}
"loop.integral_gain" = {{ lower = 1, upper = 1000 }}
"loop.torque_feed_forward" = {{ lower = 0, upper = 1.5 }}
"loop.acceleration_feed_forward" = {{ lower = 0, upper = 2 }}
"residual_vehicle.inertias.body{first}.J" = {{ lower = {body_low}, upper = {body_high} }}
"rig.inertias.adapter{first}.J" = {{ lower = 0.02, upper = 0.15 }}
"""
DYNAMOMETER = """
[dynamometers.dyno{side}]
torque_input = "dyno{side}"
torque_sensor = "flange{side}_torque"
speed_sensor = "rotor{side}_speed"
follows = "side{side}"
"""


def draw(seed, folder):
    """Write a case drawn from a seed: every inertia and stiffness within ±30 %, dead time 0.5 … 20 ms."""
    random = np.random.default_rng([20, seed])

    def about(value):
        return float(f"{value * random.uniform(0.7, 1.3):.6g}")

    sides = ["_left", "_right"] if seed % 4 == 0 else [""]
    share = 1 / len(sides)
    ratio = about(9.0)
    numbers = {
        "motor": about(0.04), "hub": about(0.06), "ratio": ratio, "drive": about(2.5e5), "drive_damping": about(20),
        "half": about(2.2e4 * share), "half_damping": about(16 * share), "wheel": about(1.6 * share),
        "body": about(150 * share), "drag": about(1.5 * share), "tyre": about(4e4 * share),
        "tyre_damping": about(80 * share), "slip": float(f"{10 ** random.uniform(3, 4.3) * share:.6g}"),
        "adapter": about(0.06), "rotor": about(0.7), "flange": about(2e5), "flange_damping": about(20),
    }  # fmt: skip
    vehicle, rig = SHARED.format(**numbers), SHARED.format(**numbers)
    for side in sides:
        vehicle += VEHICLE_SIDE.format(side=side, **numbers)
        rig += RIG_SIDE.format(side=side, **numbers)
    if len(sides) == 2:
        vehicle += '[mirror]\npairs = [["wheel_left", "wheel_right"], ["body_left", "body_right"]]\n'
        rig += '[mirror]\npairs = [["adapter_left", "adapter_right"], ["rotor_left", "rotor_right"]]\n'
    structure = "pi" if random.random() < 0.4 else "model_based"
    amplitude = about(60)
    wheel = amplitude * ratio * share
    case = CASE.format(
        dynamometers="".join(DYNAMOMETER.format(side=side) for side in sides),
        structure=structure,
        knows='knows = ["motor_torque"]' if structure == "model_based" else "",
        dead_time=float(f"{10 ** random.uniform(np.log10(0.0005), np.log10(0.02)):.4g}"),
        inverter=about(0.0015),
        mode=3 if len(sides) == 2 else 2,
        first=sides[0],
        amplitude=amplitude,
        margin=float(f"{random.uniform(0.4, 0.6):.3g}"),
        torque=float(f"{wheel * (0.7 if random.random() < 0.15 else 4):.4g}"),
        body_low=0.6 * numbers["body"],
        body_high=1.6 * numbers["body"],
    )
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in (("vehicle", vehicle), ("rig", rig), ("case", case)):
        (folder / f"{name}.toml").write_text(text)
    return folder / "case.toml"
