"""Bad fidelity cases and signals get one clear line each."""

import numpy as np
import pytest

from matching.fidelity import fidelity_from_tables, read_case
from modelling.errors import InputError
from modelling.fidelity.measures import SignalPair, fidelity_of_signals

TIME = 0.01 * np.arange(200)
STEP = np.tanh((TIME - 1) / 0.1)
ONE = {"system_dynamics": 1.0}


def judge(reference=STEP, test=STEP, time=TIME, weights=ONE, f_max=30.0, **options):
    return fidelity_of_signals(time, {"torque": SignalPair(reference, test, **options)}, f_max=f_max, weights=weights)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"weights": {"system_dynamics": 0.9}}, "must sum to 1"),
        ({"weights": {"system_dynamics": 1.5, "residual_vehicle_model": -0.5}}, "no other"),
        ({"weights": None}, "give a weight to each domain"),
        ({"weights": {"system_dynamics": float("nan")}}, "at least 0"),
        ({"reference": 0 * STEP}, "range is zero"),
        ({"reference": 0 * STEP + 1e5}, "range is zero"),
        ({"test": STEP[:-1]}, "give equally many"),
        ({"test": np.where(TIME[7] == TIME, np.nan, STEP)}, "sample 8 of the test is nan"),
        ({"reference": np.where(TIME[7] == TIME, np.inf, STEP)}, "sample 8 of the reference is inf"),
        ({"time": TIME[:-1]}, "time has 199"),
        ({"time": TIME**2}, "equal steps"),
        ({"time": -TIME}, "equal steps"),
        ({"time": np.array([0.0])}, "at least two"),
        ({"f_max": 0.0}, "above 0"),
        ({"f_max": float("nan")}, "above 0"),
    ],
)
def test_signals(arguments, words):
    with pytest.raises(InputError) as caught:
        judge(**arguments)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def write(path, header, columns, lines=None):
    rows = lines or [",".join(f"{value:.9g}" for value in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([header, *rows]) + "\n")


def case(folder, **changes):
    write(folder / "road.csv", "time [s],torque [N*m],speed [1/min]", [TIME, 100 * STEP, 60 * STEP])
    write(folder / "rig.csv", "time [s],torque [kN*m],speed [rad/s]", [TIME + 5, 0.1 * STEP, 2 * np.pi * STEP])
    tables = {
        "f_max": "30 Hz",
        "recordings": {"reference": "road.csv", "test": "rig.csv"},
        "weights": {"system_dynamics": 0.8, "measurement_uncertainty": 0.2},
        "system_dynamics": {"torque": {}, "speed": {}},
        "measurement_uncertainty": {
            "torque": {"signal": "torque", "expanded_uncertainty": "0.689 N*m"},
            "speed": {"signal": "speed", "expanded_uncertainty": "1.2 1/min"},
        },
    }
    return tables | changes


def test_recordings_in_other_units_and_from_another_start_are_the_same_signals(tmp_path):
    _, fidelity = fidelity_from_tables(case(tmp_path), tmp_path / "case.toml")
    assert fidelity.domains["system_dynamics"] == pytest.approx(1, abs=1e-6)
    assert [one.ratio for one in fidelity.sensors] == pytest.approx([0.689 / 200, 1.2 / 120], rel=1e-6)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"weights": {"system_dynamics": 0.8, "measurement_uncertainty": 0.3}}, "must sum to 1"),
        ({"weights": {"dynamics": 1.0}}, "'dynamics' does not exist"),
        ({"f_max": "30 s"}, "does not fit"),
        ({"f_max": -1}, "not positive"),
        ({"arithmetic": "creative"}, "known are definition, published"),
        ({"arithmetic": "published"}, "divides by 6"),
        ({"recordings": {"reference": "road.csv", "test": "none.csv"}}, "none.csv: does not exist"),
        ({"system_dynamics": {"force": {}}}, "has no column 'force'; it has torque"),
        ({"system_dynamics": {"torque": {"test": "speed"}}}, "reference is in N*m, test in rad/s"),
        (
            {"system_dynamics": {"torque": {"nrmse_fidelity": 0.9, "test": "speed"}}},
            "states values and names signals at once",
        ),
        ({"system_dynamics": {"torque": {"nrmse_fidelity": 1.9}}}, "not in 0 ... 1"),
        ({"system_dynamics": {"torque": {"delay": 0.1}}}, "'nrmse_fidelity' is missing"),
        ({"system_dynamics": {"torque": {"nrmse_fidelity": 0.9, "delay": "5 kg"}}}, "does not fit"),
        (
            {"measurement_uncertainty": {"torque": {"signal": "torque", "expanded_uncertainty": "0.7 kg"}}},
            "another dimension",
        ),
        (
            {"measurement_uncertainty": {"torque": {"signal": "torque", "expanded_uncertainty": "0.7 1/blah"}}},
            "unknown unit",
        ),
        (
            {"measurement_uncertainty": {"torque": {"expanded_uncertainty": "0.7 N*m", "range": "0 N*m"}}},
            "not positive",
        ),
        ({"measurement_uncertainty": {"torque": {"expanded_uncertainty": "0.7 N*m"}}}, "has no range"),
        (
            {"measurement_uncertainty": {"torque": {"expanded_uncertainty": "0.7 N*m", "range": "100 1/min"}}},
            "unlike dimensions",
        ),
        (
            {"measurement_uncertainty": {"torque": {"signal": "froce", "expanded_uncertainty": 1}}},
            "no measured signal 'froce'",
        ),
        ({"measurement_uncertainty": {"torque": {}}}, "has no uncertainty"),
        ({"measurement_uncertainty": {"torque": 3}}, "is no table"),
        ({"system_dynamics": 3}, "is no table"),
    ],
)
def test_cases(tmp_path, changes, words):
    tables = case(tmp_path, **changes)
    with pytest.raises(InputError) as caught:
        fidelity_from_tables(tables, tmp_path / "case.toml")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("header", "lines", "words"),
    [
        ("time [s],torque [N*m]", ["0,1", "0.01,x", "0.02,1"], "line 3: 'x' in column 'torque [N*m]'"),
        ("time [s],torque [N*m]", ["0,1", "0.01", "0.02,1"], "line 3: 1 cells"),
        ("time [s],torque [Nom]", ["0,1", "1,2", "3,4"], "unknown unit"),
        (
            "time [s],torque [N*m]",
            [f"{n / 100},{'' if 20 <= n <= 40 else n}" for n in range(200)],
            "0.22 s of values",
        ),
        ("time [s],speed [1/s]", ["0,1", "1,2", "3,4"], "turns, radians or cycles"),
        ("time [s],torque [N*m]", ["0,1", "0.01,1"], "cut or resample both"),
        ("time [s],torque [N*m]", ["0,1", "0.01,1", "0.5,1"], "equal steps"),
        ("time [s]", ["0"], "has 1 row of numbers"),
    ],
)
def test_recordings(tmp_path, header, lines, words):
    tables = case(tmp_path)
    write(tmp_path / "rig.csv", header, None, lines)
    with pytest.raises(InputError) as caught:
        fidelity_from_tables(tables, tmp_path / "case.toml")
    assert words in str(caught.value)


def test_no_file(tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        read_case(tmp_path / "none.toml")
