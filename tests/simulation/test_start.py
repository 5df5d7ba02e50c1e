"""Start states: rest, given, steady, and read off a recording."""

import tomllib

import numpy as np
import pytest

from modelling.equations.casadi_code import compiled
from modelling.errors import InputError
from modelling.model_file import from_dict
from modelling.recordings.recording import Recording
from modelling.simulation.simulate import _window, recorded_start, simulate, simulate_batch
from modelling.simulation.start import steady
from tests.simulation.drives import EFFECTS, excitation, system_with

TIME = np.linspace(0, 1, 201)


@pytest.mark.parametrize(
    "kinds", [(), ("backlash",), ("hardening", "lag"), ("slip",), ("compliance",), ("hysteresis",)]
)
def test_steady_motion_stays_as_it_is(kinds):
    inputs = {"motor_torque": np.full(201, 5.0), "brake_torque": np.full(201, -2.0)}
    got = simulate(system_with(*kinds), TIME, inputs, start="steady")
    assert np.ptp(got["motor_speed"]) < 1e-4 * np.abs(got["motor_speed"]).max()
    speed = got["load_speed"][0]
    assert got["motor_speed"][0] * 0.02 + speed * 0.15 == pytest.approx(
        3.0, rel=1e-4
    )  # drag takes what the torques give


def test_given_speeds_are_met_and_the_piece_accelerates_as_one():
    model = compiled(system_with())
    x = steady(model, model.p0, np.array([14.0, 0.0]), {"motor": 50.0})
    rate = np.array(model.rates(x, [14.0, 0.0], model.p0)).ravel()
    np.testing.assert_allclose(x[2:], 50.0)
    assert rate[2] == pytest.approx(rate[3])
    assert rate[2] == pytest.approx((14.0 - 50 * 0.17) / 1.39)


def test_without_drag_there_is_no_steady_speed():
    system = system_with().with_values({"inertias.motor.drag": 0.0, "inertias.load.drag": 0.0})
    with pytest.raises(InputError, match="no steady motion"):
        simulate(system, TIME, {"motor_torque": np.ones(201), "brake_torque": np.ones(201)}, start="steady")


def test_lags_start_where_the_first_input_holds_them():
    got = simulate(system_with("lag"), TIME, {"motor_torque": np.full(201, 4.0), "brake_torque": np.zeros(201)})
    np.testing.assert_allclose(got["inputs.motor_torque.lag"], 4.0)


def test_a_state_by_name_an_array_and_rows_of_states():
    model = compiled(system_with())
    time, inputs = excitation(0.1)
    by_name = simulate(model, time, inputs, start={"speed(load)": 3.0})
    by_array = simulate(model, time, inputs, start=np.array([0, 0, 0, 3.0]))
    np.testing.assert_array_equal(by_name.states, by_array.states)
    rows = simulate_batch(model, time, inputs, np.stack([model.p0] * 2), np.array([[0, 0, 0, 0], [0, 0, 0, 3.0]]))
    np.testing.assert_allclose(rows[1, :, 1], by_name["load_speed"], rtol=1e-12)
    assert abs(rows[0, 0, 1]) < 1e-12


@pytest.mark.parametrize(
    ("start", "line"),
    [
        ("moving", "'moving' is not known"),
        ({"speed(laod)": 1.0}, "did you mean 'speed\\(load\\)'"),
        ({"speed(load)": np.nan}, "not finite"),
        (np.zeros(3), "4 are needed"),
    ],
)
def test_a_wrong_start_is_told(start, line):
    with pytest.raises(InputError, match=line):
        simulate(system_with(), *excitation(0.1), start=start)


@pytest.mark.parametrize("kinds", [(), ("backlash", "coulomb_friction"), tuple(k for k in EFFECTS if "sensor" in k)])
def test_the_start_is_found_in_a_recording_in_motion(kinds):
    model = compiled(system_with(*kinds))
    time, inputs = excitation(1.0)
    truth = {"angle(motor)": 0.03, "angle(load)": 0.0, "speed(motor)": 21.0, "speed(load)": 19.0}
    made = simulate(model, time, inputs, start=truth)
    noise = np.random.default_rng(1).normal(size=(len(time), 4)) * 1e-3
    channels = {name: value + np.ptp(value) * noise[:, j] for j, (name, value) in enumerate(made.readings.items())}
    channels["load_speed"][3:40] = np.nan
    found = recorded_start(model, Recording(time, channels | inputs), model.p0)
    assert found["speed(motor)"] == pytest.approx(21.0, abs=0.1)
    assert found["speed(load)"] == pytest.approx(19.0, abs=0.1)
    if not kinds:
        assert found["angle(motor)"] - found["angle(load)"] == pytest.approx(0.03, abs=1e-3)


