"""The parts of the uncertainty engine against closed forms and independent methods."""

import math
import re
import tracemalloc

import numpy as np
import pytest
from scipy import stats

from matching.uncertainty.budget import NAMES, Distribution, budget_from_tables
from matching.uncertainty.evaluate import evaluate
from matching.uncertainty.propagate import (
    coverage_factor,
    monte_carlo,
    numerical_tolerance,
    propagate,
    required,
    sampler,
    written,
)
from modelling.errors import InputError


def single(formula, correlations=(), **inputs):
    budget = budget_from_tables(
        {"measurand": {"formula": formula}, "inputs": inputs, "correlations": list(correlations)}
    )
    return budget, budget.measurands[0]


def shape(name):
    return Distribution(name, 0.4 if name == "trapezoidal" else 0.0, 5 if name == "t" else math.inf)


@pytest.mark.parametrize("name", NAMES)
def test_draws_follow_their_law(name):
    draws = shape(name).draw(np.random.default_rng(1), 20_000)
    assert stats.kstest(draws, shape(name).law().cdf).pvalue > 1e-3
    if name != "t":
        assert shape(name).law().std() == pytest.approx(1, rel=1e-9)
        assert shape(name).kurtosis() == pytest.approx(3 + float(shape(name).law().stats("k")), rel=1e-9)


@pytest.mark.parametrize(("name", "weight"), [("rectangular", 1 / 3), ("triangular", 1 / 6), ("arcsine", 1 / 2)])
def test_weights_of_eq12(name, weight):
    budget, measurand = single("x", x={"value": 1.0, "half_width": 0.2, "distribution": name})
    assert propagate(budget, measurand).first_order == pytest.approx(0.2 * math.sqrt(weight))


@pytest.mark.parametrize(("name", "fourth"), [("rectangular", 4 / 5), ("normal", 2.0), ("arcsine", 0.5)])
def test_second_order_of_a_square_is_exact(name, fourth):
    """Var(x²) at x = 0 is (κ − 1)·u⁴."""
    width = {"uncertainty": 0.3} if name == "normal" else {"half_width": 0.3 / math.sqrt(shape(name).weight())}
    budget, measurand = single("x^2", x={"value": 0, "distribution": name} | width)
    found = propagate(budget, measurand)
    assert found.first_order == 0
    assert found.second_order == pytest.approx(math.sqrt(fourth) * 0.09, rel=1e-9)
    assert found.bias == pytest.approx(0.09)


@pytest.mark.parametrize(("name", "factor"), [("rectangular", 3.6), ("normal", 6.0)])
def test_second_order_counts_third_derivatives(name, factor):
    """Var(x + a·x³) = u² + 2a·κ·u⁴ + …"""
    width = {"uncertainty": 0.1} if name == "normal" else {"half_width": 0.1 * math.sqrt(3)}
    budget, measurand = single("x + 0.01*x^3", x={"value": 0, "distribution": name} | width)
    assert propagate(budget, measurand).second_order ** 2 - 0.01 == pytest.approx(factor * 0.01 * 1e-4, rel=1e-6)


def test_second_order_with_correlation_against_monte_carlo():
    budget, measurand = single(
        "x*y + exp(y)",
        [{"between": ["x", "y"], "r": 0.7}],
        x={"value": 0.1, "uncertainty": 0.3},
        y={"value": -0.2, "uncertainty": 0.2},
    )
    found, drawn = propagate(budget, measurand), monte_carlo(budget, measurand, draws=1_000_000)
    assert drawn.value == pytest.approx(found.value + found.bias, abs=2e-3)
    assert abs(found.second_order - drawn.standard_uncertainty) < 0.3 * abs(
        found.first_order - drawn.standard_uncertainty
    )


def test_formula_gradient_by_finite_differences():
    budget, measurand = single(
        "atan2(x, y)*log(1 + z^2)/sqrt(y) - abs(x)^1.5",
        x={"value": 0.4, "uncertainty": 0.1},
        y={"value": 1.3, "uncertainty": 0.1},
        z={"value": -0.7, "uncertainty": 0.1},
    )
    c = propagate(budget, measurand).sensitivities

    def value(point):
        x, y, z = point
        return math.atan2(x, y) * math.log(1 + z * z) / math.sqrt(y) - abs(x) ** 1.5

    numeric = [(value(budget.values + h) - value(budget.values - h)) / 2e-6 for h in 1e-6 * np.eye(3)]
    assert c == pytest.approx(numeric, rel=1e-7)


