"""The first hour with recordings of a car: inputs that no logger has, units in names, times of any name."""

import numpy as np
import pytest

import rigmatch as rm
from modelling.errors import InputError
from modelling.model_file import from_dict
from modelling.recordings.read import Channel, absent_inputs, read_recording
from modelling.recordings.table import name_and_unit, unit_in_name

VEHICLE = from_dict({
    "inertias": {"motor": {"J": 0.1}, "body": {"J": 3.0}},
    "shafts": {"side": {"between": ["motor", "body"], "stiffness": 300.0, "damping": 1.0}},
    "inputs": {"motor_torque": {"on": "motor"}, "road_torque": {"on": "body"}},
    "sensors": {"motor_speed": {"measures": "speed", "of": "motor", "uncertainty": 0.1}},
})  # fmt: skip
TIME = np.arange(200) * 0.01
ROWS = [f"{t:.2f},{10 * np.sin(9 * t):.6f},{60 + 30 * np.sin(9 * t - 1):.6f}" for t in TIME]


def written(path, head, rows=ROWS):
    path.write_text("\n".join([head, *rows, ""]))
    return path


def test_a_torque_that_no_channel_holds_is_zero_with_a_note(tmp_path):
    path = written(tmp_path / "road.csv", "time [s],motor_torque [N*m],motor_speed [1/min]")
    got = read_recording(path, VEHICLE, absent_is_zero=True)
    assert not got["road_torque"].any()
    assert "no channel holds road_torque: it is taken as zero" in got.notes
    with pytest.raises(InputError, match="'road_torque' was not recorded"):
        read_recording(path, VEHICLE)  # a bed's torques all have to be there


@pytest.mark.parametrize(
    ("columns", "mapped", "absent"),
    [
        (["motor_torque", "motor_speed"], False, ["road_torque"]),
        (["motor_torque", "gear", "temp"], False, ["road_torque"]),
        (["motor_torque", "road_torqe"], False, []),  # written otherwise: a mistake
        (["motor_torque", "road_torqe"], True, []),
        (["motor_torque", "M_SW"], False, []),  # may be it
        (["motor_torque", "M_SW"], True, ["road_torque"]),  # a channel file has said which is which
        (["motor_torque", "axle trq"], False, []),
        (["motor_speed"], False, []),  # no input at all
        (["n_EM", "M_EM"], True, []),
    ],
)
def test_what_may_be_a_mistake_is_no_zero(columns, mapped, absent):
    assert absent_inputs(columns, (), VEHICLE, mapped) == absent


def test_an_imposed_motion_is_never_zero():
    data = {
        "inertias": {"turned": {"J": 1.0}, "free": {"J": 0.1}},
        "shafts": {"s": {"between": ["turned", "free"], "stiffness": 1000.0}},
        "inputs": {"turns": {"on": "turned", "measures": "speed"}, "push": {"on": "free"}},
        "effects": [{"kind": "imposed_motion", "at": "inertias.turned"}],
    }
    assert absent_inputs(["push"], (), from_dict(data), mapped=True) == []


def test_the_vehicle_of_a_starter_moves_as_a_road_recording_says(tmp_path):
    """Every vehicle of `rigmatch new` has a road torque, and no logger records it; two loggers neither."""
    rm.new(tmp_path / "first")
    path = written(tmp_path / "road.csv", "Zeit [s],motor_torque [N*m],motor_speed [1/min]")
    run = rm.simulate(tmp_path / "first" / "vehicle.toml", path)
    assert np.isfinite(run.readings["motor_speed"]).all()
    sensors = [",".join(row.split(",")[::2]) for row in ROWS]
    other = written(tmp_path / "other.csv", "time [s],motor_speed [1/min]", sensors)
    inputs = written(tmp_path / "inputs.csv", "time [s],motor_torque [N*m]", [row.rpartition(",")[0] for row in ROWS])
    got = rm.read_recording(f"{inputs}+{other}", tmp_path / "first" / "vehicle.toml")
    assert not got["road_torque"].any()


