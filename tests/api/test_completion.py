"""Tab completion of names in files, by the protocol a shell speaks."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROAD_TO_RIG = Path(__file__).parents[2] / "examples" / "road_to_rig"


def completions(line, tmp_path):
    found = tmp_path / "found"
    asked = {
        "_ARGCOMPLETE": "1", "_ARGCOMPLETE_STDOUT_FILENAME": str(found), "_ARGCOMPLETE_IFS": "\n",
        "COMP_LINE": line, "COMP_POINT": str(len(line)),
    }  # fmt: skip
    code = "from matching.cli import main; main([])"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env={**os.environ, **asked}, check=False
    )
    assert done.stderr == ""
    return {word.strip() for word in found.read_text().split("\n")} - {""}


@pytest.mark.parametrize("option", ["--x", "--y"])
def test_quantities_of_a_case(option, tmp_path):
    found = completions(f"rigmatch map {ROAD_TO_RIG / 'case.toml'} {option} loop.de", tmp_path)
    assert found == {"loop.dead_time"}


def test_quantities_that_may_have_a_tolerance(tmp_path):
    found = completions(f"rigmatch tolerance {ROAD_TO_RIG / 'case.toml'} --tolerance loop.de", tmp_path)
    assert found == {"loop.dead_time="}


def test_parameters_of_a_model(tmp_path):
    found = completions(f"rigmatch modes {ROAD_TO_RIG / 'rig.toml'} --change inertias.motor.", tmp_path)
    assert found == {"inertias.motor.J=", "inertias.motor.drag="}


def test_nothing_to_offer_is_silent(tmp_path):
    assert completions("rigmatch map missing.toml --x loop.", tmp_path) == set()
    assert completions(f"rigmatch map {ROAD_TO_RIG / 'rig.toml'} --x loop.", tmp_path) == set()


def test_help_says_how_to_switch_it_on():
    code = "from matching.cli import main; main(['--help'])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "register-python-argcomplete rigmatch" in done.stdout