def test_one_inertia_and_sensors_that_begin_later_than_the_input():
    """J = 0.5, drag 0.2, 3 N·m: the speed from 8 rad/s on in closed form."""
    data = {
        "inertias": {"rotor": {"J": 0.5, "drag": 0.2}},
        "inputs": {"torque": {"on": "rotor"}},
        "sensors": {"speed": {"measures": "speed", "of": "rotor", "uncertainty": 0.01}},
    }
    model, time = compiled(from_dict(data, "rotor")), np.arange(1000) * 2e-3
    speed = 15 + (8 - 15) * np.exp(-0.4 * time)
    for first in (0, 250):
        seen = np.where(np.arange(1000) >= first, speed, np.nan)
        start = recorded_start(model, Recording(time, {"torque": np.full(1000, 3.0), "speed": seen}), model.p0)
        assert start["speed(rotor)"] == pytest.approx(8.0, abs=1e-4)


@pytest.mark.parametrize(("first", "rows"), [(0, 8), (5, 13)])
def test_eight_readings_tell_the_start_where_samples_are_seldom(first, rows):
    """At two samples a second: counted from the first reading, from the first row on."""
    data = {
        "inertias": {"rotor": {"J": 0.5, "drag": 0.2}},
        "inputs": {"torque": {"on": "rotor"}},
        "sensors": {"speed": {"measures": "speed", "of": "rotor", "uncertainty": 0.01}},
    }
    model, time = compiled(from_dict(data, "rotor")), np.arange(40) * 0.5
    seen = np.where(np.arange(40) >= first, 15.0, np.nan)
    window = _window(model, Recording(time, {"torque": np.full(40, 3.0), "speed": seen}), model.p0, 0.25, np.zeros(2))
    np.testing.assert_allclose(window.time, time[:rows])


def test_the_start_is_found_behind_gears_and_a_differential():
    data = tomllib.loads(GEARED)
    system = from_dict(data, "test")
    time = np.arange(500) * 1e-3
    inputs = {"motor_torque": 40 * np.sin(30 * time)}
    begin = {name: 3.0 if "left" in name else 4.0 for name in compiled(system).states if name.startswith("speed")}
    made = simulate(system, time, inputs, start=begin)
    found = recorded_start(compiled(system), Recording(time, {**inputs, **made.readings}), compiled(system).p0)
    again = simulate(system, time, inputs, start=found)
    for name, reading in made.readings.items():
        np.testing.assert_allclose(again[name], reading, atol=1e-6 * np.abs(reading).max())


GEARED = """
inertias = { motor.J = 0.05, cage.J = 0.05, left.J = 0.7, right.J = 0.7, wheel_left.J = 20, wheel_right.J = 20 }
gears.reduction = { between = ["motor", "cage"], ratio = { value = 9.7, tolerance = 0.01 } }
differentials.open = { cage = "cage", left = "left", right = "right" }
shafts.side_left = { between = ["left", "wheel_left"], stiffness = 9000, damping = 5 }
shafts.side_right = { between = ["right", "wheel_right"], stiffness = 9000, damping = 5 }
inputs.motor_torque.on = "motor"
sensors.motor_speed = { measures = "speed", of = "motor" }
sensors.left_torque = { measures = "torque", of = "side_left" }
sensors.left_speed = { measures = "speed", of = "wheel_left" }
"""


def test_one_inertia_runs_steadily_at_the_speed_its_drag_allows(path):
    disc = {
        "inertias": {"disc": {"J": 2.0, "drag": 0.5}},
        "inputs": {"torque": {"on": "disc"}},
        "sensors": {"speed": {"measures": "speed", "of": "disc"}},
    }
    got = simulate(from_dict(disc, "test"), TIME, {"torque": np.full(201, 3.0)}, start="steady", compile=path)
    np.testing.assert_allclose(got["speed"], 6.0, rtol=1e-9)


def test_a_ripple_is_averaged_over_a_turn():
    model, plain = compiled(system_with("torque_ripple")), compiled(system_with())
    u = np.array([5.0, -2.0])
    np.testing.assert_allclose(steady(model, model.p0, u), steady(plain, plain.p0, u), atol=1e-9)


def test_a_load_that_friction_would_hide_runs_up():
    """Between breakaway and sliding friction falls with speed: Newton from rest ends in the minimum between."""
    system = system_with("stribeck_friction", "quadratic_drag")
    model = compiled(system)
    x = steady(model, model.p0, np.array([6.0, -9.5]))
    v = x[2]
    assert v < -5
    assert x[3] == pytest.approx(v)
    drag = 0.17 * v + 0.02 * v * abs(v)
    assert drag == pytest.approx(-3.5 + 0.5, rel=1e-6)  # sliding friction is 0.5 N·m
