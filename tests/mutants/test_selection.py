"""Faults in what other processes alone run are tried with the tests that name it."""

from types import SimpleNamespace

import pytest

from tests.mutants import selection


@pytest.mark.parametrize(
    ("file", "test"),
    [
        ("matching/supervision.py", "tests/ground/test_supervision.py"),
        ("modelling/measurement/readers/child.py", "tests/readers/test_reading_apart.py"),  # named by apart.py alone
    ],
)
def test_what_no_recorded_test_runs_has_the_tests_that_name_it(file, test):
    recorded = [f"{test}::test_it", "tests/other.py::test_it"]
    unseen = SimpleNamespace(of=lambda *_: set(), by_line={file: {}}, tests=recorded)
    assert selection.tests_for(SimpleNamespace(file=file, lines=(1, 1), constant=None), unseen) == {f"{test}::test_it"}


def test_a_file_that_nobody_names_has_none():
    assert selection.naming("matching/no_such_file.py") == set()
