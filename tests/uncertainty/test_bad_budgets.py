"""Bad budgets get one clear line each, from the reader and from the command line."""

import copy

import pytest

from matching.uncertainty.budget import budget_from_tables, read_budget
from matching.uncertainty.evaluate import evaluate
from modelling.errors import InputError

GOOD = {
    "measurand": {"name": "M", "unit": "N*m", "formula": "F*r"},
    "inputs": {
        "F": {"value": 100, "unit": "N", "uncertainty": 0.5},
        "r": {"value": 0.3, "unit": "m", "half_width": 1e-3},
    },
}


def changed(path, value):
    tables = copy.deepcopy(GOOD)
    *folders, last = path.split("/")
    place = tables
    for folder in folders:
        place = place.setdefault(folder, {})
    place[last] = value
    return tables


def test_the_good_one_is_good():
    assert evaluate(budget_from_tables(GOOD), draws=20_000).measurands[0].propagation.value == pytest.approx(30)


@pytest.mark.parametrize(
    "formula",
    [
        "__import__('os').system('true')",
        "F*r if F else r",
        "[F][0]*r",
        "F.real*r",
        "(lambda: F)()*r",
        "open('x')",
        "F*r; r",
        "eval('F')",
        "F*r*f'{r}'",
        "F*r*True",
        "F*r*1j",
        "exec(F)",
        "F*r and F",
        "F @ r",
        "F < r",
        "'F'",
        "r*sin(F, r)",
        "",
        "F*r + sin",
        "sin(x=r)",
        "F*unknown",
        "9**9**9**9*F*r",
        "F*r**1000",
        "F/0*r",
        "F*r*log(0)",
        "F*r*sqrt(-1)",
        "F*r*asin(2)",
        "(" * 300 + "F" + ")" * 300,
        "F*r*" * 4000 + "1",
        "F*r*2e400",
        "F*r\x00",
        "*F",
        "F*r*max(1, 2)",
    ],
)
def test_formula_with_anything_but_mathematics(formula):
    with pytest.raises(InputError, match="formula") as caught:
        budget_from_tables(changed("measurand/formula", formula))
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ("measurand/unit", "N", "but the unit N is"),
        ("measurand/unit", "furlongs_per", "unknown unit"),
        ("inputs/F/unit", "m^9^9^9^9", "unknown unit"),
        ("inputs/F/unit", 5, "must be text"),
        ("measurand/formula", "F + r", "cannot be added"),
        ("measurand/formula", "F*r*sin(F)", "must be a plain number"),
        ("measurand/colour", "red", "'colour' does not exist"),
        ("inputs/F/value", float("nan"), "no finite number"),
        ("inputs/F/value", "100", "no finite number"),
        ("inputs/F/value", True, "no finite number"),
        ("inputs/F/uncertainty", -1, "too small"),
        ("inputs/F/half_width", 1, "given together"),
        ("inputs/F/distribution", "gaussian", "'gaussian' does not exist; known are"),
        ("inputs/F/distribution", "t", "needs degrees_of_freedom"),
        ("inputs/F/beta", 0.5, "trapezoidal"),
        ("inputs/F/degrees_of_freedom", 0, "not positive"),
        ("inputs/F/readings", [1.0, 2.0], "beside readings"),
        ("inputs/F/coverage_factor", 2, "no coverage_factor"),
        ("inputs/F/valeu", 1, "'valeu' does not exist; did you mean 'value'"),
        ("inputs/r", {"unit": "m", "readings": [0.3]}, "at least 2"),
        ("inputs/r", {"unit": "m", "readings": [0.3, float("nan")]}, "reading 2 is nan"),
        ("inputs/r", {"unit": "m", "value": 0.3, "simultaneous": "x"}, "is for readings"),
        ("inputs/r", {"unit": "m", "value": 0.3, "distribution": "normal", "half_width": 0.1}, "needs coverage_factor"),
        ("inputs/r", 0.3, "is no table"),
        ("inputs/lambda", {"value": 1}, "cannot stand in a formula"),
        ("inputs/sin", {"value": 1}, "cannot stand in a formula"),
        ("inputs", {}, "there are no inputs"),
        ("coverage", 1.5, "no probability"),
        ("coverage_factor", 0, "not positive"),
        ("coverage_factor", 1.7e308, "too large; give at most 1e+06"),
        ("coverage_factor", 1e-300, "too small; give at least 1e-06"),
        ("correlations", [{"between": ["F", "x"], "r": 0.5}], "no pair of inputs"),
        ("correlations", [{"between": ["F", "r"], "r": 1.5}], "r = 1.5"),
        ("correlations", [{"between": ["F", "r"], "r": 0.5}, {"between": ["r", "F"], "r": 0.5}], "twice"),
        ("correlations", [{"between": ["F", "F"], "r": 0.5}], "no pair"),
        ("correlations", 0.5, "is no list"),
        ("measurands", {"a": {"formula": "F*r", "unit": "N*m"}}, "either [measurand] or [measurands"),
        ("lines/cal", {"abscissa": [1, 2, 3], "ordinate": [1, 2]}, "at least 3"),
        ("lines/cal", {"abscissa": [1, 1, 1], "ordinate": [1, 2, 3]}, "all readings are equal"),
    ],
)
def test_one_line_errors(path, value, words):
    with pytest.raises(InputError) as caught:
        budget_from_tables(changed(path, value))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
    table = "budget: " + ".".join(path.split("/")[:-1])  # the key that is wrong, its table, or one of its keys
    assert caught.value.where.startswith(table.removesuffix(": "))
    assert all(part.isidentifier() for part in caught.value.where.removeprefix("budget: ").split("."))
    assert "None" not in caught.value.where


