"""Random draws over every kind of effect, alone and in pairs, light and stiff, against an adaptive reference.

The reference is LSODA of SciPy with a tolerance of 1e-8: same equations, another integrator.
"""

import itertools
import tomllib

import numpy as np
import pytest

from modelling.effects import EFFECTS as KINDS
from modelling.equations.casadi_code import compiled
from modelling.equations.lagrange import FOLLOW_TIME, STICK_SPEED
from modelling.errors import InputError
from modelling.model_file import from_dict
from modelling.simulation.simulate import simulate
from tests.simulation.adaptive import simulate_adaptive
from tests.simulation.drives import EFFECTS, TWO_MASS

RANGE_SHARE = 1e-3  # largest error allowed, of a reading's range
SPREAD = 3.0  # parameters are drawn from a third of to three times the usual value
METHOD = "LSODA"  # changes between an explicit and an implicit method of up to order twelve and five
OUTLIERS = 0.02  # of the samples: those within a step in which a torque jumps lie on either side of the jump
BODIES = {"plain": {}, "light": {"motor": 0.05}, "stiff": {"stiffness": 30.0}}  # factors
PLACES = EFFECTS | {
    "quadratic_damping": ("shafts.link", {"coefficient": 0.05}),
    "relaxation": ("shafts.link", {"stiffness": 100.0, "time_constant": 0.02}),
    "double_relaxation": (
        "shafts.link",
        {"stiffness": 100.0, "time_constant": 0.02, "stiffness_2": 60.0, "time_constant_2": 0.3},
    ),
    "directional_stiffness": ("shafts.link", {"factor": 0.6}),
    "warming_friction": ("inertias.load", {"torque": 1.0, "change": 0.5, "time_constant": 0.05}),
    "saturation": ("inputs.motor_torque", {"limit": 5.0}),
    "rate_limit": ("inputs.motor_torque", {"rate": 300.0}),
    "falling_torque_constant": ("inputs.motor_torque", {"torque": 8.0}),
    "hum": ("sensors.motor_speed", {"amplitude": 0.2, "frequency": 50.0, "phase": 0.3}),
    "sensor_ripple": ("sensors.motor_speed", {"order": 3.0, "amplitude": 0.01, "phase": 0.3}),
    "gear_loss": ("shafts.link", {"efficiency": 0.3}),  # three times that is below 1
    "torque_map": (
        "inputs.motor_torque",
        {
            "speed_1": 0.0,
            "speed_2": 4.0,
            "pedal_1": 0.0,
            "pedal_2": 0.5,
            "pedal_3": 1.0,
            "torque_1_1": -1.0,
            "torque_1_2": 4.0,
            "torque_1_3": 9.0,
            "torque_2_1": -3.0,
            "torque_2_2": 1.0,
            "torque_2_3": 6.0,
        },
    ),
    "table": ("shafts.link", {"twist_1": -0.02, "torque_1": -1.0, "twist_2": 0.02, "torque_2": 1.0}),
}
TIME = np.arange(101) * 1e-3
PAIRS = list(zip(itertools.combinations(PLACES, 2), itertools.cycle(BODIES), strict=False))  # bodies in turn


def drawn(kinds, body, seed):
    """The two-mass drive with effects of drawn parameters, and drawn torques (t,) that reverse and jump."""
    generator = np.random.default_rng([seed, *map(ord, "".join(kinds) + body)])
    tables = tomllib.loads(TWO_MASS)
    tables["inertias"]["motor"]["J"] *= BODIES[body].get("motor", 1.0)
    tables["shafts"]["link"]["stiffness"] *= BODIES[body].get("stiffness", 1.0)
    tables["effects"] = [
        {"kind": kind, "at": PLACES[kind][0]}
        | {
            name: value if name.startswith(("speed_", "pedal_")) else value * SPREAD ** generator.uniform(-1, 1)
            for name, value in PLACES[kind][1].items()
        }
        for kind in kinds
    ]
    motor = 6 * np.sin(2 * np.pi * generator.uniform(3, 12) * TIME + generator.uniform(0, 6))
    motor += 3 * np.sign(np.sin(2 * np.pi * generator.uniform(5, 9) * TIME + 0.3))
    brake = 2 * np.sin(2 * np.pi * generator.uniform(2, 6) * TIME)
    brake = np.abs(brake) if "brake" in kinds else brake  # which is 0 or more
    motor = 0.5 + motor / 20 if "torque_map" in kinds else motor  # a pedal
    return from_dict(tables, "drawn"), {"motor_torque": motor, "brake_torque": brake}


FOLLOWS = 2e-6  # s: time constant of a limited rate that follows; it is off by 5e-5 of the range at most


def check(kinds, body, seed):
    """Whether the readings keep the tolerance; None where the two effects exclude each other."""
    try:
        system, inputs = drawn(kinds, body, seed)
        model = compiled(system)
    except InputError:
        return None
    start = {"speed(motor)": 3.0, "speed(load)": 3.0}
    got = simulate(model, TIME, inputs, start=start)
    fixed = {STICK_SPEED: got.stick_speed} if STICK_SPEED in model.parameters else {}
    fixed |= {FOLLOW_TIME: FOLLOWS} if FOLLOW_TIME in model.parameters else {}
    reference = simulate_adaptive(model, TIME, inputs, fixed, start, method=METHOD, tolerance=1e-8)
    jumps = "backlash" in kinds
    for name, reading in got.readings.items():
        size = max(np.ptp(reference[name]), np.finfo(float).tiny)  # a lash that never closes carries no torque
        error = np.abs(reading - reference[name]) / size
        if jumps and name in ("link_torque", "load_acceleration"):
            error = np.sort(error)[: -int(OUTLIERS * len(TIME)) - 1]
        assert error.max() < RANGE_SHARE, (kinds, body, seed, name, error.max())
    return got


def test_every_kind_takes_part():
    assert set(PLACES) | {"angle_zero"} == set(KINDS)  # which adds a constant to an angle, and nothing else


@pytest.mark.parametrize(
    ("kinds", "body"),
    [
        (("quadratic_damping", "lag"), "light"),
        (("hysteresis", "torque_ripple"), "stiff"),
        (("slip", "coulomb_friction"), "plain"),
        (("tyre_slip", "backlash"), "plain"),
        (("backlash", "dead_time"), "light"),
        (("imposed_motion", "hysteresis"), "light"),
        (("all_pass", "stribeck_friction"), "stiff"),
    ],
)
def test_drawn_pairs(kinds, body):
    assert check(kinds, body, 1) is not None


@pytest.mark.parametrize("kind", PLACES)
def test_every_kind_alone(kind):
    assert check((kind,), "plain", 0) is not None


@pytest.mark.long
@pytest.mark.parametrize(("kinds", "body"), PAIRS, ids=str)
def test_every_pair(kinds, body):
    if check(kinds, body, 0) is None:
        assert {PLACES[kind][0] for kind in kinds} == {"shafts.link"}  # only laws of one shaft exclude each other
