"""The examples in the docstrings of the public functions give what they say."""

import doctest
import shutil
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

import rigmatch as rm

EXAMPLES = Path(__file__).parents[2] / "examples"
LONG = doctest.register_optionflag("LONG")  # more than a second
NAMES = [name for name in rm.__all__ if ">>>" in (getattr(rm, name).__doc__ or "")]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A working directory with the examples' small files."""
    place = tmp_path_factory.mktemp("examples")
    shutil.copytree(EXAMPLES, place / "examples", ignore=shutil.ignore_patterns("*.png", "*.py", "__pycache__"))
    return place


def run(name: str, long: bool) -> doctest.TestResults:
    test = doctest.DocTestFinder(recurse=False).find(getattr(rm, name), name, globs={"rm": rm})[0]
    for example in test.examples:
        if not long and example.options.get(LONG):
            example.options[doctest.SKIP] = True
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    report: list[str] = []
    outcome = runner.run(test, out=report.append)
    plt.close("all")
    assert outcome.failed == 0, "".join(report)
    return outcome


@pytest.mark.parametrize("name", NAMES)
def test_an_example_gives_what_it_says(name, folder, monkeypatch):
    monkeypatch.chdir(folder)
    run(name, long=False)


@pytest.mark.long
@pytest.mark.parametrize("name", ["match", "tolerance", "export"])
def test_a_long_example_gives_what_it_says(name, folder, monkeypatch):
    monkeypatch.chdir(folder)
    assert run(name, long=True).attempted


def test_every_public_function_has_an_example():
    assert [name for name in rm.__all__ if name not in (*NAMES, *rm.HOMES)] == []
