"""What a user types as the uncertainty wanted, and what is said where it or a formula is wrong."""

import pytest

from matching.uncertainty.budget import budget_from_tables, parse_formula
from matching.uncertainty.propagate import required, wanted_uncertainty
from modelling.errors import InputError


@pytest.fixture(scope="module")
def torque():
    inputs = {"x": {"value": 1.0, "unit": "N*m", "uncertainty": 0.1}}
    return budget_from_tables({"measurand": {"formula": "x", "unit": "N*m"}, "inputs": inputs}).measurands[0]


@pytest.mark.parametrize(("text", "si"), [("0.5", 0.5), ("0.5 N*m", 0.5), ("0.5 kN*m", 500.0), (" 20 mN*m ", 0.02)])
def test_wanted_uncertainty_in_si(torque, text, si):
    assert wanted_uncertainty(text, torque) == pytest.approx(si, rel=1e-12)


@pytest.mark.parametrize(("text", "wrong"), [
    ("0.5 N", "'0.5 N' has another dimension"),
    ("many N*m", "'many N*m' is no quantity"),
])  # fmt: skip
def test_a_wrong_wanted_uncertainty_is_named(torque, text, wrong):
    with pytest.raises(InputError) as error:
        wanted_uncertainty(text, torque, "torque.toml")
    assert error.value.where == "torque.toml: wanted uncertainty"
    assert error.value.wrong.startswith(wrong)
    assert "N*m" in error.value.right


@pytest.mark.parametrize(("formula", "wrong", "right"), [
    ("x.real", "'x.real' is not mathematics", "use numbers"),
    ("x + y", "'y' is not among the inputs", "known are x and pi"),
    ("x + 1e301", "a number is too large", "stay below 1e300"),
    ("x / 0", "the formula divides by zero", "correct"),
    ("open(x)", "'open' is no function of mathematics", "known are"),
    ("x +", "'x +' is no formula", "write it like"),
])  # fmt: skip
def test_a_wrong_formula_is_named(formula, wrong, right):
    with pytest.raises(InputError) as error:
        parse_formula(formula, ["x"], "torque.toml: formula")
    assert error.value.where == "torque.toml: formula"
    assert error.value.wrong.startswith(wrong)
    assert error.value.right.startswith(right)


def test_what_is_reached_already_needs_no_improvement():
    budget = budget_from_tables({"measurand": {"formula": "x"}, "inputs": {"x": {"value": 1.0, "uncertainty": 0.1}}})
    found = required(budget, budget.measurands[0], 1.0)
    assert (found.wanted, found.alone, found.together) == (1.0, (), None)
    assert found.present == pytest.approx(1.96 * 0.1, rel=1e-4)


@pytest.fixture(scope="module")
def sum_of_two():
    """y = a + b in mm with u(a) = 4 mm, u(b) = 3 mm and k = 2: U = 2·5 mm."""
    inputs = {
        name: {"value": 1.0, "unit": "mm", "uncertainty": u, "distribution": "normal"}
        for name, u in (("a", 4.0), ("b", 3.0))
    }
    for table in inputs.values():
        table["expanded_uncertainty"], table["coverage_factor"] = table.pop("uncertainty"), 1.0
    tables = {"coverage_factor": 2.0, "measurand": {"formula": "a + b", "unit": "mm"}, "inputs": inputs}
    return budget_from_tables(tables)


def test_what_one_input_alone_must_become(sum_of_two):
    """U = 9 mm leaves u² = 4.5² mm²: a to √(4.5² − 3²) mm, which is nearer to what it is, or b to √(4.5² − 4²) mm."""
    answer = required(sum_of_two, sum_of_two.measurands[0], 9e-3)
    assert (answer.present, answer.wanted) == (pytest.approx(10e-3, rel=1e-9), 9e-3)
    assert [improvement.needed for improvement in answer.alone] == [
        {"a": pytest.approx(1e-3 * (4.5**2 - 3**2) ** 0.5, rel=1e-9)},
        {"b": pytest.approx(1e-3 * (4.5**2 - 4**2) ** 0.5, rel=1e-9)},
    ]
    assert [improvement.reached for improvement in answer.alone] == pytest.approx([9e-3, 9e-3], rel=1e-9)
    content = answer.to_dict()
    assert (content["present"], content["wanted"]) == (pytest.approx(10.0, rel=1e-9), pytest.approx(9.0, rel=1e-9))
    assert content["alone"][0]["a"]["ratio"] == pytest.approx((4.5**2 - 3**2) ** 0.5 / 4, rel=1e-9)


def test_what_all_together_must_become(sum_of_two):
    """U = 6 mm leaves u² = 3² mm²: no input alone suffices; both to 3/√2 mm."""
    answer = required(sum_of_two, sum_of_two.measurands[0], 6e-3)
    assert answer.alone == ()
    level = pytest.approx(3e-3 / 2**0.5, rel=1e-9)
    assert (answer.present, answer.wanted) == (pytest.approx(10e-3, rel=1e-9), 6e-3)
    assert answer.together.needed == {"a": level, "b": level}
    assert answer.together.reached == pytest.approx(6e-3, rel=1e-9)
