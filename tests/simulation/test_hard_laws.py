"""Lash, dry friction and hysteresis against hard laws with fine steps: 1 % of the signal range at the worst sample."""

import numpy as np
import pytest

from modelling.equations.casadi_code import compiled
from modelling.simulation.simulate import sensitivities, simulate, simulate_batch
from tests.simulation.drives import excitation, system_with
from tests.simulation.reference import Friction, two_mass

NONE = Friction()
CASES = {
    "lash": (("backlash",), {"backlash": {"gap": 0.04}}, {"gap": 0.04}),
    "wide lash": (("backlash",), {"backlash": {"gap": 0.3}}, {"gap": 0.3}),
    "coulomb at the load": (
        ("coulomb_friction",),
        {"coulomb_friction": {"torque": 2.0, "torque_reverse": 1.2}},
        {"friction": (NONE, Friction(2.0, 1.2))},
    ),
    "stribeck at the motor": (
        ("stribeck_friction",),
        {"stribeck_friction": {"torque": 1.0, "breakaway": 1.6, "speed": 0.7}},
        {"friction": (Friction(1.0, 1.0, 1.6, 0.7), NONE)},
    ),
    "both stick": (
        ("coulomb_friction", "stribeck_friction"),
        {
            "coulomb_friction": {"torque": 2.5},
            "stribeck_friction": {"torque": 1.5, "breakaway": 2.0, "speed": 0.5},
        },
        {"friction": (Friction(1.5, 1.5, 2.0, 0.5), Friction(2.5, 2.5))},
    ),
    "hysteresis": (("hysteresis",), {"hysteresis": {"torque": 2.0, "angle": 0.008}}, {"dahl": (2.0, 0.008)}),
    "lash and friction": (
        ("backlash", "coulomb_friction"),
        {"backlash": {"gap": 0.05}, "coulomb_friction": {"torque": 1.5}},
        {"gap": 0.05, "friction": (NONE, Friction(1.5, 1.5))},
    ),
}


def torques(seconds=2.0, dt=1e-3):
    time = np.arange(round(seconds / dt) + 1) * dt
    return time, 6 * np.sin(2 * np.pi * 0.8 * time), 1.0 * np.sin(2 * np.pi * 0.45 * time + 2)


@pytest.mark.parametrize("name", CASES)
def test_hard_laws_are_met(name):
    kinds, changes, hard = CASES[name]
    time, motor, brake = torques()
    got = simulate(system_with(*kinds, **changes), time, {"motor_torque": motor, "brake_torque": brake})
    expected = two_mass(time, motor, brake, **hard)
    plain = simulate(system_with(), time, {"motor_torque": motor, "brake_torque": brake})
    for sensor, reading in expected.items():
        error = np.abs(got[sensor] - reading).max() / np.ptp(reading)
        assert error < 0.01, f"{sensor}: {error:.2%}"
    # the law matters in this motion
    assert max(np.abs(plain[name] - reading).max() / np.ptp(reading) for name, reading in expected.items()) > 0.04


def test_coarse_recordings_of_a_lash_are_met_too():
    time, motor, brake = torques(dt=0.01)
    got = simulate(system_with("backlash", backlash={"gap": 0.3}), time, {"motor_torque": motor, "brake_torque": brake})
    for sensor, reading in two_mass(time, motor, brake, gap=0.3).items():
        assert np.abs(got[sensor] - reading).max() < 0.01 * np.ptp(reading), sensor


def test_the_friction_cases_do_stick():
    time, motor, brake = torques()
    stuck = two_mass(time, motor, brake, friction=CASES["both stick"][2]["friction"])
    both = (stuck["motor_speed"] == 0) & (stuck["load_speed"] == 0)
    assert both.mean() > 0.05


def test_the_derivative_by_the_gap_knows_that_the_instant_of_contact_moves():
    """The damping jumps at contact, so derivatives by a fixed step that ignored the instant would miss a fifth here."""
    model = compiled(system_with("backlash", backlash={"gap": 0.04}))
    time, inputs = excitation(1.0)
    gap = "shafts.link.backlash.gap"
    moved = np.stack([model.vector({gap: 0.04 + h}) for h in (1e-5, -1e-5)])
    readings = simulate_batch(model, time, inputs, moved, steps_per_second=64000.0)[:, :, :2]
    expected = (readings[0] - readings[1]) / 2e-5
    got = sensitivities(model, time, inputs, model.p0, [gap], steps_per_second=2000.0).jacobian[:, :2, 0]
    assert np.sqrt(np.mean((got - expected) ** 2)) < 0.03 * np.sqrt(np.mean(expected**2))
