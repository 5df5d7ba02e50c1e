"""`rigmatch simulate` from end to end."""

import json

import numpy as np
import pytest
from result_schema import check_schema

from matching.cli import main
from matching.report.motions import simulation_figure
from modelling.model_file import dumps
from modelling.recordings.read import csv_text, read_recording
from modelling.simulation.simulate import simulate
from tests.simulation.drives import excitation, system_with

SYSTEM = system_with("backlash", "coulomb_friction")
START = {"speed(motor)": 12.0, "speed(load)": 12.0, "angle(motor)": 0.012}


@pytest.fixture
def files(tmp_path):
    time, inputs = excitation(2.0)
    made = simulate(SYSTEM, time, inputs, start=START)
    columns = {**inputs, "motor_speed": made["motor_speed"] * 30 / np.pi, "link_torque": made["link_torque"]}
    units = {"motor_torque": "N*m", "brake_torque": "N*m", "motor_speed": "1/min", "link_torque": "N*m"}
    (tmp_path / "model.toml").write_text(dumps(SYSTEM))
    (tmp_path / "recording.csv").write_text(csv_text(time, columns, units))
    return tmp_path


def command(files, *more):
    paths = [str(files / name) for name in ("model.toml", "recording.csv")]
    return main(["simulate", *paths, "--out", str(files / "out"), *more])


def test_what_was_recorded_is_simulated_again(files, capsys):
    assert command(files, "--json") == 0
    result = json.loads(capsys.readouterr().out)
    assert set(result["misfit"]) == {"motor_speed", "link_torque"}
    check_schema("simulate", result)
    assert all(one["of_range"] < 2e-3 for one in result["misfit"].values())
    header, *rows = (files / "out" / "simulated.csv").read_text().splitlines()
    assert header == ("time [s],motor_speed [rad/s],load_speed [rad/s],load_acceleration [rad/s^2],link_torque [N*m]")
    assert len(rows) == 2001
    recording = read_recording(files / "recording.csv", SYSTEM)
    simulated = np.loadtxt(rows, delimiter=",")
    assert np.sqrt(np.mean((simulated[:, 1] - recording["motor_speed"]) ** 2)) == pytest.approx(
        result["misfit"]["motor_speed"]["rms"], abs=1e-6
    )
    assert (files / "out" / "simulated.svg").read_text().startswith("<?xml")


def test_a_start_at_rest_misses_a_recording_in_motion(files, capsys):
    assert command(files, "--start", "rest") == 0
    shown = capsys.readouterr().out
    assert "root mean square" in shown
    assert [line.partition(":")[0].strip() for line in shown.splitlines()[1:3]] == ["motor_speed", "link_torque"]
    assert command(files, "--start", "rest", "--json") == 0
    assert json.loads(capsys.readouterr().out)["misfit"]["motor_speed"]["of_range"] > 0.1


def test_bad_recordings_end_with_two_and_leave_nothing(files, capsys):
    (files / "recording.csv").write_text("time [s],motor_torqe\n0,1\n1,2\n")
    assert command(files) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert "motor_torque" in told
    assert not (files / "out").exists()


def test_a_tolerance_sets_the_steps(files, capsys):
    rates = {}
    for share in ("1e-2", "1e-9"):
        assert command(files, "--json", "--start", "rest", "--tolerance", share) == 0
        result = json.loads(capsys.readouterr().out)
        assert result["tolerance"] == float(share)
        rates[share] = result["steps_per_second"]
    assert rates["1e-9"] > 2 * rates["1e-2"]


@pytest.mark.parametrize("share", ["0", "1", "2", "nan", "1e-12"])
def test_a_tolerance_that_is_none_is_one_line(files, capsys, share):
    assert command(files, "--tolerance", share) == 2
    said = capsys.readouterr().err
    assert said.startswith("rigmatch: --tolerance: ")
    assert said.count("\n") == 1


def test_its_figure_holds_readings_and_recording():
    time, inputs = excitation(0.5)
    made = simulate(SYSTEM, time, inputs, start=START)
    recorded = {"link_torque": 2 * made["link_torque"]}
    drawn = simulation_figure(made, recorded)
    for axes, (name, values) in zip(drawn.axes, made.readings.items(), strict=True):
        *measured, simulated = axes.get_lines()
        np.testing.assert_array_equal(simulated.get_xydata(), np.stack([time, values], axis=1))
        wanted = [list(recorded[name])] if name in recorded else []
        assert [list(line.get_ydata()) for line in measured] == wanted
