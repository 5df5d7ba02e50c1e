"""Ctrl-C while the program is being loaded: one line, exit code 130."""

import os
import runpy
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]


class Loading(ModuleType):
    """A module in whose loading Ctrl-C falls."""

    def __getattr__(self, name):
        raise KeyboardInterrupt


def test_an_interrupt_before_the_command_begins_is_one_line(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "rigmatch", Loading("rigmatch"))
    with pytest.raises(SystemExit) as end:
        runpy.run_module("matching", run_name="__main__")
    assert end.value.code == 130
    assert capsys.readouterr().err == "rigmatch: interrupted\n"


def started(folder, *words):
    """Python, where the first import of the package ``modelling`` is interrupted."""
    (folder / "modelling").mkdir()
    (folder / "modelling" / "__init__.py").write_text("raise KeyboardInterrupt\n")
    path = os.pathsep.join([str(folder), str(ROOT)])
    return subprocess.run(
        [sys.executable, *words], cwd=folder, env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True
    )


def test_an_interrupt_while_the_package_itself_is_imported_is_one_line(tmp_path):
    done = started(tmp_path, "-m", "matching", "--version")
    assert (done.returncode, done.stderr.splitlines()) == (130, ["rigmatch: interrupted"])


def test_whoever_imports_the_package_gets_the_interrupt(tmp_path):
    done = started(tmp_path, "-c", "import matching")
    assert done.returncode != 0
    assert "KeyboardInterrupt" in done.stderr
