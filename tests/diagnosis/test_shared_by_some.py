"""A clock that some sensors of a quantity share and others do not is one cause; two faults of other sizes stay two."""

import numpy as np
import pytest

from matching.diagnosis.diagnose import diagnose
from modelling.effects.effect import members
from modelling.model_file import from_dict
from modelling.recordings.recording import Recording

J, DRAG, NOISE = 0.4, 0.6, 0.02
WAVES = ((2.0, 0.5, 0.3), (1.5, 1.3, 2.0), (1.0, 3.7, 4.0))  # amplitude N·m, Hz, rad
TIME = 0.005 * np.arange(1600)


def speed(time):
    """(t,) of one rigid train under the waves, in closed form."""
    w = [2 * np.pi * f for _, f, _ in WAVES]
    return sum(
        np.imag(a * np.exp(1j * (x * time + phase)) / (DRAG + 1j * x * J))
        for (a, _, phase), x in zip(WAVES, w, strict=True)
    )


def diagnosis(delays):
    """Of three speeds of the train, two of them late."""
    rng = np.random.default_rng(8)
    torque = sum(a * np.sin(2 * np.pi * f * TIME + phase) for a, f, phase in WAVES)
    channels = {"torque": torque}
    for name, delay in delays.items():
        channels[name] = speed(TIME - delay) + NOISE * rng.standard_normal(len(TIME))
    sensors = {name: {"measures": "speed", "of": name[0], "uncertainty": NOISE} for name in delays}
    system = from_dict({
        "inertias": {
            "a": {"J": {"value": J / 2 * 1.05, "tolerance": 0.2}, "drag": {"value": 0.5, "tolerance": 0.5}},
            "b": {"J": J / 4}, "c": {"J": J / 4},
        },
        "gears": {"g": {"between": ["a", "b"], "ratio": 1}, "h": {"between": ["b", "c"], "ratio": 1}},
        "inputs": {"torque": {"on": "a"}}, "sensors": sensors,
    })  # fmt: skip
    return diagnose(system, [Recording(TIME, channels)])


def test_two_of_three_speeds_that_are_late_alike_have_one_delay():
    found = diagnosis({"a_speed": 0.0, "b_speed": 0.03, "c_speed": 0.03})
    assert len(found.causes) == 1
    assert found.causes[0].kind == "sensor_delay"
    assert set(members(found.causes[0].at)) == {"sensors.b_speed", "sensors.c_speed"}
    assert found.causes[0].parameters["delay"].value == pytest.approx(0.03, abs=2e-4)


def test_two_of_other_delays_stay_two():
    found = diagnosis({"a_speed": 0.0, "b_speed": 0.03, "c_speed": 0.04})
    delays = {cause.at: cause.parameters["delay"].value for cause in found.causes if cause.kind == "sensor_delay"}
    assert delays == {
        "sensors.b_speed": pytest.approx(0.03, abs=3e-4),
        "sensors.c_speed": pytest.approx(0.04, abs=3e-4),
    }
