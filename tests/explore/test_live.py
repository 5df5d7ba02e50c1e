"""Modes and responses that follow a slider, against closed forms."""

import math

import numpy as np
import pytest

from matching.explore.live import LiveModel, slider_range
from matching.explore.signals import measured_curves, opened_measurement
from modelling.model_file import from_dict
from modelling.recordings.recording import Recording
from modelling.system import Quantity

MOTOR, LOAD, STIFFNESS = 0.1, 1.0, 200.0


@pytest.fixture(scope="module")
def system():
    return from_dict({
        "inertias": {"motor": {"J": MOTOR}, "load": {"J": LOAD}},
        "shafts": {"link": {"between": ["motor", "load"], "stiffness": STIFFNESS, "damping": 0.5}},
        "inputs": {"torque": {"on": "motor"}},
        "sensors": {"speed": {"measures": "speed", "of": "motor"}},
    })  # fmt: skip


def speed_per_torque(f, stiffness):
    s = 2j * math.pi * f
    link = stiffness + 0.5 * s
    return s * (LOAD * s**2 + link) / (MOTOR * LOAD * s**4 + (MOTOR + LOAD) * s**2 * link)


def test_modes_and_responses_follow_a_value_in_closed_form(system):
    live = LiveModel(system)
    for stiffness in (STIFFNESS, 350.0):
        state = live.at({"shafts.link.stiffness": stiffness})
        elastic = math.sqrt(stiffness * (1 / MOTOR + 1 / LOAD)) / (2 * math.pi)
        assert state.modes.frequencies == pytest.approx([0.0, elastic], rel=1e-12)
        expected = speed_per_torque(state.response.frequencies, stiffness)
        assert state.response["speed", "torque"] == pytest.approx(expected, rel=1e-9)
    assert live.frequencies[0] < elastic < live.frequencies[-1]


def test_the_range_of_a_slider_is_that_of_the_file_or_a_factor():
    assert slider_range(Quantity(2.0, 1.5, 2.5)) == (1.5, 2.5)
    assert slider_range(Quantity(3.0)) == (1.0, 9.0)
    assert slider_range(Quantity(-3.0)) == (-9.0, -1.0)
    assert slider_range(Quantity(0.0)) is None


def test_a_signal_between_two_times_has_one_sample_beyond_each_end(tmp_path):
    (tmp_path / "a.csv").write_text("time [s],a\n" + "".join(f"{k / 100},{k}\n" for k in range(100)))
    t, y = opened_measurement(tmp_path / "a.csv").signal("a", 0.205, 0.235)
    assert y.tolist() == [20, 21, 22, 23, 24]
    assert t.tolist() == [0.2, 0.21, 0.22, 0.23, 0.24]


def test_a_measured_response_is_that_of_the_plant(system):
    """The recording is periodic, so its spectrum is the response times that of the torque, but for a little noise."""
    count, step = 8192, 0.002
    draw = np.random.default_rng(3)
    torque, noise = draw.normal(size=count), 1e-4 * draw.normal(size=count)
    lines = np.fft.rfftfreq(count, step)
    spectrum = np.fft.rfft(torque)
    spectrum[0] = 0.0
    answer = np.zeros_like(spectrum)
    answer[1:] = spectrum[1:] * speed_per_torque(lines[1:], STIFFNESS)
    recording = Recording(
        np.arange(count) * step,
        {"torque": np.fft.irfft(spectrum, count), "speed": np.fft.irfft(answer, count) + noise},
    )
    found = measured_curves(recording, system)
    expected = speed_per_torque(found.frequencies, STIFFNESS)
    assert found.values[:, 0, 0] == pytest.approx(expected, rel=0.02, abs=3e-4)  # the least is 0.004
