"""Tab completion of names in files, by the protocol a shell speaks."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from matching import commands as completion
from matching.commands import parameters_of_model, quantities_of_case
from matching.match.case_file import is_case, load_case
from matching.match.map import quantities
from modelling.bed.controllers import STRUCTURES
from modelling.model_file import load
from modelling.toml import read_toml

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


CASES = sorted(path for path in ROAD_TO_RIG.parent.glob("*/*.toml") if is_case(read_toml(path)))
MODELS = sorted(path for path in ROAD_TO_RIG.parent.glob("*/*.toml") if "inertias" in read_toml(path))


@pytest.mark.parametrize("path", CASES, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_names_are_those_that_a_map_accepts(path):
    """They are read from the files alone; here they are held against what the program makes of the files."""
    assert sorted(quantities_of_case(path)) == sorted(quantities(load_case(path)))


@pytest.mark.parametrize("name", STRUCTURES)
def test_every_control_structure_is_known(name):
    """Its quantities stand a second time in the file that imports nothing."""
    assert set(completion.STRUCTURES[name]) == set(STRUCTURES[name].quantities)


@pytest.mark.parametrize("path", MODELS, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_names_are_those_of_the_model(path):
    assert sorted(parameters_of_model(path)) == sorted(load(path).parameters)


def test_nothing_to_offer_is_silent(tmp_path):
    assert completions("rigmatch map missing.toml --x loop.", tmp_path) == set()
    assert completions(f"rigmatch map {ROAD_TO_RIG / 'rig.toml'} --x loop.", tmp_path) == set()


def test_help_says_how_to_switch_it_on():
    code = "from matching.cli import main; main(['--help'])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "register-python-argcomplete rigmatch" in done.stdout