@pytest.mark.parametrize(
    ("header", "name", "unit"),
    [
        ("speed (rpm)", "speed", "rpm"),
        ("Speed [1/min]", "Speed", "1/min"),
        ("M (kN·m)", "M", "kN·m"),
        ("phi (°)", "phi", "°"),
        ("slip (%)", "slip", "%"),
        ("speed (filtered)", "speed (filtered)", ""),
        ("speed (1)", "speed (1)", ""),
        ("(rpm)", "(rpm)", ""),
    ],
)
def test_a_unit_in_brackets(header, name, unit):
    assert name_and_unit(header) == (name, unit)


@pytest.mark.parametrize(
    ("name", "unit"),
    [("n_rpm", "1/min"), ("rpm", "1/min"), ("M_EM_Nm", "N*m"), ("phi.deg", "deg"), ("motor_speed", ""), ("norpm", "")],
)
def test_a_unit_at_the_end_of_a_name(name, unit):
    assert unit_in_name(name) == unit


def test_the_unit_in_a_name_is_used_and_a_contradiction_told(tmp_path):
    path = written(tmp_path / "run.csv", "Zeit,M_Nm,n_rpm")
    named = {"motor_torque": Channel("M_Nm"), "motor_speed": Channel("n_rpm")}
    got = read_recording(path, VEHICLE, named, absent_is_zero=True)
    np.testing.assert_allclose(got["motor_speed"], (60 + 30 * np.sin(9 * TIME - 1)) * np.pi / 30, atol=1e-6)
    assert "n_rpm is taken in 1/min, as its name says" in got.notes
    named["motor_speed"] = Channel("n_rpm", "rad/s")
    got = read_recording(path, VEHICLE, named, absent_is_zero=True)
    assert "n_rpm is in 1/min by its name, taken in rad/s by the channel file" in got.notes
    path = written(tmp_path / "bracketed.csv", "Time (s),motor_torque (Nm),n (rpm)")
    for called in ("n", "n (rpm)"):
        again = read_recording(path, VEHICLE, {"motor_speed": Channel(called)}, absent_is_zero=True)
        np.testing.assert_allclose(again["motor_speed"], (60 + 30 * np.sin(9 * TIME - 1)) * np.pi / 30, atol=1e-6)


@pytest.mark.parametrize("index", ["rows", "time [s]", "Zeit", "unnamed", "durations", "dates", "column", "Time (ms)"])
def test_a_dataframe_is_a_recording(index):
    pandas = pytest.importorskip("pandas")
    torque, speed = 10 * np.sin(9 * TIME), 60 + 30 * np.sin(9 * TIME - 1)
    frame = pandas.DataFrame({"motor_torque [N*m]": torque, "motor_speed (rpm)": speed, "driver": ["me"] * len(TIME)})
    if index == "column":
        frame["time"] = TIME
    elif index == "rows":
        frame["t [s]"] = TIME
    elif index == "Time (ms)":
        frame["Time (ms)"] = 1e3 * TIME
    elif index == "durations":
        frame.index = pandas.to_timedelta(TIME, unit="s")
    elif index == "dates":
        frame.index = pandas.Timestamp("2026-11-28 09:31") + pandas.to_timedelta(TIME, unit="s")
    else:
        frame.index = pandas.Index(TIME, name=None if index == "unnamed" else index)
    got = rm.simulate(VEHICLE, frame)
    np.testing.assert_allclose(got.time, TIME, atol=1e-9)
    from modelling.recordings.read import recording_of_frame

    read = recording_of_frame(frame, VEHICLE)
    np.testing.assert_allclose(read["motor_speed"], speed * np.pi / 30)
    assert not read["road_torque"].any()


def test_a_dataframe_that_is_no_recording_is_one_line():
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({"motor_torque": [1.0, 2.0], "motor_speed": [0.0, 1.0]})
    with pytest.raises(InputError, match="has no column 'time'"):
        rm.simulate(VEHICLE, frame)
    with pytest.raises(InputError, match="'motor_torque' was not recorded"):
        rm.simulate(VEHICLE, frame.rename(columns={"motor_torque": "M"}).assign(time=[0.0, 1.0]))
    with pytest.raises(InputError, match="list is no recording"):
        rm.simulate(VEHICLE, [1.0, 2.0])