def test_welch_satterthwaite_is_refused_for_correlated_inputs_of_finite_freedom():
    budget, _measurand = single(
        "x + y",
        [{"between": ["x", "y"], "r": 0.5}],
        x={"value": 0, "uncertainty": 1, "degrees_of_freedom": 5},
        y={"value": 0, "uncertainty": 1},
    )
    result = evaluate(budget, draws=100_000).measurands[0]
    assert result.propagation.degrees_of_freedom is None
    assert "Welch-Satterthwaite does not hold" in result.propagation.refusal
    assert any("refused" in line for line in result.warnings)
    assert result.coverage_factor == pytest.approx(1.96, abs=1e-3)


def test_coverage_factor():
    budget, _ = single("x", x={"value": 0, "uncertainty": 1})
    assert coverage_factor(budget, 16.7) == pytest.approx(stats.t.ppf(0.975, 16))
    assert coverage_factor(budget, math.inf) == pytest.approx(1.959964, abs=1e-6)


@pytest.mark.parametrize(
    ("first", "second", "r"),
    [
        ("rectangular", "rectangular", 0.8),
        ("arcsine", "triangular", -0.6),
        ("normal", "trapezoidal", 0.5),
        ("rectangular", "rectangular", 1.0),
    ],
)
def test_correlated_shapes_keep_shape_and_correlation(first, second, r):
    inputs = {}
    for name, kind in (("x", first), ("y", second)):
        width = {"uncertainty": 1.0} if kind == "normal" else {"half_width": 1.0}
        inputs[name] = {"value": 0.0, "distribution": kind} | width | ({"beta": 0.4} if kind == "trapezoidal" else {})
    budget, _ = single("x + y", [{"between": ["x", "y"], "r": r}], **inputs)
    x, y = sampler(budget)(np.random.default_rng(2), 200_000)
    assert np.corrcoef(x, y)[0, 1] == pytest.approx(r, abs=6e-3)
    for draws, kind, u in ((x, first, budget.standard_uncertainties[0]), (y, second, budget.standard_uncertainties[1])):
        assert stats.kstest(draws[:20_000] / u, shape(kind).law().cdf).pvalue > 1e-3


def test_monte_carlo_does_not_depend_on_the_number_of_threads():
    budget, measurand = single("x*y", x={"value": 1, "uncertainty": 0.1}, y={"value": 2, "half_width": 0.5})
    one, three = (monte_carlo(budget, measurand, draws=200_000, workers=workers, seed=7) for workers in (1, 3))
    assert (one.value, one.standard_uncertainty, one.shortest) == (
        three.value,
        three.standard_uncertainty,
        three.shortest,
    )
    assert monte_carlo(budget, measurand, draws=200_000, seed=8).value != one.value


def test_shortest_interval_of_a_skewed_result():
    """exp of a normal: the shortest interval by numerical search in the exact law."""
    from scipy.optimize import minimize_scalar

    budget, measurand = single("exp(x)", x={"value": 0, "uncertainty": 0.5})
    law = stats.lognorm(0.5)
    best = minimize_scalar(lambda p: law.ppf(p + 0.95) - law.ppf(p), bounds=(1e-6, 0.0499), method="bounded")
    drawn = monte_carlo(budget, measurand, draws=3_000_000)
    assert drawn.shortest == pytest.approx((law.ppf(best.x), law.ppf(best.x + 0.95)), abs=0.02)
    assert drawn.symmetric == pytest.approx(law.ppf([0.025, 0.975]), abs=5e-3)
    assert drawn.standard_uncertainty == pytest.approx(law.std(), rel=3e-3)


def test_adaptive_stop_is_within_its_tolerance():
    budget, measurand = single("x + y", x={"value": 0, "uncertainty": 1}, y={"value": 5, "uncertainty": 1})
    values = [monte_carlo(budget, measurand, seed=seed) for seed in range(6)]
    assert all(one.stable for one in values)
    assert np.std([one.value for one in values]) < values[0].tolerance
    assert abs(np.mean([one.standard_uncertainty for one in values]) - math.sqrt(2)) < values[0].tolerance


