"""One recording from CSV, ``.mat``, Parquet and MDF4, a channel slower than the rest, gives one diagnosis."""

import csv
import json

import numpy as np
import pytest
from scipy.io import savemat
from scipy.signal import StateSpace, lsim

from matching.diagnosis.diagnosis import diagnose
from modelling.files import from_dict
from modelling.output import strict_json
from modelling.recording import read_recording

NOISE = 0.02  # rad/s
SYSTEM = from_dict({
    "inertias": {"motor": {"J": 0.1, "drag": 0.05}, "load": {"J": 1.2, "drag": 0.2}},
    "shafts": {"link": {"between": ["motor", "load"], "stiffness": {"value": 330, "tolerance": 0.2}, "damping": 0.5}},
    "inputs": {"motor_torque": {"on": "motor"}},
    "sensors": {
        "motor_speed": {"measures": "speed", "of": "motor", "uncertainty": NOISE},
        "load_speed": {"measures": "speed", "of": "load", "uncertainty": NOISE},
    },
})  # fmt: skip
TRUE_STIFFNESS = 300.0
TIME = np.arange(1500) * 0.002
UNITS = {"motor_torque": "N*m", "motor_speed": "1/min", "load_speed": "1/min"}
SLOW = slice(0, None, 4)


@pytest.fixture(scope="module")
def channels():
    """Two inertias by their equations, by SciPy: (t,) each, the load's speed only in every fourth row."""
    torque = 10 * np.sin(2 * np.pi * (1.0 * TIME + 2.0 * TIME**2)) + 8 * (TIME % 1 < 0.5)
    k, d = TRUE_STIFFNESS, 0.5
    rows = [
        [0, 0, 1, 0], [0, 0, 0, 1],
        [-k / 0.1, k / 0.1, -(d + 0.05) / 0.1, d / 0.1], [k / 1.2, -k / 1.2, d / 1.2, -(d + 0.2) / 1.2],
    ]  # fmt: skip
    plant = StateSpace(rows, [[0], [0], [10], [0]], [[0, 0, 1, 0], [0, 0, 0, 1]], [[0], [0]])
    speeds = lsim(plant, torque, TIME)[1] + NOISE * np.random.default_rng(5).standard_normal((len(TIME), 2))
    speeds *= 30 / np.pi
    load = np.full(len(TIME), np.nan)
    load[SLOW] = speeds[SLOW, 1]
    return {"motor_torque": torque, "motor_speed": speeds[:, 0], "load_speed": load}


def write_csv(path, channels):
    with path.open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["time [s]", *(f"{name} [{UNITS[name]}]" for name in channels)])
        for row in zip(TIME, *channels.values(), strict=True):
            table.writerow(["" if np.isnan(value) else repr(float(value)) for value in row])


def write_mat(path, channels):
    savemat(path, {"run": {"time": TIME, **channels, "units": UNITS}})


def write_parquet(path, channels):
    pyarrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    fields = [pyarrow.field(name, pyarrow.float64(), metadata={"unit": UNITS[name]}) for name in channels]
    schema = pyarrow.schema([pyarrow.field("time", pyarrow.float64(), metadata={"unit": "s"}), *fields])
    parquet.write_table(pyarrow.table([TIME, *channels.values()], schema=schema), path)


def write_mf4(path, channels, late=0.0):
    """A group a channel, as loggers write them; the slow group's clock may be late by some of a second."""
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF(version="4.10") as file:
        for name, value in channels.items():
            there = np.isfinite(value)
            stamps = TIME[there] + (late if name == "load_speed" else 0.0)
            file.append([asammdf.Signal(value[there], stamps, UNITS[name], name)])
        file.save(path, overwrite=True)


WRITERS = {".csv": write_csv, ".mat": write_mat, ".parquet": write_parquet, ".mf4": write_mf4}


def recorded(folder, suffix, channels, **how):
    path = folder / f"run{suffix}"
    WRITERS[suffix](path, channels, **how)
    return read_recording(path, SYSTEM)


def answer(recording):
    return json.loads(strict_json(diagnose(SYSTEM, [recording]).to_dict()).replace(recording.source, "FILE"))


@pytest.fixture(scope="module")
def from_csv(tmp_path_factory, channels):
    recording = recorded(tmp_path_factory.mktemp("csv"), ".csv", channels)
    return recording, answer(recording)


def test_the_recording_tells_the_stiffness(from_csv):
    _, found = from_csv
    own = found["parameters"]["shafts.link.stiffness"]
    assert own["value"] == pytest.approx(TRUE_STIFFNESS, rel=0.01)


@pytest.mark.parametrize("suffix", [".mat", ".parquet", ".mf4"])
def test_the_same_diagnosis_from_every_format(suffix, tmp_path, channels, from_csv):
    expected, diagnosis = from_csv
    got = recorded(tmp_path, suffix, channels)
    np.testing.assert_array_equal(got.time, expected.time)
    for name in UNITS:
        np.testing.assert_array_equal(got[name], expected[name])
    assert answer(got) == diagnosis


def test_stamps_that_differ_in_their_last_digits_are_one(tmp_path, channels):
    got = recorded(tmp_path, ".mf4", channels, late=1e-12)
    assert len(got.time) == len(TIME)
    np.testing.assert_allclose(got["load_speed"][SLOW] * 30 / np.pi, channels["load_speed"][SLOW], rtol=1e-12)


def test_a_slow_group_with_a_late_clock_keeps_its_rate(tmp_path):
    ramp = {"motor_torque": TIME, "motor_speed": 60 * TIME, "load_speed": np.full(len(TIME), np.nan)}
    ramp["load_speed"][SLOW] = 60 * (TIME[SLOW] + 0.0007)  # 60/min a second, seen 0.7 ms after each fourth row
    got = recorded(tmp_path, ".mf4", ramp, late=0.0007)
    np.testing.assert_allclose(got.time, TIME, atol=1e-12)
    there = np.isfinite(got["load_speed"])
    assert there.sum() == len(TIME[SLOW]) - 1  # before its first sample nothing is known of it
    np.testing.assert_allclose(got["load_speed"][there], 2 * np.pi * TIME[there], atol=1e-9)
    assert any("load_speed; straight lines between samples" in note for note in got.notes)
