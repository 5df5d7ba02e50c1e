"""Faults in what other processes alone run are tried with the tests that name it."""

from types import SimpleNamespace

import pytest

selection = pytest.importorskip("tests.mutants.selection", reason="coverage comes with `make mutants`")


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


def test_what_a_class_says_of_itself_is_asked_by_the_tests_that_name_it(tmp_path):
    (tmp_path / "test_a.py").write_text("assert law.abrupt\n")
    (tmp_path / "test_b.py").write_text("abruptly = 1\n")
    tests = ["test_a.py::test_one", "test_a.py::test_two[x]", "test_b.py::test_one", "test_gone.py::test_one"]
    assert selection.asking("abrupt", tests, tmp_path) == {"test_a.py::test_one", "test_a.py::test_two[x]"}


def test_what_survives_is_tried_with_the_tests_that_name_its_module_too():
    line = "tests/report/test_line.py::test_it"
    recorded = [line, "tests/ground/test_memory_limits.py::test_it", "tests/other.py::test_it"]
    seen = SimpleNamespace(of=lambda *_: {line}, by_line={}, tests=recorded)
    fault = SimpleNamespace(file="modelling/common/memory_limits.py", lines=(52, 52), constant=None)
    assert selection.tests_for(fault, seen) == {line}
    assert selection.further_tests_for(fault, seen) == {line, "tests/ground/test_memory_limits.py::test_it"}
