"""GUM H.1 to H.3 and JCGM 101 9.2 to 9.4, to their published digits."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from matching.uncertainty.budget import Distribution, budget_from_tables, read_budget
from matching.uncertainty.evaluate import evaluate
from matching.uncertainty.propagate import written
from modelling.errors import InputError

EXAMPLES = Path(__file__).parents[2] / "examples" / "gum"


def first_order(name):
    answer = evaluate(read_budget(EXAMPLES / name), with_monte_carlo=False)
    return answer.measurands, answer.correlation


def drawn(budget, **options):
    return evaluate(budget, **options).measurands[0]


def additive(shape="rectangular", fourth=1.0):
    """The sum of four inputs of unit standard uncertainty, the fourth `fourth` times as wide."""
    width = {"uncertainty": 1.0} if shape == "normal" else {"distribution": shape, "half_width": 3**0.5}
    inputs = {f"x{i}": {"value": 0} | width for i in range(1, 5)}
    inputs["x4"] = {"value": 0} | {key: fourth * x if key != "distribution" else x for key, x in width.items()}
    return budget_from_tables({"measurand": {"formula": "x1 + x2 + x3 + x4"}, "inputs": inputs})


def loss(x1, r):
    """Comparison loss of a microwave power meter: x1² + x2²."""
    return budget_from_tables(
        {
            "measurand": {"formula": "x1^2 + x2^2"},
            "correlations": [{"between": ["x1", "x2"], "r": r}] if r else [],
            "inputs": {"x1": {"value": x1, "uncertainty": 0.005}, "x2": {"value": 0, "uncertainty": 0.005}},
        }
    )


def test_end_gauge_h1():
    (result,), _ = first_order("end_gauge.toml")
    nm = 1e9
    assert round(result.propagation.value * nm) == 50_000_838
    assert round(result.propagation.first_order * nm) == 32
    assert round(result.propagation.second_order * nm) == 34
    assert round(result.propagation.degrees_of_freedom, 1) == 16.8  # 16.7 from the rounded contributions GUM prints
    assert result.coverage_factor == pytest.approx(2.92, abs=0.005)  # t with 16 degrees of freedom at 99 %
    assert pytest.approx(result.expanded * nm, abs=1.0) == 2.92 * 32  # GUM prints 93 nm from the rounded 32


def test_end_gauge_with_inexact_limits_jcgm_101_9_5():
    """Limits of dalpha known to 10 %, of dt to 50 %: u = 36 nm, 99 % in 745 ... 931 nm."""
    tables = tomllib.loads((EXAMPLES / "end_gauge.toml").read_text(encoding="utf-8"))
    for name, tolerance, freedom in (("dalpha", 1e-7, 50), ("dt", 0.025, 2)):
        stated = tables["inputs"][name].pop("degrees_of_freedom")
        tables["inputs"][name]["half_width_tolerance"] = tolerance
        assert stated == freedom
    budget = budget_from_tables(tables)
    freedoms = {quantity.name: quantity.degrees_of_freedom for quantity in budget.inputs}
    assert (freedoms["dalpha"], freedoms["dt"]) == pytest.approx((50, 2))
    result = drawn(budget, draws=1_000_000).monte_carlo
    assert result.standard_uncertainty * 1e9 == pytest.approx(35.7, abs=0.3)
    assert [end * 1e9 - 50e6 for end in result.symmetric] == pytest.approx([744.6, 931.3], abs=2.0)


def test_a_rectangle_with_inexact_limits_has_the_moments_of_its_definition():
    shape = Distribution("rectangular", width_tolerance=0.5)
    assert shape.weight() == pytest.approx(1 / 3 + 0.25 / 9)  # JCGM 101, 6.4.3.3
    draws = shape.draw(np.random.default_rng(1), 1_000_000)
    assert np.var(draws) == pytest.approx(1, rel=5e-3)
    assert np.mean(draws**4) == pytest.approx(shape.kurtosis(), rel=1e-2)
    assert np.abs(draws).max() == pytest.approx(1.5 / np.sqrt(shape.weight()), rel=1e-3)


def test_impedance_h2_from_raw_readings():
    results, correlation = first_order("impedance.toml")
    shown = [written(one.propagation.value, one.propagation.first_order) for one in results]
    assert shown == [("127.732", "0.071"), ("219.85", "0.30"), ("254.26", "0.24")]
    assert [f"{one.propagation.value:.3f}" for one in results] == ["127.732", "219.847", "254.260"]
    assert [f"{one.propagation.first_order:.3f}" for one in results] == ["0.071", "0.296", "0.236"]
    assert correlation[0, 1] == pytest.approx(-0.588, abs=5e-4)
    assert correlation[0, 2] == pytest.approx(-0.485, abs=5e-4)
    assert correlation[1, 2] == pytest.approx(0.993, abs=5e-4)
    assert [one.propagation.degrees_of_freedom for one in results] == pytest.approx([4, 4, 4])


def test_thermometer_h3():
    (intercept, slope, at_30), correlation = first_order("thermometer.toml")
    assert written(intercept.propagation.value, intercept.propagation.first_order) == ("-0.1712", "0.0029")
    assert written(slope.propagation.value, slope.propagation.first_order) == ("0.00218", "0.00067")
    assert written(at_30.propagation.value, at_30.propagation.first_order) == ("-0.1494", "0.0041")
    assert round(correlation[0, 1], 3) == -0.930
    assert at_30.propagation.degrees_of_freedom == pytest.approx(9)


def test_additive_normal_9_2_2():
    result = drawn(additive(shape="normal"), draws=1_000_000)
    assert result.propagation.first_order == pytest.approx(2.0)
    assert result.monte_carlo.symmetric == pytest.approx((-3.92, 3.92), abs=0.015)


def test_additive_rectangular_9_2_3():
    result = drawn(additive(), draws=4_000_000)
    assert result.monte_carlo.symmetric == pytest.approx((-3.88, 3.88), abs=0.008)
    assert result.monte_carlo.shortest == pytest.approx((-3.88, 3.88), abs=0.05)
    assert result.monte_carlo.standard_uncertainty == pytest.approx(2.0, abs=0.005)
    assert result.expanded == pytest.approx(3.92, abs=0.005)


def test_additive_one_dominating_9_2_4():
    result = drawn(additive(fourth=10.0), draws=2_000_000)
    assert result.propagation.first_order == pytest.approx(10.1, abs=0.05)
    assert result.expanded == pytest.approx(19.9, abs=0.05)
    assert result.monte_carlo.symmetric == pytest.approx((-17.0, 17.0), abs=0.05)
    assert result.check.verdict == "not good"


def test_mass_calibration_9_3():
    result = drawn(read_budget(EXAMPLES / "mass.toml"), draws=2_000_000)
    mg = 1e6
    assert result.propagation.value * mg == pytest.approx(1.2340, abs=5e-5)
    assert f"{result.propagation.first_order * mg:.4f}" == "0.0539"
    assert f"{result.propagation.second_order * mg:.4f}" == "0.0750"
    assert result.monte_carlo.standard_uncertainty * mg == pytest.approx(0.0754, abs=1e-4)
    assert [end * mg for end in result.monte_carlo.shortest] == pytest.approx([1.0834, 1.3825], abs=5e-3)
    # Table 8: d_low 0.0451, d_high 0.0430 by first order (no), 0.0036 and 0.0015 with higher terms (yes), δ = 0.005
    assert [one * mg for one in result.check.distances] == pytest.approx([0.0451, 0.0430], abs=5e-3)
    assert result.check.tolerance * mg == pytest.approx(0.0005)  # two digits; JCGM 101 takes one in this example
    assert result.check.verdict == "not good"
    one_digit = drawn(read_budget(EXAMPLES / "mass.toml"), draws=2_000_000, digits=1)
    assert one_digit.check.verdict == "not good"
    assert one_digit.check_second_order.tolerance * mg == pytest.approx(0.005)
    assert one_digit.check_second_order.verdict in ("good", "open")


@pytest.mark.parametrize(
    ("x1", "r", "first", "second", "value", "uncertainty", "interval"),
    [
        (0.000, 0.0, 0, 50, 50, 50, (0, 150)),
        (0.010, 0.0, 100, 112, 150, 112, (0, 367)),
        (0.050, 0.0, 500, 502, 2550, 502, (1590, 3543)),
        (0.000, 0.9, 0, 67, 50, 67, (0, 185)),
        (0.010, 0.9, 100, 121, 150, 121, (13, 398)),
        (0.050, 0.9, 500, 505, 2550, 505, (1628, 3555)),
    ],
)
def test_comparison_loss_9_4(x1, r, first, second, value, uncertainty, interval):
    result = drawn(loss(x1, r), draws=2_000_000)
    assert round(result.propagation.first_order * 1e6) == first
    assert round(result.propagation.second_order * 1e6) == second
    assert (result.propagation.value + result.propagation.bias) * 1e6 == pytest.approx(value, abs=1e-6)
    assert result.monte_carlo.value * 1e6 == pytest.approx(value, abs=1.5)
    # For a quadratic of normals second order is exact, and it rounds to the published uncertainty just above.
    assert result.monte_carlo.standard_uncertainty == pytest.approx(result.propagation.second_order, rel=2.5e-3)
    low, high = (end * 1e6 for end in result.monte_carlo.shortest)
    # The ends of a shortest interval scatter more than its width, which is nearly stationary in them.
    assert high - low == pytest.approx(interval[1] - interval[0], rel=0.005)
    assert (low, high) == pytest.approx(interval, abs=0.035 * uncertainty + 0.5)


def polar(x1):
    """A phasor of real part x1 and imaginary part 0, u = 0.010, r = 0.9, in amplitude and phase (JCGM 102, 9.2)."""
    return budget_from_tables(
        {
            "measurands": {"y1": {"formula": "sqrt(x1^2 + x2^2)"}, "y2": {"formula": "atan2(x2, x1)", "unit": "rad"}},
            "correlations": [{"between": ["x1", "x2"], "r": 0.9}],
            "inputs": {"x1": {"value": x1, "uncertainty": 0.010}, "x2": {"value": 0, "uncertainty": 0.010}},
        }
    )


@pytest.mark.parametrize(("x1", "published"), [(0.001, -0.071), (0.010, 0.352), (0.100, 0.882)])
def test_the_correlation_of_amplitude_and_phase_jcgm_102_table_7(x1, published):
    found = evaluate(polar(x1))
    assert found.correlation_method == "monte_carlo"
    assert found.correlation[0, 1] == pytest.approx(published, abs=0.002)
    assert all(result.propagation.second_order != 0 for result in found.measurands)


def test_the_correlation_of_a_linear_budget_is_that_of_first_order():
    tables = {
        "measurands": {"a": {"formula": "x1 + x2"}, "b": {"formula": "x1 - 2*x2"}},
        "inputs": {name: {"value": 1, "uncertainty": u} for name, u in (("x1", 0.3), ("x2", 0.1))},
    }
    found = evaluate(budget_from_tables(tables))
    assert found.correlation_method == "first_order"
    u = np.array([0.3, 0.1])
    a, b = np.array([1, 1]) * u, np.array([1, -2]) * u
    assert found.correlation[0, 1] == pytest.approx(a @ b / np.linalg.norm(a) / np.linalg.norm(b))


@pytest.mark.parametrize("unit", ["degC", "degF"])
def test_a_line_over_a_temperature_needs_its_origin(unit):
    """The thermometer of GUM H.3 at 30 °C; the line is the same whichever origin is stated."""
    readings = {"abscissa": [20, 22, 24, 26, 28, 30], "ordinate": [0.17, 0.168, 0.169, 0.165, 0.163, 0.161]}
    line = readings | {"abscissa_unit": unit, "ordinate_unit": "K"}
    with pytest.raises(InputError, match=f"{unit} has its zero elsewhere than SI"):
        budget_from_tables({"measurand": {"formula": "b_intercept + b_slope * t"}, "lines": {"b": line}})
    expected = np.polyval(np.polyfit(readings["abscissa"], readings["ordinate"], 1), 30)
    for origin in (0, 20, 25):
        tables = {
            "measurand": {"formula": "b_intercept + b_slope * (t - t0)", "unit": "K"},
            "lines": {"b": line | {"origin": origin}},
            "inputs": {name: {"value": at, "unit": unit} for name, at in (("t", 30), ("t0", origin))},
        }
        (result,) = evaluate(budget_from_tables(tables), with_monte_carlo=False).measurands
        assert result.propagation.value == pytest.approx(expected, rel=1e-9)
