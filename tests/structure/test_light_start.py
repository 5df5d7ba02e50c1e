"""Help, version and Tab completion come at once: no library that computes or draws is imported for them."""

import subprocess
import sys

import pytest
from structure.imports import ROOT

from matching.commands import COMMANDS

HEAVY = {"casadi", "jinja2", "matplotlib", "numpy", "pint", "scipy", "sympy"}
BEDS = ROOT / "examples" / "road_to_rig"


def imported(code: str) -> set[str]:
    """Heavy libraries that a fresh process has after some code."""
    last = f"import sys; print(*sorted({HEAVY!r} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", f"{code}\n{last}"], capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split())


def test_help_and_version():
    calls = [["--help"], ["--version"], *([name, "--help"] for name in COMMANDS)]
    assert imported(f"from rigmatch import main\nfrom matching.cli import main\nfor c in {calls!r}: main(c)") == set()


@pytest.mark.parametrize(("function", "file"), [("parameters_of_model", "rig"), ("quantities_of_case", "case")])
def test_names_for_completion(function, file):
    path = str(BEDS / f"{file}.toml")
    assert imported(f"from matching.commands import {function}\nassert len({function}({path!r})) > 10") == set()


def test_reading_a_model_waits_neither_for_all_units_of_the_world_nor_for_slow_parts_of_scipy():
    """``scipy.signal`` and ``scipy.stats`` take a second; nearly no command needs them to begin."""
    code = f"import rigmatch as rm\nrm.load({str(BEDS / 'rig.toml')!r})\nread = {HEAVY!r} & set(sys.modules)"
    code += "\nassert read <= {'numpy', 'scipy', 'sympy'}\nimport modelling.modal.modes, matching.match.match"
    imported(f"import sys\n{code}\nassert not {{'scipy.signal', 'scipy.stats'}} & set(sys.modules)")
