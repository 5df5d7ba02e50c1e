"""Headers that do not say what their columns hold: torque and speed exchanged, times in another unit, no motion."""

import json

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import rigmatch as rm
from matching.cli import main
from modelling.errors import InputError
from modelling.model_file import dumps, from_dict, to_dict
from modelling.recordings.plausible import check_seconds
from modelling.recordings.read import read_recording

STEP = 2e-3
TIME = np.arange(2500) * STEP


def plant(seed):
    """Torque, speed and shaft torque (t,) of a drawn two-mass drive, by SciPy; its model. Odd seeds: one inertia."""
    rng = np.random.default_rng(seed)
    first, second = 10 ** rng.uniform(-2, 0, 2)
    stiffness = (2 * np.pi * rng.uniform(3, 12)) ** 2 * first * second / (first + second)
    drag, damping = 0.2 * (first + second), 0.02 * stiffness / 20
    size = 30 * (first + second)
    torque = size * (np.sign(np.sin(2 * np.pi * 0.7 * TIME)) + np.sin(2 * np.pi * (1 + 0.8 * TIME) * TIME) + 0.4)
    if seed % 2:
        second, stiffness, damping = 0.0, 0.0, 0.0

    def rates(t, x):
        shaft = stiffness * (x[0] - x[1]) + damping * (x[2] - x[3])
        driven = (np.interp(t, TIME, torque) - shaft - drag * x[2]) / first
        return [x[2], x[3], driven, shaft / second if second else 0.0]

    x = solve_ivp(rates, (0, TIME[-1]), np.zeros(4), t_eval=TIME, max_step=STEP, rtol=1e-7, atol=1e-9).y
    speed = x[2] + 0.003 * rng.normal(size=len(TIME))
    shaft = stiffness * (x[0] - x[1]) + damping * (x[2] - x[3])
    data = {
        "inertias": {"motor": {"J": float(first), "drag": float(drag)}},
        "inputs": {"torque": {"on": "motor"}},
        "sensors": {"speed": {"measures": "speed", "of": "motor", "uncertainty": 0.003}},
    }
    if second:
        data["inertias"]["load"] = {"J": float(second)}
        link = {"between": ["motor", "load"], "stiffness": float(stiffness), "damping": float(damping)}
        data |= {"shafts": {"link": link}}
        data["sensors"]["link_torque"] = {"measures": "torque", "of": "link", "uncertainty": 0.01 * size}
    return {"torque": torque, "speed": speed, "link_torque": shaft}, from_dict(data)


def written(path, columns, header="time [s],{}", time=TIME):
    np.savetxt(
        path, np.stack([time, *columns.values()], 1), "%.9g", ",", header=header.format(",".join(columns)), comments=""
    )
    return path


@pytest.mark.parametrize("seed", range(6))
def test_exchanged_columns_are_named(tmp_path, seed):
    columns, system = plant(seed)
    if seed % 2 == 0:  # an effect on a sensor beside them is no obstacle
        data = to_dict(system)
        system = from_dict(data | {"effects": [{"kind": "lag", "at": "sensors.link_torque", "time_constant": 1e-4}]})
    read_recording(written(tmp_path / "run.csv", columns), system)
    turned = columns | {"torque": columns["speed"], "speed": columns["torque"]}
    with pytest.raises(InputError, match="columns 'torque' and 'speed': hold each other's values"):
        rm.diagnose(system, written(tmp_path / "turned.csv", turned))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("stated", ["time", "time [s]"])
@pytest.mark.parametrize(("unit", "size"), [("ms", 1e-3), ("us", 1e-6)])
def test_a_time_in_another_unit_than_stated_is_named(tmp_path, seed, stated, unit, size):
    columns, system = plant(seed)
    path = written(tmp_path / "run.csv", columns, stated + ",{}", TIME / size)
    with pytest.raises(InputError, match=f"it is probably in {unit}"):
        read_recording(path, system)


