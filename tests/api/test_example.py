"""The example of the Python face runs, with its asserted numbers, and leaves its figures."""

import runpy
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "examples" / "python_api" / "run.py"


def test_the_example_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [str(SCRIPT), str(tmp_path)])
    runpy.run_path(str(SCRIPT), run_name="__main__")
    assert {path.name for path in tmp_path.iterdir()} == {"modes.png", "response.png", "fidelity.png", "shuffle.svg"}
    assert "side shafts twice as stiff" in capsys.readouterr().out


@pytest.mark.long
def test_the_example_of_a_gear_change_runs(tmp_path, monkeypatch, capsys):
    script = SCRIPT.parents[1] / "gear_change" / "run.py"
    monkeypatch.setattr(sys, "argv", [str(script), str(tmp_path)])
    runpy.run_path(str(script), run_name="__main__")
    assert (tmp_path / "gear_change.png").exists()
    assert "fault: none" in capsys.readouterr().out