def test_the_spread_over_chunks_is_twice_the_standard_deviation_of_their_average():
    """JCGM 101, 7.9.4: for a normal of u = 1, 2·s of the average of n draws is 2/√n, of its uncertainty 2/√2n."""
    budget, measurand = single("x", x={"value": 0, "uncertainty": 1})
    drawn = monte_carlo(budget, measurand, draws=4_000_000)
    assert drawn.spread[0] == pytest.approx(2 / math.sqrt(4e6), rel=0.15)  # of 400 chunks: ±3.5 % (k = 1)
    assert drawn.spread[1] == pytest.approx(2 / math.sqrt(8e6), rel=0.15)


def test_memory_is_bounded_by_the_chunks_not_the_draws():
    budget, measurand = single("x + y", x={"value": 0, "uncertainty": 1}, y={"value": 0, "half_width": 1})

    def peak(draws: int, workers: int) -> int:
        tracemalloc.start()
        monte_carlo(budget, measurand, draws=draws, workers=workers)
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most

    # One worker: what waits to be merged does not depend on how the threads happen to run.
    assert peak(4_000_000, workers=1) < 1.3 * peak(500_000, workers=1)
    assert peak(4_000_000, workers=2) < 4_000_000 * 8  # less than one array of all draws


def test_good_verdict_where_first_order_is_good():
    budget, _measurand = single("x + y", x={"value": 0, "uncertainty": 1}, y={"value": 0, "uncertainty": 2})
    result = evaluate(budget, draws=8_000_000, digits=1).measurands[0]
    assert result.check.verdict == "good"


def test_a_product_that_is_nearly_linear_is_good_whatever_is_drawn():
    """M·n with u of 0.3 and 0.07 %: skewness 6·M·n·u_M²·u_n²/u³ = 8e-4 moves an interval by 4e-4 u, δ is 0.015 u."""
    shares = {"x": {"value": 300, "uncertainty": 1}, "y": {"value": 314.159, "uncertainty": 0.209}}
    budget, _measurand = single("x*y", **shares)
    for seed in (1, 2):
        check = evaluate(budget, seed=seed).measurands[0].check
        assert check.verdict == "good"


def near_the_limit(k, **how):
    """y = x normal with u = 1.0, δ = 0.05; the true 95 % end is 1.96, so that d = k − 1.96."""
    tables = {"measurand": {"formula": "x"}, "inputs": {"x": {"value": 0, "uncertainty": 1}}, "coverage_factor": k}
    return evaluate(budget_from_tables(tables), **how).measurands[0]


@pytest.mark.parametrize(("k", "verdict"), [(1.995, "good"), (2.025, "not good")])
def test_draws_go_on_until_the_check_is_decided(k, verdict):
    """d = 0.035 and 0.065: a result that is stable to δ leaves either open."""
    result = near_the_limit(k)
    assert result.check.tolerance == pytest.approx(0.05)
    assert result.check.verdict == verdict
    stable = monte_carlo(*single("x", x={"value": 0, "uncertainty": 1}))
    assert stable.draws < result.monte_carlo.draws <= 10_000_000


def test_an_undecided_check_makes_the_monte_carlo_result_the_headline():
    result = near_the_limit(2.005, draws=20_000)
    assert result.check.verdict == "open"
    assert result.method == "monte_carlo"
    assert result.statement.endswith("(Monte Carlo)")
    assert any("do not decide" in line and "--draws" in line for line in result.warnings)


def test_where_the_check_rejects_first_order_the_statement_is_that_of_the_monte_carlo():
    """x² at x = 0, u = 0.5: first order says 0 ± 0. The shortest 95 % interval of 0.25·χ²(1) is 0 ... 0.96."""
    budget, _ = single("x^2", x={"value": 0, "uncertainty": 0.5})
    result = evaluate(budget, draws=1_000_000).measurands[0]
    assert result.check.verdict == "not good"
    assert result.method == "monte_carlo"
    found = re.fullmatch(r"y = (\S+), u = (\S+), 95 % in (\S+) \.\.\. (\S+) \(Monte Carlo\)", result.statement)
    value, u, low, high = (float(text) for text in found.groups())
    assert (value, u) == pytest.approx((0.25, 0.25 * math.sqrt(2)), abs=0.01)
    assert (low, high) == pytest.approx((0, 0.25 * stats.chi2(1).ppf(0.95)), abs=0.02)
    assert all(len(text.partition(".")[2]) == 2 for text in found.groups())


