"""The command ``rigmatch match``."""

import json
from pathlib import Path
from types import SimpleNamespace

import pytest
from result_schema import check_schema

from matching.cli import _answer, main
from matching.match.case_file import load_case

CASE = Path(__file__).parents[2] / "examples" / "road_to_rig" / "case.toml"


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["nowhere.toml"], "nowhere.toml"),
        ([str(CASE), "--starts", "0"], "less than 1"),
        ([str(CASE), "--seed", "first"], "no whole number"),
    ],
)
def test_wrong_calls_are_one_line_and_nothing_is_written(words, says, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["match", *words, "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert says in error
    assert not out.exists()


def test_a_wrong_case_file_is_named(tmp_path, capsys):
    bad = tmp_path / "case.toml"
    same = f'"{CASE.parent / "rig.toml"}"'  # as vehicle and as rig: nothing is left to emulate
    bad.write_text(CASE.read_text().replace('"vehicle.toml"', same).replace('"rig.toml"', same))
    assert main(["match", str(bad), "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert f"{bad}: rig" in error
    assert not (tmp_path / "out").exists()


def test_the_case_that_new_writes_is_matched_with_report_figures_and_files_to_read_again(tmp_path, capsys):
    """With the adapter as it is: what to order takes a match for every value tried."""
    assert main(["new", str(tmp_path / "mine")]) == 0
    capsys.readouterr()
    out, file = tmp_path / "out", tmp_path / "mine" / "case.toml"
    adapter = '"rig.shafts.flange.stiffness" = { lower = 2e5, upper = 8e5 }'
    assert adapter in file.read_text()
    file.write_text(file.read_text().replace(adapter, ""))
    assert main(["match", str(file), "--starts", "1", "--beds", "20", "--out", str(out)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= 20
    assert lines[-1] == f"report: {out / 'report.html'}"
    result = json.loads((out / "result.json").read_text())
    assert result["made_by"]["case"] == str(tmp_path / "mine" / "case.toml")
    assert result["status"] == "matched"
    check_schema("match", result)
    assert result["stable"]
    target = result["targets"][0]
    assert target["matched"] == pytest.approx(target["vehicle"], rel=0.01)
    assert target["seen_in_simulation"] == pytest.approx(target["vehicle"], rel=0.02)
    assert (out / "report.html").read_text().startswith("<!doctype html>")
    assert (out / "figures" / "overview.svg").exists()
    again = load_case(out / "case.toml")
    tuned = {own["name"]: own["tuned"] for own in result["parameters"]}
    assert {move.name: move.start for move in again.moves} == pytest.approx(tuned)


def test_the_screen_names_the_report_though_other_pages_stand_next_to_it():
    """An order sheet is written before it."""
    result = {"files": ["order_sheet.html", "case.toml", "report.html"]}
    command = SimpleNamespace(run=lambda _: result, told=lambda *_: "MATCHED", defect=lambda _: False)
    assert _answer(command, SimpleNamespace(json=False, out="out")) == ("MATCHED\nreport: out/report.html", 0)
