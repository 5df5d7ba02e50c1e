"""Which test runs which line: a pytest plugin (``-p tests.mutants.coverage_map``) that writes one JSON row a test.

A row holds the test's name, its processor time, whether it passed, and the lines it ran, by file. Lines run in a
fixture of a module or session count for every test that uses the fixture, and the program's function caches are emptied
before each test, so a row holds what the test runs when it is alone in a process. Lines run in other processes are not
recorded. Tests that have a row already are not run again, so that a stopped run goes on.
"""

import functools
import os
import sys
from collections import defaultdict
from pathlib import Path

import coverage
import pytest

from tests.mutants.rows import append, rows

ROOT = Path(__file__).parents[2]
PACKAGES = ("modelling", "matching")

Lines = dict[str, set[int]]


class Recorder:
    """Traces each test by itself."""

    def __init__(self, folder: Path, worker: str):
        self.path = folder / f"map-{worker}.jsonl"
        self.known = {row["test"] for path in folder.glob("map-*.jsonl") for row in rows(path)}
        self.tracer = coverage.Coverage(
            data_file=None, config_file=False, source=[str(ROOT / name) for name in PACKAGES], messages=False
        )
        self.tracer.set_option("run:disable_warnings", ["no-data-collected"])
        self.lines: Lines = {}
        self.shared: dict[tuple, Lines] = {}  # run by a fixture that several tests use
        self.passed = True

    def collect(self) -> Lines:
        """Lines run since the tracer was last started; stops it."""
        self.tracer.stop()
        data = self.tracer.get_data()
        lines = {name: set(data.lines(name) or ()) for name in data.measured_files()}
        self.tracer.erase()
        return {str(Path(name).relative_to(ROOT)): found for name, found in lines.items() if found}

    def pytest_collection_modifyitems(self, items) -> None:
        items[:] = [item for item in items if item.nodeid not in self.known]

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item):
        empty_caches()
        self.lines, self.passed, began = {}, True, processor_seconds()
        self.tracer.start()
        try:
            return (yield)
        finally:
            add(self.lines, self.collect())
            for name in item.fixturenames:
                for scope in ("module", "session"):
                    add(self.lines, self.shared.get(fixture_key(name, item, scope), {}))
            seconds = round(processor_seconds() - began, 3)
            lines = {name: sorted(found) for name, found in sorted(self.lines.items())}
            row = {"test": item.nodeid, "seconds": seconds, "passed": self.passed, "lines": lines}
            append(self.path, row)

    def pytest_runtest_logreport(self, report) -> None:
        self.passed &= report.passed

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef, request):
        if fixturedef.scope == "function":
            return (yield)
        add(self.lines, self.collect())
        self.tracer.start()
        try:
            return (yield)
        finally:
            run = self.collect()
            key = fixture_key(fixturedef.argname, request._pyfuncitem, fixturedef.scope)
            add(self.shared.setdefault(key, {}), run)
            add(self.lines, run)
            self.tracer.start()


def pytest_configure(config) -> None:
    folder = Path(os.environ["MUTANTS_MAP"])
    if "PYTEST_XDIST_WORKER" in os.environ or not config.getoption("numprocesses", None):
        config.pluginmanager.register(Recorder(folder, os.environ.get("PYTEST_XDIST_WORKER", "main")))


def processor_seconds() -> float:
    """Of this process and its ended children: the machine may be busy with other things."""
    return sum(os.times()[:4])


def add(lines: Lines, more: Lines) -> None:
    for name, found in more.items():
        lines.setdefault(name, set()).update(found)


def fixture_key(name: str, item, scope: str = "module") -> tuple:
    """A fixture that several tests use, with its parameter; one of a session is the same in every module."""
    spec = getattr(item, "callspec", None)
    return name, "" if scope == "session" else str(item.path), spec.indices.get(name) if spec else None


def empty_caches() -> None:
    """Function caches of the program forget, so that what they hold is computed again by the next test."""
    for module in [module for name, module in sys.modules.items() if name.startswith(PACKAGES)]:
        for thing in vars(module).values():
            if isinstance(thing, functools._lru_cache_wrapper):
                thing.cache_clear()


class Map:
    """The tests of a line, the cheapest and most particular first."""

    def __init__(self, folder: Path):
        found = {row["test"]: row for path in sorted(folder.glob("map-*.jsonl")) for row in rows(path)}
        self.tests = {name: row for name, row in found.items() if row["passed"]}
        self.failed = sorted(found.keys() - self.tests.keys())
        self.seconds = {name: row["seconds"] for name, row in self.tests.items()}
        self.size = {name: sum(map(len, row["lines"].values())) for name, row in self.tests.items()}
        self.by_line: dict[str, dict[int, set[str]]] = defaultdict(lambda: defaultdict(set))
        for name, row in self.tests.items():
            for file, lines in row["lines"].items():
                for line in lines:
                    self.by_line[file][line].add(name)

    def forget(self, test: str) -> None:
        """A test that cannot be relied on is not chosen any more."""
        for lines in self.by_line.values():
            for tests in lines.values():
                tests.discard(test)

    def of(self, file: str, lines: range) -> set[str]:
        """Tests that run any of these lines."""
        return set().union(*(self.by_line[file].get(line, ()) for line in lines))

    def ordered(self, tests: set[str], seconds: float) -> list[str]:
        """The tests that most likely notice a fault for the time they take, up to a total time."""
        chosen, total = [], 0.0
        for name in sorted(tests, key=lambda name: ((0.02 + self.seconds[name]) * self.size[name], name)):
            if total + self.seconds[name] <= seconds:
                chosen.append(name)
                total += self.seconds[name]
        return chosen
