"""Frequency responses and operating points against closed forms and independent solutions."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from modelling.errors import InputError
from modelling.linear.linearise import linearise, operating_point
from modelling.linear.state_space import response
from modelling.modal.modes import damped_modes_of
from modelling.model_file import from_dict, load

EXAMPLES = Path(__file__).parents[2] / "examples"
JA, JB, K, D = 0.1, 0.7, 350.0, 0.4


def two_masses(*effects, drag=0.0, **more):
    return from_dict(
        {
            "inertias": {"a": {"J": JA}, "b": {"J": JB, "drag": drag}},
            "shafts": {"link": {"between": ["a", "b"], "stiffness": K, "damping": D}},
            "inputs": {"drive": {"on": "a"}, "load": {"on": "b"}},
            "sensors": {
                "angle": {"measures": "angle", "of": "b"},
                "speed": {"measures": "speed", "of": "b"},
                "acceleration": {"measures": "acceleration", "of": "a"},
                "torque": {"measures": "torque", "of": "link"},
            },
            "effects": list(effects),
        }
        | more
    )


def closed_form(f):
    """Responses of b's angle, speed, a's acceleration and the shaft torque to the drive torque."""
    s = 2j * np.pi * f
    link = K + D * s
    determinant = s**2 * (JA * JB * s**2 + (JA + JB) * link)
    angle_a, angle_b = (JB * s**2 + link) / determinant, link / determinant
    return {
        "angle": angle_b,
        "speed": s * angle_b,
        "acceleration": s**2 * angle_a,
        "torque": link * JB * s**2 / determinant,
    }


@pytest.mark.parametrize("f", [np.geomspace(0.1, 300, 400), np.geomspace(1e-6, 1e-2, 50)])
def test_closed_form_down_to_the_rigid_body_pole(f):
    found = response(two_masses(), f)
    for sensor, expected in closed_form(f).items():
        np.testing.assert_allclose(found[sensor, "drive"], expected, rtol=1e-8)


def test_delays_are_exact():
    f = np.geomspace(0.5, 80, 100)
    plain = response(two_masses(), f)
    late = two_masses(
        {"kind": "dead_time", "at": "inputs.drive", "delay": 0.003},
        {"kind": "sensor_delay", "at": "sensors.torque", "delay": 0.004},
    )
    found = response(late, f)
    turn = np.exp(-2j * np.pi * f * 0.003)
    np.testing.assert_allclose(found["speed", "drive"], plain["speed", "drive"] * turn, rtol=1e-12)
    both = np.exp(-2j * np.pi * f * 0.007)
    np.testing.assert_allclose(found["torque", "drive"], plain["torque", "drive"] * both, rtol=1e-12)
    np.testing.assert_allclose(found["speed", "load"], plain["speed", "load"], rtol=1e-12)


def test_lag_and_gain():
    f = np.geomspace(0.5, 80, 100)
    plain = response(two_masses(), f)["torque", "drive"]
    slow = two_masses(
        {"kind": "lag", "at": "inputs.drive", "time_constant": 0.01},
        {"kind": "input_gain", "at": "inputs.drive", "factor": 1.2},
    )
    np.testing.assert_allclose(response(slow, f)["torque", "drive"], 1.2 * plain / (1 + 0.02j * np.pi * f), rtol=1e-9)


def test_slip_response_closed_form():
    series = 9.0
    f = np.geomspace(1e-3, 100, 200)
    s = 2j * np.pi * f
    system = two_masses({"kind": "slip", "at": "shafts.link", "coefficient": series})
    link = 1 / (1 / (K + D * s) + 1 / (series * s))
    expected = link / (JA * JB * s**2 + (JA + JB) * link) * JB  # torque over drive torque
    np.testing.assert_allclose(response(system, f)["torque", "drive"], expected, rtol=1e-8)


def test_vehicle_against_dynamic_stiffness():
    from modelling.equations.casadi_code import compiled

    system = dataclasses.replace(load(EXAMPLES / "road_to_rig" / "vehicle.toml"), effects=())
    model, f = compiled(system), np.geomspace(0.1, 500, 60)
    n, linear = model.n, linearise(system)
    mass = model.mass(model.p0).full()
    stiffness, damping = -mass @ linear.A[n:, :n], -mass @ linear.A[n:, n:]
    wheel = model.coordinates.index("wheel_left")
    found = response(system, f, ["wheel_left_speed"], ["motor_torque"]).values[:, 0, 0]
    for frequency, value in zip(f, found):
        s = 2j * np.pi * frequency
        amplitude = np.linalg.solve(s**2 * mass + s * damping + stiffness, np.eye(n)[:, 0])
        assert value == pytest.approx(s * amplitude[wheel], rel=1e-7)


def test_by_name_and_bad_requests():
    found = response(two_masses(), [1.0, 2.0], sensors=["torque"])
    assert found.values.shape == (2, 1, 2)
    np.testing.assert_array_equal(found.to_dict()["torque"]["load"], found["torque", "load"])
    with pytest.raises(InputError, match="did you mean 'torque'"):
        found["torqe", "load"]
    with pytest.raises(InputError, match="0 Hz"):
        response(two_masses(), [0.0])
    with pytest.raises(InputError, match="0 Hz"):
        response(two_masses(), [0.0], sensors=["torque"])
    with pytest.raises(InputError, match="finite"):
        response(two_masses(), [np.nan])
    held = two_masses(drag=2.0)
    assert response(held, [0.0], ["speed"], ["drive"]).values[0, 0, 0] == pytest.approx(0.5)


def test_operating_point_closed_form():
    system = two_masses(
        {"kind": "slip", "at": "shafts.link", "coefficient": 5.0},
        {"kind": "quadratic_drag", "at": "inertias.b", "coefficient": 0.02},
        {"kind": "constant_torque", "at": "inertias.b", "torque": 3.0},
        drag=0.1,
    )
    speed = 40.0
    point = operating_point(system, {"b": speed}, free=["drive"])
    torque = 0.1 * speed + 0.02 * speed**2 + 3.0
    names = point.model.states
    assert point.u0 == pytest.approx([torque, 0.0])
    assert point.x0[names.index("speed(a)")] == pytest.approx(speed + torque / 5.0)  # constant slip speed
    assert point.x0[names.index("shafts.link.slip")] == pytest.approx(torque / K)
    assert point.model.rates(point.x0, point.u0, point.p).full().ravel()[2:] == pytest.approx(np.zeros(3), abs=1e-6)
    slow = response(point, [1e-5], ["speed"], ["drive"]).values[0, 0, 0]
    assert slow == pytest.approx(1 / (0.1 + 2 * 0.02 * speed), rel=1e-4)  # the drag's slope at that speed


def test_operating_point_with_lash_under_drive_and_coast():
    lash = {"kind": "backlash", "at": "shafts.link", "gap": 0.02}
    for torque in (-8.0, 8.0):
        point = operating_point(two_masses(lash, drag=0.1), {"a": 5.0}, {"load": 0.5 - torque}, ["drive"])
        assert point.u0[0] == pytest.approx(torque)
        twist = point.x0[0] - point.x0[1]
        assert twist == pytest.approx(torque / K + np.sign(torque) * 0.01)
        engaged = response(two_masses(drag=0.1), [0.1, 20.0]).values
        np.testing.assert_allclose(response(point, [0.1, 20.0]).values, engaged, rtol=1e-9)


def test_car_at_50_km_h():
    system = load(EXAMPLES / "compact_bev" / "vehicle.toml")
    point = operating_point(system, {"body": 44.0}, free=["motor_torque"])
    rates = point.model.rates(point.x0, point.u0, point.p).full().ravel()
    assert np.abs(rates[point.model.n :]).max() < 1e-5
    assert point.x0[point.model.states.index("speed(body)")] == pytest.approx(44.0)
    assert np.all(damped_modes_of(point).damping_ratios >= 0)


def test_no_operating_point_is_said():
    with pytest.raises(InputError, match="no steady motion"):
        operating_point(two_masses(drag=0.1), {"b": 5.0}, {"drive": 0.0, "load": 0.0}, [])
    with pytest.raises(InputError, match="no steady motion"):
        operating_point(two_masses(), {"a": 5.0, "b": 6.0})
    with pytest.raises(InputError, match="at least one"):
        operating_point(two_masses(), {})
    with pytest.raises(InputError, match="did you mean 'drive'"):
        operating_point(two_masses(), {"a": 1.0}, {"drove": 1.0})


def test_ripple_averages_out():
    ripple = {"kind": "torque_ripple", "at": "inertias.a", "order": 6, "amplitude": 4.0, "phase": 0.3}
    point = operating_point(two_masses(ripple, drag=0.1), {"b": 50.0}, free=["drive"])
    assert point.u0[0] == pytest.approx(5.0)
    f = np.geomspace(0.5, 100, 20)
    plain = operating_point(two_masses(drag=0.1), {"b": 50.0}, free=["drive"])
    np.testing.assert_allclose(response(point, f).values, response(plain, f).values, rtol=1e-9)


def test_a_derivative_beyond_all_numbers_names_its_state():
    with pytest.raises(InputError, match=r"the derivative of speed.b. is not finite"):
        linearise(two_masses(), {"inertias.b.J": 1e-200, "inertias.b.drag": 1e200})
