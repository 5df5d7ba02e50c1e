"""A speed without a unit that is in 1/min is an error that says so, whatever the file."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.io import savemat

import rigmatch as rm
from matching.cli import main
from modelling.errors import InputError
from modelling.model_file import dumps, from_dict, to_dict
from modelling.recordings.read import read_recording
from modelling.simulation.simulate import check_speed_units, simulate
from tests.simulation.drives import excitation, system_with

MODEL = system_with()
TIME, INPUTS = excitation(1.0)
START = {"speed(motor)": 4.0, "speed(load)": 4.0}
WRONG_MODEL = system_with("wrong_parameter")  # load 15 % heavier than the one that is recorded


@pytest.fixture(scope="module")
def readings():
    return simulate(MODEL, TIME, INPUTS, start=START).readings


def written(folder, readings, factor, units=None):
    noise = np.random.default_rng(1).standard_normal((2, len(TIME))) * 0.05
    speeds = {name: (readings[name] + row) * factor for name, row in zip(("motor_speed", "load_speed"), noise)}
    savemat(folder / "run.mat", {"time": TIME, **INPUTS, **speeds, **({"units": units} if units else {})})
    return folder / "run.mat"


@pytest.mark.parametrize("model", [MODEL, WRONG_MODEL], ids=["right", "wrong"])
def test_speeds_in_turns_a_minute_without_a_unit_are_refused(tmp_path, readings, model):
    recording = read_recording(written(tmp_path, readings, 60 / (2 * np.pi)), model)
    with pytest.raises(InputError, match=r"run.mat: motor_speed, load_speed: .* fit the model in 1/min only"):
        check_speed_units(model, recording)


@pytest.mark.parametrize(
    ("factor", "units"), [(1.0, None), (60 / (2 * np.pi), {"motor_speed": "1/min", "load_speed": "rpm"})]
)
def test_speeds_that_are_what_they_are_taken_for_pass(tmp_path, readings, factor, units):
    check_speed_units(WRONG_MODEL, read_recording(written(tmp_path, readings, factor, units), WRONG_MODEL))


def test_speeds_that_fit_in_neither_pass_as_they_stand(tmp_path, readings):
    """A model may be wrong in many ways: only what fits in 1/min is put down to the unit."""
    check_speed_units(MODEL, read_recording(written(tmp_path, readings, 5.0), MODEL))


@pytest.mark.parametrize("command", ["simulate", "diagnose"])
def test_the_commands_say_so_in_one_line(tmp_path, readings, capsys, command):
    (tmp_path / "model.toml").write_text(dumps(MODEL))
    path = written(tmp_path, readings, 60 / (2 * np.pi))
    assert main([command, str(tmp_path / "model.toml"), str(path), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "fit the model in 1/min only" in said
    assert said.count("\n") == 1


def test_so_does_the_function(tmp_path, readings):
    with pytest.raises(InputError, match="fit the model in 1/min only"):
        rm.simulate(MODEL, written(tmp_path, readings, 60 / (2 * np.pi)))


@pytest.mark.parametrize("factor", [1.0, 60 / (2 * np.pi)])
def test_gap_of_years_is_not_simulated_over(tmp_path, readings, factor):
    """A clock that jumps: the longer part decides, as it does without the gap."""
    recording = read_recording(written(tmp_path, readings, factor), MODEL)
    apart = replace(recording, time=np.where(recording.time < 0.4, recording.time, recording.time + 1e9))
    if factor == 1.0:
        check_speed_units(MODEL, apart)
        return
    with pytest.raises(InputError, match="fit the model in 1/min only"):
        check_speed_units(MODEL, apart)


@pytest.mark.parametrize("wrapped", [False, True])
def test_angles_in_degrees_without_a_unit_are_refused(tmp_path, wrapped):
    sensors = {f"{name}_angle": {"measures": "angle", "of": name} for name in ("motor", "load")}
    model = from_dict(to_dict(MODEL) | {"sensors": sensors})
    angles = simulate(model, TIME, INPUTS, start=START).readings
    for scale in (1.0, 180 / np.pi):
        shown = {name: values * scale for name, values in angles.items()}
        if wrapped:
            shown = {name: values % (2 * np.pi * scale) for name, values in shown.items()}
        savemat(tmp_path / "run.mat", {"time": TIME, **INPUTS, **shown})
        recording = read_recording(tmp_path / "run.mat", model)
        if scale == 1.0:
            check_speed_units(model, recording)
            continue
        with pytest.raises(InputError, match=r"motor_angle, load_angle: .* fit the model in deg only, not in rad"):
            check_speed_units(model, recording)
