"""Mistakes that people make: one line says what is wrong and what would be right."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from matching.api import _speeds
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
        (r"^band = .*", "band = [0.5, 6000]", "reaches half the sampling frequency"),
        (r"^band = .*", "band = [0, 30]", "begins at 0 Hz, where a free drivetrain has no response"),
        (r"^title = .*", 'title = "compact', 'line 4: a text begins with " and does not end'),
        (
            r"^knows = .*",
            'knows = ["dyno_left"]',
            "'dyno_left' is the torque of a dynamometer, which the controller commands",
        ),
        (
            r"^\[move\]",
            '[move]\n"loop.dead_time" = { lower = 0, upper = 0.01 }',
            "is the bed's, and no match can choose it",
        ),
    ],
)
@pytest.mark.parametrize("more", [["--check"], ["--out", "out"]])
def test_of_a_case(folder, capsys, pattern, by, said, more):
    """--check finds them, too."""
    changed(folder, "case.toml", pattern, by)
    assert main(["match", "case.toml", *more]) == 2
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
        (["diagnose", "vehicle.toml", "rig.toml", "--out", "out"], "is a model or case file, where a recording is"),
        (["excite", "case.toml", "--duration", "20,5", "--out", "out"], "write a decimal point: '20.5'"),
        (
            ["tolerance", "case.toml", "--tolerance", "loop.dead_time=0,2", "--out", "out"],
            "write a decimal point: '0.2'",
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


LOOP = """
[inertias]
a = {J = 1}
b = {J = 1}
c = {J = 1}
[inputs]
torque = {on = "a"}
[shafts]
ab = {between = ["a", "b"], stiffness = 100}
bc = {between = ["b", "c"], stiffness = 100, ratio = 2}
"""


def test_a_manoeuvre_beyond_the_limits_is_said_before_the_match(folder, capsys):
    changed(folder, "case.toml", r"^amplitude = .*", "amplitude = 1e5")
    assert main(["match", "case.toml", "--check"]) == 0
    assert "note: as planned, to move as the vehicle does, the manoeuvre takes a" in capsys.readouterr().out


@pytest.mark.parametrize("words", [["match", "case.toml", "--outt", "x"], ["match", "case.toml", "--ouut=x"]])
def test_a_misspelt_option_that_has_to_be_there(folder, capsys, words):
    assert main(words) == 2
    assert f"did you mean '--out' instead of '{words[2].partition('=')[0]}'?" in capsys.readouterr().err


@pytest.mark.parametrize("more", [["--check"], ["--out", "out"]])
def test_recordings_that_no_diagnosis_can_use(tmp_path, monkeypatch, capsys, more):
    """Too short, or judged by what was fitted; said before anything is computed."""
    monkeypatch.chdir(tmp_path)
    example = EXAMPLES / "from_recordings"
    lines = (example / "bed.csv").read_text().splitlines()
    Path("short.csv").write_text("\n".join(lines[:41]))
    for recordings, said in (
        (["short.csv"], "short.csv: has 40 samples; at least 64 are needed"),
        ([str(example / "bed.csv"), "--holdout", str(example / "bed.csv")], "is fitted as well"),
    ):
        assert main(["diagnose", str(example / "rig.toml"), *recordings, *more]) == 2
        assert said in capsys.readouterr().err


def test_a_folder_in_place_of_a_file(folder, capsys):
    assert main(["match", ".", "--out", "out"]) == 2
    assert "is a directory; name a file in it" in capsys.readouterr().err


@pytest.mark.parametrize("closing", ["[shafts.ac]\nstiffness = 50", "[gears.ac]"])
def test_a_loop_that_contradicts_itself_locks_the_drive(tmp_path, capsys, closing):
    """a turns twice as fast as c; a loop that agrees has a rigid-body mode."""
    path = tmp_path / "loop.toml"
    path.write_text(f'{LOOP}{closing}\nbetween = ["a", "c"]\nratio = 1\n')
    assert main(["modes", str(path)]) == 2
    assert "locks the drivetrain" in capsys.readouterr().err
    path.write_text(path.read_text().replace("ratio = 1\n", "ratio = 2\n"))
    assert main(["modes", str(path), "--out", str(tmp_path / "out")]) == 0
    assert capsys.readouterr().out.splitlines()[1].split()[:2] == ["1", "0"]


@pytest.mark.parametrize(
    ("kind", "at", "said"),
    [
        ("coulomb_friction", "shafts.rotor_shaft", "acts? at .* but at inertias; there act .*hysteresis"),
        ("backlash", "inertias.motor", "but at shafts; there act .*coulomb_friction"),
        ("dead_time", "inertias.motor", "but at inputs"),
    ],
)
def test_an_effect_at_the_wrong_kind_of_place(folder, capsys, kind, at, said):
    with (folder / "rig.toml").open("a", encoding="utf-8") as file:
        file.write(f'\n[[effects]]\nkind = "{kind}"\nat = "{at}"\n')
    assert main(["modes", "rig.toml"]) == 2
    assert re.search(said, capsys.readouterr().err)


def test_a_tolerance_of_the_response_error_in_per_cent_is_noted(folder, capsys):
    changed(folder, "case.toml", r"^\[response\]", "[response]\ntolerance = 10")
    assert main(["match", "case.toml", "--check"]) == 0
    assert "response.tolerance = 10 lets responses differ 2.2e+04 times; 0.1 is about 10 %" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("shaft", "said"),
    [
        ("stiffness = { value = 100, tolerance = 10 }", "tolerance: 10 is a half-width of 1000 %; write the relative"),
        ("length = 0.62\ndiameter = 27", 'shafts.ab.diameter: 27 m is longer than any shaft; write a unit: "27 mm"'),
        ("length = 620\ndiameter = 0.027", 'shafts.ab.length: 620 m is longer than any shaft; write a unit: "620 mm"'),
    ],
)
def test_of_a_shaft(tmp_path, capsys, shaft, said):
    model = f"[inertias.a]\nJ = 1\n[inertias.b]\nJ = 2\n[shafts.ab]\nbetween = ['a', 'b']\n{shaft}\n"
    (tmp_path / "model.toml").write_text(model, encoding="utf-8")
    assert main(["modes", str(tmp_path / "model.toml")]) == 2
    assert said in capsys.readouterr().err


def test_a_part_that_nothing_joins_is_noted(tmp_path, capsys):
    inertias = "".join(f"[inertias.{name}]\nJ = 1\n" for name in "abc")
    shafts = "[shafts.ab]\nbetween = ['a', 'b']\nstiffness = 50\n"
    shafts += "".join(f"[inputs.on_{name}]\non = '{name}'\n" for name in "ac")
    (tmp_path / "model.toml").write_text(inertias + shafts, encoding="utf-8")
    assert main(["modes", str(tmp_path / "model.toml")]) == 0
    assert "note: c: no shaft and no gear joins this to the rest" in capsys.readouterr().out
    whole = inertias + shafts + "[shafts.bc]\nbetween = ['b', 'c']\nstiffness = 50\n"
    (tmp_path / "model.toml").write_text(whole, encoding="utf-8")
    assert main(["modes", str(tmp_path / "model.toml")]) == 0
    assert "note" not in capsys.readouterr().out


@pytest.mark.parametrize("stated", ["600:6000rpm", "600rpm:6000", "600:6000 1/min", "62.83185307:628.3185307 rad/s"])
def test_the_unit_of_a_speed_may_stand_without_a_blank(stated):
    assert _speeds(stated)[[0, -1]] == pytest.approx([20 * np.pi, 200 * np.pi])