def test_a_time_in_minutes_is_asked_for(tmp_path):
    columns, system = plant(1)
    (note,) = [
        note for note in read_recording(written(tmp_path / "a.csv", columns, time=TIME / 60), system).notes
        if "too fast" in note
    ]  # fmt: skip
    assert "is it in min" in note
    assert not any("too" in note for note in read_recording(written(tmp_path / "b.csv", columns), system).notes)


def test_milliseconds_that_are_stated_as_microseconds(tmp_path):
    columns, system = plant(1)
    path = written(tmp_path / "a.csv", columns, "time [ms],{}", TIME * 1e6)
    with pytest.raises(InputError, match=r"is in ms, and read so.*it is probably in us"):
        read_recording(path, system)


@pytest.mark.parametrize("noise", [0.0, 0.003])
def test_a_recording_in_which_nothing_moves(tmp_path, noise):
    columns, system = plant(0)
    rng = np.random.default_rng(2)
    still = {name: noise * rng.normal(size=len(TIME)) for name in columns} | {"torque": 0 * TIME}
    with pytest.raises(InputError, match="nothing moves in it"):
        rm.diagnose(system, written(tmp_path / "still.csv", still))
    still["torque"] = columns["torque"]
    (note,) = read_recording(written(tmp_path / "pushed.csv", still), system).notes
    assert note.startswith("nothing moves although inputs act: speed, link_torque")


@pytest.mark.parametrize("rest", [0.0, 3.3, 1e-40])
def test_a_sensor_at_rest_has_no_share_of_a_range(tmp_path, capsys, rest):
    """One without a stated uncertainty tells nothing: it neither decides the start nor ends a diagnosis."""
    columns, system = plant(2)
    data = to_dict(system)
    for sensor in data["sensors"].values():
        sensor.pop("uncertainty")
    rng = np.random.default_rng(2)
    still = columns | {"link_torque": rest * (1 + 1e-3 * rng.normal(size=len(TIME)) * (rest < 1))}
    path = written(tmp_path / "run.csv", still)
    (tmp_path / "model.toml").write_text(dumps(from_dict(data)))
    command = ["simulate", str(tmp_path / "model.toml"), str(path), "--out", str(tmp_path / "out")]
    assert main(command) == 0
    told = capsys.readouterr().out
    assert max(map(len, told.splitlines())) < 200
    assert main([*command, "--json"]) == 0
    misfit = json.loads(capsys.readouterr().out)["misfit"]
    assert misfit["link_torque"]["of_range"] is None
    assert misfit["speed"]["of_range"] < 0.01
    found = rm.diagnose(from_dict(data), path)
    assert found.verdict == "adequate"
    assert any("link_torque keeps one value and states no uncertainty" in note for note in found.notes)


def test_a_spinning_wheel_is_no_wrong_time(tmp_path):
    """A car whose tyre slides runs up its motor and wheel alone; without the tyre's slip the same says a wrong time."""
    data = {
        "inertias": {"motor": {"J": 0.06}, "wheel": {"J": 1.4}, "car": {"J": 135.0}},
        "shafts": {
            "side": {"between": ["motor", "wheel"], "ratio": 9.0, "stiffness": 9000.0, "damping": 12.0},
            "tyre": {"between": ["wheel", "car"], "stiffness": 4e4, "damping": 120.0},
        },
        "inputs": {"motor_torque": {"on": "motor"}},
        "sensors": {"motor_speed": {"measures": "speed", "of": "motor"}},
        "effects": [{"kind": "tyre_slip", "at": "shafts.tyre", "slip_stiffness": 9000, "peak": 1300, "shape": 1.6}],
    }
    time = np.linspace(0, 3, 1501)
    torque = 220 + 30 * np.sin(5 * time)
    slides = 9 * (9 * torque - 900) / (0.06 * 81 + 1.4)  # rad/s² of the motor, own balance, 900 N·m at the tyre
    speed = np.concatenate([[0], np.cumsum((slides[1:] + slides[:-1]) / 2 * np.diff(time))])
    channels = {"motor_torque": torque, "motor_speed": speed}
    assert check_seconds(time, channels, from_dict(data), "run.csv", "s") == []
    assert "too fast" in check_seconds(time, channels, from_dict(data | {"effects": []}), "run.csv", "s")[0]