def test_invalid_correlation_matrix():
    inputs = {name: {"value": 0, "uncertainty": 1} for name in "abc"}
    pairs = [{"between": list(pair), "r": r} for pair, r in (("ab", 0.9), ("bc", 0.9), ("ac", -0.9))]
    with pytest.raises(InputError, match="no quantities can be correlated like this"):
        budget_from_tables({"measurand": {"formula": "a+b+c"}, "inputs": inputs, "correlations": pairs})


def test_unreachable_correlation_of_shapes():
    inputs = {"a": {"value": 0, "half_width": 1, "distribution": "arcsine"}, "b": {"value": 0, "uncertainty": 1}}
    budget = budget_from_tables(
        {"measurand": {"formula": "a+b"}, "inputs": inputs, "correlations": [{"between": ["a", "b"], "r": 1.0}]}
    )
    with pytest.raises(InputError, match="cannot be reached"):
        evaluate(budget)


def test_unequal_simultaneous_readings():
    tables = {
        "measurand": {"formula": "a+b"},
        "inputs": {
            "a": {"readings": [1, 2, 3], "simultaneous": "run"},
            "b": {"readings": [1, 2], "simultaneous": "run"},
        },
    }
    with pytest.raises(InputError, match="differ in number"):
        budget_from_tables(tables)


@pytest.mark.parametrize(("formula", "value"), [("log(x)", -1.0), ("1/x", 0.0), ("sqrt(x)", 0.0), ("asin(x)", 2.0)])
def test_no_finite_value_at_the_estimates(formula, value):
    budget = budget_from_tables(
        {"measurand": {"formula": formula}, "inputs": {"x": {"value": value, "uncertainty": 0.1}}}
    )
    with pytest.raises(InputError, match="no finite real value"):
        evaluate(budget)


def test_no_finite_value_for_some_draws():
    budget = budget_from_tables(
        {"measurand": {"formula": "sqrt(x)"}, "inputs": {"x": {"value": 0.1, "uncertainty": 0.1}}}
    )
    with pytest.raises(InputError, match="draws"):
        evaluate(budget)


@pytest.mark.parametrize(("width", "draws"), [(1.7e308, False), (1.7e308, True), (1e151, True), (1e60, False)])
def test_an_uncertainty_whose_square_is_no_number_counts_without_a_first_derivative_too(width, draws):
    """Of x·y at y = 0, ∂/∂x = 0; of 1e200·x² at x = 0 too, whose bias is 1e200·u²."""
    formula, x = ("x*y", 1.0) if width > 1e100 else ("1e200*x**2 + y", 0.0)
    inputs = {"x": {"value": x, "half_width": width}, "y": {"value": 0.0, "uncertainty": 1.0}}
    budget = budget_from_tables({"measurand": {"formula": formula}, "inputs": inputs})
    with pytest.raises(InputError, match="too large for a number"):
        evaluate(budget, draws=100, with_monte_carlo=draws)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("a = ", "line 1: a has no value"),
        (None, "does not exist"),
        (b"a\xff", "is not UTF-8"),
        (b"\xff\xfe", "is saved as UTF-16"),
    ],
)
def test_files(tmp_path, content, words):
    path = tmp_path / "budget.toml"
    if content is not None:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError, match=words):
        read_budget(path)


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ("inputs/F/value", [[[1]]], "[[[1]]] is no finite number"),
        ("inputs/F/value", 10**400, "is no finite number"),
        ("inputs/F", {"readings": [[1, 2], [3]], "unit": "N"}, "reading 1 is [1, 2]"),
        ("measurand/name", "a\x00b", "a name that nobody can read"),
        ("measurand/name", "x" * 101, "a name that nobody can read"),
        ("measurand/name", "", "a name that nobody can read"),
    ],
)
def test_values_and_names_that_are_none(path, value, words):
    with pytest.raises(InputError) as error:
        budget_from_tables(changed(path, value))
    assert words in str(error.value)
