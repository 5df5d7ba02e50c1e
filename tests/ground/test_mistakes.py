"""Mistakes that people make: one line says what is wrong and what would be right."""

import re
import shutil
from pathlib import Path

import pytest

from matching.cli import main
from matching.match.case_file import load_case

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    shutil.copytree(EXAMPLES / "compact_bev", tmp_path / "case")
    monkeypatch.chdir(tmp_path / "case")
    return tmp_path / "case"


def changed(folder, name, pattern, by):
    """A file with one line changed."""
    text = (folder / name).read_text(encoding="utf-8")
    other, count = re.subn(pattern, by, text, count=1, flags=re.M)
    assert count == 1
    (folder / name).write_text(other, encoding="utf-8")


@pytest.mark.parametrize(
    ("pattern", "by", "said"),
    [
        (r"^mode = \d+", "mode = 20", "the vehicle has 6 modes"),
        (r"^dead_time = \S+", "dead_time = 0,003", "write a decimal point: 0.003"),
        (r"^dead_time = \S+", 'dead_time = "0,003 s"', "write a decimal point: '0.003 s'"),
        (r"^vehicle = .*\nrig = .*$", 'vehicle = "rig.toml"\nrig = "vehicle.toml"', "are exchanged"),
    ],
)
def test_of_a_case(folder, capsys, pattern, by, said):
    changed(folder, "case.toml", pattern, by)
    assert main(["match", "case.toml", "--out", "out"]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert said in error


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ["match", "vehicle.toml", "--out", "out"],
            "is a model, where a case is expected; give it to 'rigmatch modes'",
        ),
        (["modes", "case.toml"], "is a case, where a model is expected; give it to 'rigmatch match'"),
        (["uncertainty", "vehicle.toml"], "is a model, where a budget is expected"),
        (
            ["simulate", "road.csv", "vehicle.toml", "--out", "out"],
            "is a recording, where a model or case file is expected",
        ),
    ],
)
def test_of_files_in_each_others_place(folder, capsys, words, said):
    shutil.copy(EXAMPLES / "from_recordings" / "road.csv", folder)
    assert main(words) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert said in error


def test_a_shared_part_that_differs_tenfold_is_said_first(folder, capsys):
    changed(folder, "rig.toml", r"^stiffness = 9000", "stiffness = 90000")
    assert "is 9000 in the vehicle and 90000 N*m/rad in the rig" in load_case(folder / "case.toml").notes[0]
    assert main(["match", "case.toml", "--check"]) == 0
    assert "the same part?" in capsys.readouterr().out
