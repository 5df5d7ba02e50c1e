"""What is installed is complete: every file of the program, and the command."""

from zipfile import ZipFile

import pytest
from hatchling.builders.wheel import WheelBuilder
from structure.imports import PACKAGES, ROOT


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
