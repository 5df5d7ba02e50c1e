"""Channels of a logger whose clock is late or early, against the motion of a body under a ramp of torque."""

import numpy as np
import pytest

from modelling.model_file import from_dict
from modelling.simulation.simulate import simulate

J, SLOPE = 0.5, 3.0  # kg·m², N·m/s
TIME = np.arange(201) * 5e-3


def body(at, offset):
    return from_dict({
        "inertias": {"rotor": {"J": J}}, "inputs": {"motor": {"on": "rotor"}},
        "sensors": {"speed": {"measures": "speed", "of": "rotor"}, "angle": {"measures": "angle", "of": "rotor"}},
        "effects": [{"kind": "clock_offset", "at": at, "offset": offset}],
    })  # fmt: skip


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("offset", [0.0313, -0.0313])
def test_sensors_of_a_late_clock_show_the_past_and_of_an_early_one_the_future(offset, compiled):
    system = body(["sensors.speed", "sensors.angle"], offset)
    got = simulate(system, TIME, {"motor": SLOPE * TIME}, compile=compiled)
    then = TIME - offset
    inside = (then >= 0) & (then <= TIME[-1])
    np.testing.assert_allclose(got["speed"][inside], SLOPE * then[inside] ** 2 / (2 * J), atol=1e-9)
    np.testing.assert_allclose(got["angle"][inside], SLOPE * then[inside] ** 3 / (6 * J), atol=1e-9)
    beyond = then > TIME[-1]  # nothing is known of it: it moves on as at the last sample
    speed, angle = SLOPE * TIME[-1] ** 2 / (2 * J), SLOPE * TIME[-1] ** 3 / (6 * J)
    np.testing.assert_allclose(got["speed"][beyond], speed, atol=1e-9)
    np.testing.assert_allclose(got["angle"][beyond], angle + speed * (then[beyond] - TIME[-1]), atol=1e-9)


@pytest.mark.parametrize("compiled", [True, False])
def test_an_input_of_a_late_clock_has_acted_earlier(compiled):
    offset = 0.04  # eight samples
    got = simulate(body("inputs.motor", offset), TIME, {"motor": SLOPE * TIME}, compile=compiled)
    torque = np.minimum(SLOPE * (TIME + offset), SLOPE * TIME[-1])  # held after the last sample
    expected = np.concatenate([[0.0], np.cumsum((torque[1:] + torque[:-1]) / 2 * np.diff(TIME))]) / J
    np.testing.assert_allclose(got["speed"], expected, atol=1e-9)