@pytest.mark.parametrize(
    ("formula", "inputs", "r", "value"),
    [
        ("x + y", {"x": {"value": 1}, "y": {"value": 2}}, None, 3),
        ("x", {"x": {"readings": [0.3, 0.3, 0.3]}}, None, 0.3),
        ("x + y", {"x": {"value": 1, "uncertainty": 0.1}, "y": {"value": 2, "uncertainty": 0.1}}, -1, 3),
        ("3e6*x", {"x": {"value": 1e-3}}, None, 3e3),
    ],
)
def test_exact_results_pass_the_check(formula, inputs, r, value):
    correlations = [] if r is None else [{"between": ["x", "y"], "r": r}]
    budget, _ = single(formula, correlations, **inputs)
    result = evaluate(budget, draws=200_000).measurands[0]
    assert result.check.verdict == "good"
    assert result.expanded == 0
    assert result.statement.startswith(f"y = ({value:g} ± 0)")


@pytest.mark.parametrize(
    ("value", "uncertainty", "shown"),
    [
        (127.7322, 0.07107, ("127.732", "0.071")),
        (1234567.0, 1234.0, ("1234600", "1200")),
        (0.09996, 0.00996, ("0.100", "0.010")),
        (-0.00001, 0.5, ("0.00", "0.50")),
        (12.0, 0.0, ("12", "0")),
        (5e7 + 0.8, 92.48, ("50000001", "92")),
    ],
)
def test_rounding(value, uncertainty, shown):
    assert written(value, uncertainty) == shown


def test_numerical_tolerance():
    assert numerical_tolerance(0.0539, 2) == pytest.approx(0.0005)
    assert numerical_tolerance(35.4, 1) == pytest.approx(5)


def test_inverse_use_reaches_the_wanted_uncertainty_when_fed_back():
    budget, measurand = single(
        "2*x + y - z",
        x={"value": 0, "uncertainty": 1.0},
        y={"value": 0, "uncertainty": 0.8},
        z={"value": 0, "uncertainty": 0.1, "degrees_of_freedom": 4},
    )
    present = required(budget, measurand, 1e3)
    assert present.alone == ()
    assert present.together is None
    found = required(budget, measurand, 3.0)
    assert [list(step.needed) for step in found.alone] == [["x"]]  # y alone cannot: 2·1.96·1 is above 3
    assert (2 * found.alone[0].needed["x"]) ** 2 == pytest.approx((3 / 1.96) ** 2 - 0.64 - 0.01, rel=1e-3)
    for step in (*found.alone, found.together):
        u = dict(zip("xyz", budget.standard_uncertainties, strict=True))
        better = budget.scaled({name: needed / u[name] for name, needed in step.needed.items()})
        result = propagate(better, measurand)
        assert coverage_factor(better, result.degrees_of_freedom) * result.first_order == pytest.approx(3.0, rel=1e-6)


def test_inverse_use_works_on_the_monte_carlo_where_first_order_fails():
    """U of x² at 0 is half of 0 ... u²·χ²(0.95): 0.480 at u = 0.5. For 0.12 that u has to be halved."""
    budget, _ = single("x^2", x={"value": 0, "uncertainty": 0.5})
    (found,) = evaluate(budget, draws=200_000, wanted="0.12").inverse
    assert found.present == pytest.approx(0.125 * stats.chi2(1).ppf(0.95), rel=0.02)
    needed = 0.5 * math.sqrt(0.12 / found.present)
    assert found.alone[0].needed["x"] == pytest.approx(needed, rel=1e-3)
    assert found.together.needed["x"] == pytest.approx(needed, rel=1e-3)
    assert found.together.reached == pytest.approx(0.12, rel=1e-3)


def test_a_formula_nested_twenty_deep_costs_its_length():
    """Counted, not timed: operations of value and derivatives grow with the depth, and dimensions are found once."""
    from matching.uncertainty.propagate import _derivatives

    def operations(depth):
        formula = "atan2(" * depth + "x" + ", a)" * depth
        budget = budget_from_tables(
            {
                "inputs": {name: {"value": value, "uncertainty": 0.1} for name, value in (("x", 1.5), ("a", 2.0))},
                "measurand": {"formula": formula},
            }
        )
        return _derivatives(budget.measurands[0].expression, ("x", "a"), ((0, 0), (1, 1))).n_instructions()

    assert operations(20) < 2.6 * operations(10)


