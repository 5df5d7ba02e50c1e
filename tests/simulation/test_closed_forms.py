"""Motions that can be written down."""

import numpy as np
import pytest

from modelling.model_file import from_dict
from modelling.simulation.simulate import simulate
from tests.simulation.drives import excitation, system_with

ONE = {
    "inertias": {"disc": {"J": 2.0, "drag": 0.5}},
    "inputs": {"torque": {"on": "disc"}},
    "sensors": {"speed": {"measures": "speed", "of": "disc"}, "angle": {"measures": "angle", "of": "disc"}},
}


def test_a_disc_runs_up_as_an_exponential(path):
    time = np.linspace(0, 5, 501)
    got = simulate(from_dict(ONE, "test"), time, {"torque": np.full(501, 3.0)}, compile=path)
    np.testing.assert_allclose(got["speed"], 6 * (1 - np.exp(-time / 4)), atol=1e-9)
    np.testing.assert_allclose(got["angle"], 6 * (time + 4 * np.exp(-time / 4) - 4), atol=1e-8)


def test_inputs_vary_linearly_between_samples(path):
    time = np.array([0.0, 1.0, 1.5, 4.0])
    torque = np.array([0.0, 2.0, -1.0, -1.0])
    got = simulate(from_dict(ONE, "test"), time, {"torque": torque}, {"inertias.disc.drag": 0.0}, compile=path)
    np.testing.assert_allclose(got["speed"], np.array([0.0, 1.0, 1.25, -1.25]) / 2, atol=1e-12)


@pytest.mark.parametrize("delay", [0.0, 0.004, 0.0123456, 0.1])
def test_dead_time_and_sensor_delay_are_exact(delay, path):
    effects = [
        {"kind": "dead_time", "at": "inputs.torque", "delay": delay},
        {"kind": "sensor_delay", "at": "sensors.angle", "delay": 2 * delay},
    ]
    late = from_dict(ONE | {"effects": effects}, "test")
    time = np.linspace(0, 2, 401)
    got = simulate(late, time, {"torque": time}, {"inertias.disc.drag": 0.0}, compile=path)
    # one step straddles the kink of the input
    np.testing.assert_allclose(got["speed"], np.maximum(time - delay, 0) ** 2 / 4, atol=1e-5)
    np.testing.assert_allclose(got["angle"], np.maximum(time - 3 * delay, 0) ** 3 / 12, atol=1e-5)


def test_before_a_recording_in_motion_the_shaft_turned_alike(path):
    late = from_dict(ONE | {"effects": [{"kind": "sensor_delay", "at": "sensors.angle", "delay": 0.05}]}, "test")
    time = np.linspace(0, 0.2, 41)
    start = {"speed(disc)": 10.0}
    got = simulate(late, time, {"torque": np.full(41, 5.0)}, start=start, compile=path)  # 5 N·m is its drag
    np.testing.assert_allclose(got["angle"], 10 * (time - 0.05), atol=1e-9)


def test_the_order_is_four():
    time, inputs = excitation(1.0, rate=50.0)

    def torque(rate):
        return simulate(system_with("hardening"), time, inputs, steps_per_second=rate)["link_torque"]

    errors = [np.abs(torque(rate) - torque(51200.0)).max() for rate in (200.0, 400.0, 800.0)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 4, atol=0.25)
