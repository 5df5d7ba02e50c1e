"""Random budgets through GTC, an independent GUM implementation: value, uncertainty and degrees of freedom to 1e-9."""

import math

import numpy as np
import pytest

from matching.uncertainty.budget import budget_from_tables
from matching.uncertainty.propagate import output_correlation, propagate

GTC = pytest.importorskip("GTC")

FUNCTIONS = {"sin": GTC.sin, "cos": GTC.cos, "exp": GTC.exp, "log": GTC.log, "sqrt": GTC.sqrt, "tanh": GTC.tanh}


def random_formula(generator, names, depth):
    """A formula as text and the same as a function of GTC numbers; arguments of log and sqrt are kept positive."""
    kind = generator.integers(0, 7) if depth else 6
    if kind == 6:
        name = str(generator.choice(names))
        return name, lambda x: x[name]
    if kind == 5:
        inner, f = random_formula(generator, names, depth - 1)
        called = str(generator.choice(list(FUNCTIONS)))
        if called in ("log", "sqrt"):
            return f"{called}(1 + ({inner})**2)", lambda x: FUNCTIONS[called](1 + f(x) ** 2)
        return f"{called}(tanh({inner}))", lambda x: FUNCTIONS[called](GTC.tanh(f(x)))
    (a, f), (b, g) = (random_formula(generator, names, depth - 1) for _ in range(2))
    if kind == 0:
        return f"({a} + {b})", lambda x: f(x) + g(x)
    if kind == 1:
        return f"({a} - 0.5*{b})", lambda x: f(x) - 0.5 * g(x)
    if kind == 2:
        return f"({a} * {b})", lambda x: f(x) * g(x)
    if kind == 3:
        return f"({a} / (2 + ({b})**2))", lambda x: f(x) / (2 + g(x) ** 2)
    return f"(({a})**3 - {b})", lambda x: f(x) ** 3 - g(x)


@pytest.mark.parametrize("seed", range(30))
def test_random_budget(seed):
    generator = np.random.default_rng(seed)
    count = int(generator.integers(2, 7))
    names = [f"x{i}" for i in range(count)]
    inputs, numbers = {}, {}
    for i, name in enumerate(names):
        value, u = float(generator.normal(0, 1.5)), float(generator.uniform(0.01, 0.3))
        freedom = math.inf if i < 2 or generator.random() < 0.4 else int(generator.integers(2, 30))
        inputs[name] = {"value": value, "uncertainty": u} | (
            {} if math.isinf(freedom) else {"degrees_of_freedom": freedom}
        )
        numbers[name] = GTC.ureal(value, u, freedom, independent=i > 1)
    r = float(generator.uniform(-0.95, 0.95))
    GTC.set_correlation(r, numbers["x0"], numbers["x1"])
    text, function = random_formula(generator, names, 3)
    text, function = f"{text} + x0*x1 + x{count - 1}", lambda x, f=function: f(x) + x["x0"] * x["x1"] + x[names[-1]]
    budget = budget_from_tables(
        {"measurand": {"formula": text}, "inputs": inputs, "correlations": [{"between": ["x0", "x1"], "r": r}]}
    )
    ours, theirs = propagate(budget, budget.measurands[0]), function(numbers)
    assert ours.value == pytest.approx(theirs.x, rel=1e-9, abs=1e-12)
    assert ours.first_order == pytest.approx(theirs.u, rel=1e-9)
    if math.isinf(theirs.df):
        assert ours.degrees_of_freedom > 1e6
    else:
        assert ours.degrees_of_freedom == pytest.approx(theirs.df, rel=1e-9)
    for name, c in zip(names, ours.sensitivities, strict=True):
        assert c == pytest.approx(GTC.rp.sensitivity(theirs, numbers[name]), rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("seed", range(10))
def test_simultaneous_readings(seed):
    """Ensembles with another independent input beside them: uncertainty, degrees of freedom, output correlation."""
    generator = np.random.default_rng(100 + seed)
    readings = generator.multivariate_normal([2.0, 3.0, 0.5], 0.01 * (np.eye(3) + 0.6), size=6)
    tables = {
        "measurands": {"p": {"formula": "a*b + d"}, "q": {"formula": "a/b*cos(c)"}},
        "inputs": {name: {"readings": readings[:, i].tolist(), "simultaneous": "run"} for i, name in enumerate("abc")}
        | {"d": {"value": 1.0, "uncertainty": 0.1, "degrees_of_freedom": 7}},
    }
    budget = budget_from_tables(tables)
    p, q = (propagate(budget, one) for one in budget.measurands)
    a, b, c = GTC.ta.multi_estimate_real(readings.T.tolist())
    d = GTC.ureal(1.0, 0.1, 7)
    first, second = a * b + d, a / b * GTC.cos(c)
    assert (p.first_order, q.first_order) == pytest.approx((first.u, second.u), rel=1e-9)
    assert (p.degrees_of_freedom, q.degrees_of_freedom) == pytest.approx((first.df, second.df), rel=1e-9)
    assert output_correlation(budget, [p, q])[0, 1] == pytest.approx(GTC.get_correlation(first, second), rel=1e-9)
