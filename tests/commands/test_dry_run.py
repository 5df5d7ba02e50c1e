"""``--check``: every command with input files reads and checks them, calculates nothing and writes nothing."""

import json

import pytest
from structure.imports import ROOT

from matching.cli import WITHOUT, main
from matching.commands import COMMANDS

RECORDED = ROOT / "examples" / "from_recordings"
REFERENCE = ROOT / "examples" / "road_to_rig"
MODEL = """[inertias.motor]
J = 0.05
[inertias.load]
J = 0.2
[shafts.link]
between = ["motor", "load"]
stiffness = 500
[inputs.torque]
on = "motor"
[sensors.speed]
measures = "speed"
of = "motor"
"""
DRIVE = "time [s],torque [N*m],speed [rad/s]\n" + "".join(f"{k / 100},{k % 7},{k % 5}\n" for k in range(80))
CALLS = {
    "modes": (["model.toml"], "a model: 2 inertias, 1 shaft, 1 input, 1 sensor"),
    "show": (["model.toml"], "a model: 2 inertias"),
    "show a recording": (["drive.csv"], "a recording: 3 channels of up to 80 samples"),
    "simulate": (["model.toml", "drive.csv"], "a recording: 80 samples over 0.79 s, inputs torque, sensors speed"),
    "diagnose": (["model.toml", "drive.csv", "--holdout", "other.csv"], "a recording: 80 samples"),
    "campbell": (["model.toml", "--speed", "600:6000 1/min", "--orders", "2,4"], "a model: 2 inertias"),
    "response": (["model.toml", "--speed", "6:60 rad/s", "--torques", "torque:2=9"], "a model: 2 inertias"),
    "match": ([str(REFERENCE / "case.toml")], "a case: 2 dynamometers, 2 target modes"),
    "tolerance": (
        [str(REFERENCE / "case.toml"), "--tolerance", "loop.dead_time=0.1"],
        "a case: 2 dynamometers",
    ),
    "excite": ([str(RECORDED / "case.toml"), "--limit", "motor_torque=60"], "a case: 1 dynamometer"),
    "identify": (
        [str(RECORDED / "case.toml"), "--bed", str(RECORDED / "bed.csv"), "--vehicle", str(RECORDED / "road.csv")],
        "bed.csv: a recording: 6000 samples over 5.999 s",
    ),
    "commission": (
        [str(RECORDED / "case.toml"), "--bed", "recordings", "--vehicle-recording", str(RECORDED / "road.csv")],
        "recordings: a folder for recordings of the bed",
    ),
    "learn": (
        [str(RECORDED / "case.toml"), str(RECORDED / "road.csv")],
        "road.csv: a recording of a manoeuvre on the controlled bed",
    ),
    "map": ([str(REFERENCE / "case.toml"), "--x", "loop.dead_time", "--y", "loop.inverter_lag"], "a case: "),
    "uncertainty": ([str(ROOT / "examples" / "gum" / "mass.toml")], "a budget: 1 measurand, "),
    "fidelity": ([str(ROOT / "examples" / "fidelity" / "tab2.toml")], "a fidelity case: Drive-away, Tab. 2"),
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "model.toml").write_text(MODEL)
    for name in ("drive.csv", "other.csv"):
        (tmp_path / name).write_text(DRIVE)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_every_command_that_reads_files_can_check_them():
    assert {call.split()[0] for call in CALLS} | set(WITHOUT) | {"verify"} == set(COMMANDS)


@pytest.mark.parametrize("command", CALLS)
def test_a_dry_run_says_what_the_files_hold_and_writes_nothing(command, folder, capsys):
    words, said = CALLS[command]
    assert main([command.split()[0], *words, "--check"]) == 0
    assert said in capsys.readouterr().out
    assert sorted(path.name for path in folder.iterdir()) == ["drive.csv", "model.toml", "other.csv"]


def test_a_wrong_file_is_one_line_and_exit_2(folder, capsys):
    (folder / "model.toml").write_text(MODEL.replace("J = 0.2", "J = -0.2"))
    assert main(["simulate", "model.toml", "drive.csv", "--check"]) == 2
    said = capsys.readouterr().err
    assert "inertias.load.J" in said
    assert said.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["tolerance", REFERENCE / "case.toml", "--tolerance", "loop.ded_time=0.1"], "did you mean 'loop.dead_time'"),
        (["modes", REFERENCE / "rig.toml", "--change", "inertias.motr.J=1"], "did you mean 'inertias.motor.J'"),
        (["map", REFERENCE / "case.toml", "--x", "loop.ded_time", "--y", "loop.inverter_lag"], "--x: 'loop.ded_time'"),
        (["uncertainty", ROOT / "examples" / "gum" / "mass.toml", "--wanted", "5 N"], "give it in mg"),
        (["excite", RECORDED / "case.toml", "--limit", "motr_torque=60"], "--limit motr_torque"),
        (["identify", RECORDED / "case.toml"], "no recording is given"),
        (["identify", RECORDED / "case.toml", "--bed", RECORDED / "road.csv"], "road.csv: input 'dyno'"),
        (["verify", RECORDED / "case.toml", "no.csv"], "no.csv: does not exist"),
        (["commission", RECORDED / "case.toml", "--bed", "bed.fmu"], "bed.fmu: does not exist"),
        (
            ["commission", RECORDED / "case.toml", "--bed", "recordings", "--vehicle-recording", "no.csv"],
            "no.csv: does",
        ),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)
def test_wrong_options_are_found_too(words, said, folder, capsys):
    assert main([*map(str, words), "--check"]) == 2
    line = capsys.readouterr().err
    assert said in line


def test_a_dry_run_as_json(folder, capsys):
    assert main(["modes", "model.toml", "--check", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["checked"]["model.toml"].startswith("a model: 2 inertias")


def test_without_a_dry_run_the_place_to_write_to_is_still_needed(folder, capsys):
    assert main(["match", "case.toml"]) == 2
    assert "--out" in capsys.readouterr().err
