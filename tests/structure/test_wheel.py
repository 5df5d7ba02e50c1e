"""What is installed is complete: every file of the program, and the command."""

import os
import subprocess
import sys
import sysconfig
from pathlib import Path
from zipfile import ZipFile

import pytest
from hatchling.builders.wheel import WheelBuilder
from structure.imports import PACKAGES, ROOT

from modelling.errors import VERSION


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    (path,) = WheelBuilder(str(ROOT)).build(directory=str(tmp_path_factory.mktemp("wheel")), versions=["standard"])
    with ZipFile(path) as file:
        yield file


def test_the_wheel_holds_every_file_of_the_program_and_no_other(wheel):
    """Templates, C sources and tables too, not Python alone."""
    files = [path for package in PACKAGES for path in (ROOT / package).rglob("*") if path.is_file()]
    program = {str(path.relative_to(ROOT)) for path in files if "__pycache__" not in path.parts} | {"rigmatch.py"}
    assert {name.rpartition(".")[2] for name in program} > {"py", "c", "html"}
    assert {name for name in wheel.namelist() if ".dist-info/" not in name} == program


def test_the_wheel_brings_the_command(wheel):
    (entry_points,) = [name for name in wheel.namelist() if name.endswith(".dist-info/entry_points.txt")]
    assert "rigmatch = rigmatch:main" in wheel.read(entry_points).decode()


@pytest.mark.long
def test_the_wheel_runs_in_a_clean_environment(tmp_path):
    """Installed by pip into an environment of its own; of this one it sees other packages, not the folder."""
    (path,) = WheelBuilder(str(ROOT)).build(directory=str(tmp_path / "built"), versions=["standard"])
    made = tmp_path / "clean"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", made], check=True)
    python = made / "bin" / "python"
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", f"--python={python}", "install", "--quiet"]
    subprocess.run([*pip, "--no-deps", "--no-index", path], check=True)
    (packages,) = made.glob("lib/*/site-packages")
    (packages / "others.pth").write_text(f"{sysconfig.get_paths()['purelib']}\n")  # no .pth file in there is followed
    environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}

    def said(*words):
        done = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout

    command = made / "bin" / "rigmatch"
    place = Path(said(python, "-c", "import matching; print(matching.__file__)").strip())
    assert place.is_relative_to(made)
    assert said(command, "--version").strip() == f"rigmatch {VERSION}"
    said(command, "new", "first")
    said(command, "match", "first/case.toml", "--check", "--out", "out")
    assert "2" in said(command, "modes", "first/vehicle.toml")


def test_version_date_and_changelog_agree():
    citation, changes = ((ROOT / name).read_text() for name in ("CITATION.cff", "CHANGELOG.md"))
    assert f"\nversion: {VERSION}\n" in citation
    assert f"\n## {VERSION} (" in changes
    assert "Unreleased" not in changes or changes.index("Unreleased") < changes.index(f"## {VERSION}")
    assert "\ndate-released: 2" in citation


def test_the_pythons_that_are_claimed_are_those_that_nox_runs():
    claimed = [
        line.split(":: ")[-1].rstrip('",')
        for line in (ROOT / "pyproject.toml").read_text().splitlines()
        if "Programming Language :: Python :: 3." in line
    ]
    listed = (ROOT / "noxfile.py").read_text().partition("PYTHONS = (")[2].partition(")")[0]
    assert claimed == [text.strip().strip('"') for text in listed.split(",")]