def test_derivatives_against_differences_of_the_formula():
    """Second order of a formula with every function, from Hessian and third derivatives by complex steps of mpmath."""
    import mpmath

    text = "atan2(x, a) + asinh(x*a) + atanh(x/9) + acosh(a + 1) + abs(x)*log10(a)"
    inputs = {name: {"value": value, "uncertainty": 0.05} for name, value in (("x", 1.5), ("a", 2.0))}
    found = propagate((b := budget_from_tables({"inputs": inputs, "measurand": {"formula": text}})), b.measurands[0])

    def f(x, a):
        angle, rest = mpmath.atan2(x, a), mpmath.asinh(x * a) + mpmath.atanh(x / 9) + mpmath.acosh(a + 1)
        return angle + rest + abs(x) * mpmath.log10(a)

    def slope(*orders):
        return float(mpmath.diff(f, (1.5, 2.0), orders))

    u = 0.05**2
    H = np.array([[slope(2, 0), slope(1, 1)], [slope(1, 1), slope(0, 2)]])
    first = u * (slope(1, 0) ** 2 + slope(0, 1) ** 2)
    third = slope(1, 0) * (slope(3, 0) + slope(1, 2)) + slope(0, 1) * (slope(2, 1) + slope(0, 3))
    assert found.sensitivities == pytest.approx([slope(1, 0), slope(0, 1)], rel=1e-9)
    assert found.second_order**2 == pytest.approx(first + 0.5 * u**2 * np.trace(H @ H) + u**2 * third, rel=1e-8)


def test_an_input_without_uncertainty_is_exact_in_the_budget():
    budget, _ = single("x*y", x={"value": 2.0, "uncertainty": 0.1}, y={"value": 3.0, "uncertainty": 0.0})
    rows = {row.name: row for row in evaluate(budget, draws=1000).measurands[0].rows}
    assert {name: row.distribution for name, row in rows.items()} == {"x": "normal", "y": "exact"}


@pytest.mark.parametrize(("r", "possible"), [(-0.48, True), (-0.5, False)])
def test_correlations_that_no_copula_of_these_shapes_has_are_refused(r, possible):
    """Three rectangular inputs with r each: the normals behind have 2·sin(π·r/6), of which three cannot be < −1/2."""
    assert (2 * math.sin(math.pi * r / 6) >= -0.5) == possible
    inputs = {name: {"value": 1.0, "half_width": 0.1} for name in "xyz"}
    pairs = [{"between": list(pair), "r": r} for pair in ("xy", "yz", "xz")]
    budget, _ = single("x+y+z", pairs, **inputs)
    if possible:
        drawn = sampler(budget)(np.random.default_rng(0), 20_000)
        assert np.corrcoef(drawn)[0, 1] == pytest.approx(r, abs=0.03)
    else:
        with pytest.raises(InputError, match="cannot have these correlations together"):
            sampler(budget)


def test_shares_are_those_of_the_draws_where_the_first_order_does_not_hold():
    """A root of squares at b = c = 0: the first order gives a all of u², but a does nothing; against own draws."""
    budget, _ = single(
        "sqrt(a**2 + b**2 + c**2)", a={"value": 1, "uncertainty": 0.01}, b={"value": 0, "uncertainty": 10},
        c={"value": 0, "uncertainty": 6},
    )  # fmt: skip
    (result,) = evaluate(budget, seed=4).measurands
    assert result.method == "monte_carlo"
    rng = np.random.default_rng(12)
    a, b, c = 1 + 0.01 * rng.normal(size=10**6), 10 * rng.normal(size=10**6), 6 * rng.normal(size=10**6)
    own = {
        name: 1 - np.var(np.sqrt(x**2 + y**2 + z**2)) / np.var(np.sqrt(a**2 + b**2 + c**2))
        for name, x, y, z in (("a", 1.0, b, c), ("b", a, 0.0, c), ("c", a, b, 0.0))
    }
    shares = {row.name: row.share for row in result.rows}
    assert shares["a"] == 0
    for name, share in own.items():
        assert shares[name] == pytest.approx(share, abs=0.01)
    assert [row.name for row in result.rows][-1] == "a"


def test_a_result_by_the_law_of_propagation_keeps_its_shares():
    budget, _ = single("a + 2*b", a={"value": 1, "uncertainty": 0.3}, b={"value": 2, "uncertainty": 0.2})
    (result,) = evaluate(budget, seed=4, digits=1).measurands
    assert result.method == "first_order"
    assert {row.name: row.share for row in result.rows} == pytest.approx({"a": 0.36, "b": 0.64})
