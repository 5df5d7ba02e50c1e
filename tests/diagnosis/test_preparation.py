"""Recordings with gaps, stuck and missing channels become data, and what was left out is told."""

import numpy as np
import pytest

from matching.diagnosis.data import prepare_data
from modelling.errors import InputError
from modelling.model_file import from_dict
from modelling.recordings.recording import Recording


def system(uncertainty: float | None = 0.1):
    speed = {"measures": "speed", "of": "rotor"} | ({"uncertainty": uncertainty} if uncertainty else {})
    return from_dict(
        {
            "inertias": {"rotor": {"J": 1.0}},
            "inputs": {"motor": {"on": "rotor"}},
            "sensors": {"speed": speed, "angle": {"measures": "angle", "of": "rotor", "uncertainty": 0.1}},
        }
    )


def recording(time: np.ndarray, speed: np.ndarray, **more: np.ndarray) -> Recording:
    return Recording(time, {"motor": np.ones_like(time), "speed": speed, **more}, (), "made.csv")


def noisy(count: int, seed: int = 0) -> np.ndarray:
    return np.sin(np.arange(count) / 50) + 0.1 * np.random.default_rng(seed).standard_normal(count)


def test_stuck_channel_is_left_out_and_told() -> None:
    time, speed = np.arange(2000) * 1e-3, noisy(2000)
    speed[500:900] = speed[500]
    data, notes = prepare_data(system(), [recording(time, speed)])
    assert data.readings_by_sensor.tolist() == [1600, 0]
    assert any("speed does not move from 0.5 to 0.899 s: it is stuck" in note for note in notes)


def test_a_drive_that_stands_still_is_no_stuck_sensor() -> None:
    """Speed 0 while the angle stays where it is; where the angle moves on, the speed hangs."""
    time, speed = np.arange(2000) * 1e-3, noisy(2000)
    speed[500:900] = speed[1300:1700] = 0.0
    angle = np.cumsum(speed) * 1e-3
    angle[1300:1700] += 1e-3 * np.arange(400)
    both = Recording(time, {"motor": np.zeros(2000), "speed": speed, "angle": angle}, source="r.csv")
    data, notes = prepare_data(system(), [both])
    (stuck,) = [note for note in notes if "stuck" in note]
    assert "speed does not move from 1.3 to 1.699 s: it is stuck" in stuck
    assert data.readings_by_sensor.tolist() == [1600, 2000]


def test_saturated_channel_is_told_as_such() -> None:
    time, speed = np.arange(2000) * 1e-3, noisy(2000)
    speed[700:900] = speed.max() + 0.1
    _, notes = prepare_data(system(), [recording(time, speed)])
    assert any("end of its range" in note for note in notes)


def test_what_is_left_out_of_each_recording_is_told_of_all() -> None:
    time, stuck, saturated = np.arange(2000) * 1e-3, noisy(2000), noisy(2000, seed=1)
    stuck[500:900] = stuck[500]
    saturated[700:900] = saturated.max() + 0.1
    _, notes = prepare_data(system(), [recording(time, stuck), recording(time, saturated)])
    assert any("from 0.5 to 0.899 s: it is stuck" in note for note in notes)
    assert any("end of its range" in note for note in notes)


def test_gap_makes_two_segments() -> None:
    time = np.concatenate([np.arange(1000) * 1e-3, 3 + np.arange(1000) * 1e-3])
    data, _ = prepare_data(system(), [recording(time, noisy(2000))])
    assert [len(segment.time) for segment in data.segments] == [1000, 1000]


def test_slow_recording_is_one_segment_and_one_missing_sample_is_no_gap() -> None:
    """At 8 Hz a step is longer than 0.1 s: gaps are those that a reader does not bridge either."""
    time = np.delete(np.arange(200) * 0.125, 77)
    data, notes = prepare_data(system(), [recording(time, noisy(199))])
    assert [len(segment.time) for segment in data.segments] == [199]
    assert not notes


def test_coarse_steps_of_a_reading_are_not_stuck() -> None:
    time = np.arange(2000) * 1e-3
    data, notes = prepare_data(system(), [recording(time, np.round(np.sin(time), 2))])
    assert data.readings_by_sensor[0] == 2000
    assert not notes


def test_noise_that_nobody_states_is_read_off() -> None:
    time = np.arange(5000) * 1e-3
    data, notes = prepare_data(system(None), [recording(time, noisy(5000))])
    assert data.noise[0] == pytest.approx(0.1, rel=0.1)
    assert any("states no uncertainty" in note for note in notes)


def test_recording_without_any_sensor_is_refused() -> None:
    time = np.arange(500) * 1e-3
    empty = Recording(time, {"motor": np.ones(500)}, (), "made.csv")
    with pytest.raises(InputError, match=r"made\.csv: has no sensor of the model"):
        prepare_data(system(), [empty])


def test_too_short_a_recording_is_refused() -> None:
    time = np.arange(20) * 1e-3
    with pytest.raises(InputError, match="20 samples"):
        prepare_data(system(), [recording(time, noisy(20))])
