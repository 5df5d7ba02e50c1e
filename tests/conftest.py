"""What every test begins with."""

import faulthandler
import gc
import os

import matplotlib as mpl
import pytest
from hypothesis import settings

import matching  # noqa: F401  brings the views of results, whichever test runs first
from modelling.resources import restore_floating_point

TEAR_DOWN_SECONDS = 3  # of a test that failed; then its process ends and says where
mpl.use("agg")  # no display, whatever the machine has
settings.register_profile("repeatable", derandomize=True, deadline=None)  # `make test`: the same examples every time
settings.register_profile("search", deadline=None, max_examples=1000)  # on request: new ones each time
settings.load_profile("repeatable")


@pytest.fixture(autouse=True)
def ieee_arithmetic() -> None:
    """Hypothesis refuses to work where a library that an earlier test called left small numbers flushed to zero."""
    restore_floating_point()


def pytest_configure(config) -> None:
    config.standard_error = os.dup(2)  # nothing is captured yet


@pytest.hookimpl(trylast=True)
def pytest_exception_interact(node) -> None:
    """With a failure the limits of pytest-timeout and of faulthandler end: its tear-down gets another."""
    if isinstance(node, pytest.Item):
        faulthandler.dump_traceback_later(TEAR_DOWN_SECONDS, exit=True, file=node.config.standard_error)


def pytest_collection_finish() -> None:
    """What is loaded by now stays: the collector of circular garbage need not walk through it again and again."""
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)


def pytest_terminal_summary(terminalreporter, config) -> None:
    """How to repeat the order of this run, also where ``-q`` hides the header."""
    if (seed := config.getoption("randomly_seed", None)) is not None:
        terminalreporter.write_line(f"order of the tests: -p randomly --randomly-seed={seed}")
