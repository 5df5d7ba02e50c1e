"""A speed profile (:mod:`modelling.bed.profile`): nothing is driven while a case is read, then once, step by step."""

import pickle
import shutil
from pathlib import Path

import numpy as np
import pytest

from matching.match.case_file import load_case
from matching.match.driving import not_followed
from modelling.bed import profile
from modelling.errors import InputError

EXAMPLE = Path(__file__).parents[2] / "examples" / "drive_away"


def with_profile(folder, rows, name="case.toml"):
    shutil.copytree(EXAMPLE, folder, dirs_exist_ok=True)
    (folder / "stop_and_go.csv").write_text("time [s],vehicle_speed [km/h],grade [%]\n" + "\n".join(rows) + "\n")
    return folder / name


def test_reading_drives_nothing_and_the_first_torque_drives_once(tmp_path, monkeypatch):
    """Whatever its length: an hour is read, four seconds are driven, each sample once."""
    stepped, real = [], profile.run

    def counted(plant, controller, torques, *, samples, keep):
        stepped.append(samples)
        return real(plant, controller, torques, samples=samples, keep=keep)

    monkeypatch.setattr(profile, "run", counted)
    hour = [f"{t},{(0, 30, 30, 10)[t // 10 % 4]},0" for t in range(0, 3601, 10)]
    load_case(with_profile(tmp_path / "long", hour))
    assert stepped == []
    case = load_case(with_profile(tmp_path / "short", ["0,0,0", "2,20,0", "4,20,0"]))
    torques = case.operating_range.drives[-1].torques
    assert set(torques) == {"motor_torque", "brake_left", "brake_right"}
    assert stepped == []
    time = np.arange(4001) * case.loop["sample_time"]
    motor, brake = torques["motor_torque"].torque(time), torques["brake_left"].torque(time)
    assert stepped == [4001]
    assert motor.max() > 20
    assert not (motor * brake).any()
    again = pickle.loads(pickle.dumps(case)).operating_range.drives[-1].torques  # as for another process
    np.testing.assert_array_equal(again["motor_torque"].torque(time), motor)


def test_a_road_that_climbs_without_a_torque_on_the_body_is_said_when_it_is_read(tmp_path):
    place = with_profile(tmp_path, ["0,30,0", "5,30,4"])
    load_case(place)  # the car of the example has a torque of the road
    vehicle = (tmp_path / "vehicle.toml").read_text()
    made = vehicle.replace("[inputs.road_left]", "[inputs.elsewhere]")
    if made == vehicle:
        pytest.skip("the example's road has another name")
    (tmp_path / "vehicle.toml").write_text(made.replace('on = "body_left"', 'on = "motor"'))
    with pytest.raises(InputError):
        load_case(place)


def test_a_driver_who_cannot_follow_is_told(tmp_path):
    """From 0 to 120 km/h in two seconds takes more than his 400 N·m; a gentle profile is followed within 2 km/h."""
    hard = load_case(with_profile(tmp_path / "hard", ["0,0,0", "2,120,0", "4,120,0"]))
    (said,) = not_followed(hard)
    assert "off his profile" in said
    apart, at = hard.operating_range.drives[-1].torques.behind
    assert apart > 10
    assert 1 < at <= 4
    assert not_followed(load_case(with_profile(tmp_path / "gentle", ["0,0,0", "8,20,0", "12,20,0"]))) == []
