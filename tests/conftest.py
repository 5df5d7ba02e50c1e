"""What every test begins with."""

import gc

import kept_lists
import matplotlib as mpl
import pytest
from hypothesis import settings
from kept_words import same_line

import matching  # noqa: F401  brings the views of results, whichever test runs first
from modelling import interruption as floating_point

mpl.use("agg")  # no display, whatever the machine has
settings.register_profile("repeatable", derandomize=True, deadline=None)  # `make test`: the same examples every time
settings.register_profile("search", deadline=None, max_examples=1000)  # on request: new ones each time
settings.load_profile("repeatable")


@pytest.fixture(autouse=True)
def ieee_arithmetic() -> None:
    """Hypothesis refuses to work where a library that an earlier test called left small numbers flushed to zero."""
    floating_point.restore()


@pytest.fixture
def kept_line(request):
    """Compare an error with the line that is kept under the test's name; of paths given beside it only their names."""

    def compare(error, *places) -> None:
        line = str(getattr(error, "value", error))
        same_line(request.node.nodeid.removeprefix("tests/").replace("/", " / "), line, *places)

    return compare


def pytest_addoption(parser) -> None:
    parser.addoption("--renew-kept", action="store_true", help="write the lists in tests/kept anew (make kept)")


def pytest_configure(config) -> None:
    kept_lists.renewing = config.getoption("renew_kept")
    if kept_lists.renewing and config.getoption("numprocesses", None):
        raise pytest.UsageError("--renew-kept works in one process: leave out -n")


def pytest_collection_modifyitems(config, items) -> None:
    if config.getoption("renew_kept"):
        items[:] = [test for test in items if kept_lists.compares(test)]


def pytest_sessionfinish(session, exitstatus) -> None:
    if kept_lists.renewing:
        complete = exitstatus == pytest.ExitCode.OK and session.config.args == session.config.getini("testpaths")
        changed = kept_lists.write(complete)
        print("\nchanged, see git diff:", *changed) if changed else print("\nthe kept lists are as they were")


def pytest_collection_finish() -> None:
    """What is loaded by now stays: the collector of circular garbage need not walk through it again and again."""
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)


def pytest_terminal_summary(terminalreporter, config) -> None:
    """How to repeat the order of this run, also where ``-q`` hides the header."""
    if (seed := config.getoption("randomly_seed", None)) is not None:
        terminalreporter.write_line(f"order of the tests: -p randomly --randomly-seed={seed}")
