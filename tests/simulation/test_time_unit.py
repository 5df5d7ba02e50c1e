"""A time column without a unit is in seconds, or refused with the unit that it is probably in."""

import numpy as np
import pytest

from modelling.errors import InputError
from modelling.model_file import from_dict
from modelling.recordings.read import read_recording
from tests.simulation.drives import system_with
from tests.simulation.test_recording import HEADER, written

ROTOR = {
    "inertias": {"rotor": {"J": 0.1, "drag": 0.01}, "wheel": {"J": 0.4}},
    "gears": {"step": {"between": ["rotor", "wheel"], "ratio": 2.0}},  # 0.2 kg·m² in all at the rotor
    "inputs": {"torque": {"on": "rotor"}},
    "sensors": {
        "speed": {"measures": "speed", "of": "rotor"},
        "angle": {"measures": "angle", "of": "rotor"},
        "wheel_speed": {"measures": "speed", "of": "wheel"},
    },
}


def motion(rate):
    """Time, torque, rotor speed, angle (t,) of 3 s in closed form, with dry friction that the model does not have."""
    time = np.arange(0, 3, 1 / rate)
    speed = 20 + 5 * np.sin(9 * time) + 2 * np.sin(31 * time)
    torque = 0.2 * (45 * np.cos(9 * time) + 62 * np.cos(31 * time)) + 0.01 * speed + 1.5
    angle = 20 * time - 5 / 9 * (np.cos(9 * time) - 1) - 2 / 31 * (np.cos(31 * time) - 1)
    return time, torque, speed, angle


def recorded(tmp_path, sensor, unit_of_time, per_second, rate=200.0):
    time, torque, speed, angle = motion(rate)
    noise = 0.05 * np.random.default_rng(3).standard_normal(len(time))
    values = {"speed": speed + noise, "angle": angle + 0.001 * noise, "wheel_speed": speed / 2 + noise}[sensor]
    lines = [f"{t * per_second:.9g},{u:.9g},{y:.9g}" for t, u, y in zip(time, torque, values, strict=True)]
    path = written(tmp_path, lines, f"time{unit_of_time},torque,{sensor}")
    return read_recording(path, from_dict(ROTOR, "rotor"))


@pytest.mark.parametrize(("unit", "seconds"), [("ms", 1e-3), ("us", 1e-6)])
def test_a_time_without_unit_that_cannot_be_seconds_is_an_error_that_names_the_unit(tmp_path, unit, seconds):
    lines = [f"{k * 0.002 / seconds:.9g},{k},1,1,1" for k in range(50)]
    with pytest.raises(InputError, match=f"has no unit.*it is probably in {unit}"):
        read_recording(written(tmp_path, lines, HEADER.replace("time [s]", "time")), system_with())
    got = read_recording(written(tmp_path, lines, HEADER.replace("time [s]", f"time [{unit}]")), system_with())
    np.testing.assert_allclose(got.time, 0.002 * np.arange(50), atol=1e-12)


@pytest.mark.parametrize("rate", [50.0, 5000.0])
@pytest.mark.parametrize("sensor", ["speed", "angle", "wheel_speed"])
@pytest.mark.parametrize(("unit", "per_second"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_without_a_mode_the_recorded_motion_tells_the_unit(tmp_path, sensor, unit, per_second, rate):
    with pytest.raises(InputError, match=f"has no unit.*it is probably in {unit}: write 'time \\[{unit}\\]'"):
        recorded(tmp_path, sensor, "", per_second, rate)
    np.testing.assert_allclose(
        recorded(tmp_path, sensor, f" [{unit}]", per_second, rate).time, motion(rate)[0], atol=1e-6
    )


@pytest.mark.parametrize("rate", [50.0, 5000.0])
@pytest.mark.parametrize("sensor", ["speed", "angle", "wheel_speed"])
def test_seconds_without_unit_are_read(tmp_path, sensor, rate):
    assert recorded(tmp_path, sensor, "", 1.0, rate).time[-1] == pytest.approx(3, abs=0.03)


def test_where_nothing_tells_long_steps_need_a_unit(tmp_path):
    lines = [f"{5 * k},1.5,20" for k in range(100)]
    with pytest.raises(InputError, match=r"steps of 5 s are long for a drivetrain; write its unit: 'time \[s\]'"):
        read_recording(written(tmp_path, lines, "time,torque,speed"), from_dict(ROTOR, "rotor"))
    got = read_recording(written(tmp_path, lines, "time [s],torque,speed"), from_dict(ROTOR, "rotor"))
    assert got.time[-1] == 495
