"""Another distribution is also called ``matching``: where it hides or overwrites ours, one line says so."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
COMMAND = "import sys, rigmatch; sys.exit(rigmatch.main())"
USE = "import rigmatch as rm; rm.load('vehicle.toml')"


def python(code: str, *words: str, path: Path) -> subprocess.CompletedProcess[str]:
    """Run code with a folder first on ``sys.path`` and the checkout after it."""
    surroundings = os.environ | {"PYTHONPATH": f"{path}{os.pathsep}{ROOT}"}
    return subprocess.run([sys.executable, "-P", "-c", code, *words], capture_output=True, text=True, env=surroundings)


def foreign_package(folder: Path, name: str, content: str) -> Path:
    (folder / name).mkdir(parents=True)
    (folder / name / "__init__.py").write_text(content)
    return folder


@pytest.mark.parametrize(
    ("name", "content"),
    [("matching", "__version__ = '1.4.3'\n"), ("modelling", "raise RuntimeError('needs a graph library')\n")],
)
def test_a_foreign_package_first_on_the_path_is_named_in_one_line(tmp_path: Path, name: str, content: str) -> None:
    foreign_package(tmp_path, name, content)
    done = python(COMMAND, "--version", path=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith(f"rigmatch: the package {name!r} in {tmp_path / name} is not rigmatch's")
    used = python(USE, path=tmp_path)
    assert used.returncode == 1
    assert used.stderr.splitlines()[-1] == f"ImportError: {done.stderr.strip()}"


def test_without_a_foreign_package_the_command_answers(tmp_path: Path) -> None:
    done = python(COMMAND, "--version", path=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("rigmatch ")
