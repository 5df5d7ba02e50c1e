"""`rigmatch show RECORDING`: what a measurement file holds, and a channel file that fits a model."""

import json

import numpy as np
import pytest

from matching.cli import main
from modelling.model_file import load
from modelling.recordings.read import read_channels, read_recording
from modelling.recordings.recording import rows_a_value

MODEL = """[inertias.motor]
J = 0.05
[inputs.motor_torque]
on = "motor"
[sensors.motor_speed]
measures = "speed"
of = "motor"
uncertainty = 0.1
"""
# The speed has a value in every fourth row; nothing stands in the column of the oil
ROWS = [f"{k / 100},{k % 7 - 2},{300 + k if k % 4 == 0 else ''},\n" for k in range(40)]
RECORDED = "Zeit [s],T_motor [N*m],n_motor [1/min],oil [K]\n" + "".join(ROWS)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "model.toml").write_text(MODEL)
    (tmp_path / "drive.csv").write_text(RECORDED)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def listed(capsys, *words):
    assert main(["show", "drive.csv", *words, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_channels_with_units_samples_and_ranges(folder, capsys):
    rows = {row.pop("name"): row for row in listed(capsys)["channels"]}
    assert rows["T_motor"] == {"unit": "N*m", "samples": 40, "from": 0.0, "to": 0.39, "least": -2.0, "largest": 4.0}
    assert rows["n_motor"] == {"unit": "1/min", "samples": 10, "from": 0.0, "to": 0.36, "least": 300, "largest": 336}
    assert rows["oil"]["samples"] == 0
    assert rows["oil"]["least"] is None
    assert sorted(path.name for path in folder.iterdir()) == ["drive.csv", "model.toml"]


def test_the_table_in_the_terminal_has_a_dash_where_there_is_nothing(folder, capsys):
    assert main(["show", "drive.csv"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["name", "unit", "samples", "from", "to", "least", "largest"]
    assert [line.split() for line in lines if line.startswith("oil")] == [["oil", "K", "0", "-", "-", "-", "-"]]
    assert [line.split()[-2:] for line in lines if line.startswith("n_motor")] == [["300", "336"]]


def test_the_channel_file_for_a_model_can_be_used_as_written(folder, capsys):
    assert listed(capsys, "--model", "model.toml", "--out", "out")["files"] == ["drive_channels.toml"]
    system = load("model.toml")
    recording = read_recording("drive.csv", system, read_channels("out/drive_channels.toml"))
    assert recording["motor_speed"][4] == pytest.approx(304 * 3.141592653589793 / 30)
    assert "motor_speed is sampled slower: one value in 4 rows; it is compared where it has one" in recording.notes


def test_without_a_channel_of_time_it_is_said_and_samples_are_counted(folder, capsys):
    (folder / "drive.csv").write_text(RECORDED.replace("Zeit", "x"))
    found = listed(capsys)
    assert any(note.startswith("no channel is called time") for note in found["notes"])
    assert found["channels"][0]["to"] == 39.0


def test_a_model_goes_with_a_recording_only(folder, capsys):
    assert main(["show", "model.toml", "--model", "model.toml"]) == 2
    assert capsys.readouterr().err.startswith("rigmatch: --model: model.toml is no recording; one ends in .")
    assert sorted(path.name for path in folder.iterdir()) == ["drive.csv", "model.toml"]


NAN = float("nan")


@pytest.mark.parametrize(
    ("values", "rows"),
    [
        ([1.0, 2.0, 3.0, 4.0], 0),
        ([1.0, NAN, NAN, 2.0, NAN, NAN, 3.0], 3),
        ([1.0, NAN, NAN, 2.0, NAN, NAN, NAN, 3.0, NAN, NAN, 4.0], 3),  # give or take a row
        ([1.0, NAN, 2.0, 3.0, 4.0, 5.0], 0),
        ([1.0] + [NAN] * 2 + [2.0] + [NAN] * 9 + [3.0] + [NAN] * 2 + [4.0], 0),  # gaps of no one length
        ([NAN, 1.0, NAN], 0),
    ],
)
def test_how_many_rows_there_are_to_a_value(values, rows):
    assert rows_a_value(np.array(values)) == rows
