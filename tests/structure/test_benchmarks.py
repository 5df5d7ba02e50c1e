"""The benchmarks keep up with the program, and one whose peer fails goes on."""

import importlib
import subprocess
from types import SimpleNamespace

import pytest
from structure.imports import ROOT

from tests.benchmarks import __main__ as benchmarks
from tests.benchmarks.row import peer_runs

SCRIPTS = sorted(path.stem for path in (ROOT / "tests" / "benchmarks").glob("[!_]*.py"))


@pytest.mark.parametrize("name", SCRIPTS)
def test_what_a_benchmark_imports_is_there(name):
    importlib.import_module(f"tests.benchmarks.{name}")


def test_a_peer_that_fails_is_named_and_the_benchmark_goes_on(capsys):
    after = []
    with peer_runs("roots by a peer"):
        raise ArithmeticError("Singular matrix")
    after.append("went on")
    assert after
    said = " ".join(capsys.readouterr().out.split())
    assert said == "roots by a peer the peer failed: ArithmeticError: Singular matrix"


def test_a_benchmark_that_fails_is_named_when_all_have_run(monkeypatch, capsys):
    ran = []

    def run(command, env):
        ran.append(command[-1].rpartition(".")[2])
        return SimpleNamespace(returncode=int(ran[-1] == "fmu_step"))

    monkeypatch.setattr(subprocess, "run", run)
    assert benchmarks.main() == 1
    assert set(ran) == set(SCRIPTS) - benchmarks.APART
    assert capsys.readouterr().out.endswith("failed: fmu_step\n")
