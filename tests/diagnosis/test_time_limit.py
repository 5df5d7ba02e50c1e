"""A diagnosis whose time is over ends with the best it has. The clock counts its steps, so nothing rests on timing."""

import numpy as np
import pytest

from matching.diagnosis.diagnose import diagnose
from modelling import resources as time_limit
from modelling.model_file import from_dict
from modelling.recordings.recording import Recording
from modelling.resources import limited, time_is_over

J, DRAG, NOISE, LATE = 0.2, 0.5, 0.02, 0.03
MODEL = {
    "inertias": {"rotor": {"J": J, "drag": {"value": DRAG, "lower": 0.1, "upper": 1.0}}},
    "inputs": {"motor": {"on": "rotor"}},
    "sensors": {"speed": {"measures": "speed", "of": "rotor", "uncertainty": NOISE}},
}


class Clock:
    """Goes on by one with each step that is told."""

    def __init__(self, monkeypatch):
        self.now = 0.0
        self.steps = []
        monkeypatch.setattr(time_limit, "monotonic", lambda: self.now)

    def tell(self, step):
        self.now += 1
        self.steps.append(step)


@pytest.fixture
def clock(monkeypatch):
    return Clock(monkeypatch)


def late_speed() -> Recording:
    """Two steady vibrations of one inertia, closed form, read 30 ms late."""
    time = 5e-3 * np.arange(800)
    torque, speed = np.zeros(800), NOISE * np.random.default_rng(4).normal(size=800)
    for frequency, amplitude in ((0.7, 4.0), (2.9, 6.0)):
        rate = 2 * np.pi * frequency
        wave = amplitude * np.exp(1j * rate * time)
        torque += wave.real
        speed += (wave * np.exp(-1j * rate * LATE) / (1j * rate * J + DRAG)).real
    return Recording(time, {"motor": torque, "speed": speed}, (), "late.csv", {})


def test_more_time_never_loses_the_cause(monkeypatch):
    named, recording = [], late_speed()
    for seconds in (1.0, 3.0, 5.0, 6.0, 1e9):  # the search for causes takes 5 steps, and is given 0.7 of them
        clock = Clock(monkeypatch)
        with limited(seconds) as limit:
            found = diagnose(from_dict(MODEL), [recording], None, clock.tell)
        named.append({cause.kind for cause in found.causes} & {"dead_time", "sensor_delay"} != set())
        assert (limit.ended_at > 0) == (seconds < 1e9)
    assert named == sorted(named)
    assert named[0] is False
    assert named[-3:] == [True, True, True]


def test_the_innermost_limit_counts_and_outside_there_is_none(clock):
    assert not time_is_over()
    with limited(10.0) as outer, limited(100.0) as inner:
        clock.now = 50.0
        assert not time_is_over()
        assert time_is_over(0.5)
        assert (outer.ended_at, inner.ended_at) == (0.0, 0.5)
        clock.now = 100.0
        assert time_is_over()
        assert inner.ended_at == 1.0
    with limited(None):
        assert not time_is_over()


def test_an_answer_that_was_cut_short_says_so(monkeypatch):
    for seconds, cut in ((1.0, True), (1e9, False)):
        clock = Clock(monkeypatch)
        found = diagnose(from_dict(MODEL), [late_speed()], None, clock.tell, time_limit=seconds)
        assert any("cut short" in note for note in found.notes) is cut
