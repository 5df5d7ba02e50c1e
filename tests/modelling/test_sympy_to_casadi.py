"""SymPy → CasADi: right on what it knows, an error on everything else."""

import casadi as ca
import numpy as np
import pytest
import sympy as sm

from modelling.equations.casadi_code import to_casadi

x, y = sm.symbols("x y", real=True)
KNOWN = [
    x + 2 * y - 3, x * y / 7, x**3, y**-2, sm.sqrt(y), y**x, sm.Rational(2, 3) * x, sm.pi * x, sm.E**x,
    sm.sin(x) * sm.cos(y), sm.tan(x), sm.asin(x / 9), sm.acos(x / 9), sm.atan(x), sm.atan2(y, x), sm.sinh(x),
    sm.cosh(x), sm.tanh(x), sm.exp(-(x**2)), sm.log(y), sm.Abs(x), sm.sign(x), sm.floor(x), sm.ceiling(x),
    sm.Max(x, y, 1), sm.Min(x, y, 1), sm.Piecewise((x, x > y), (y**2, x < -y), (0, True)),
    sm.Piecewise((1, (x > 0) & (y > 1)), (2, (x <= 0) | (y >= 9)), (3, True)),
    sm.Piecewise((1, sm.Not(x >= 0)), (2, True)), sm.Integer(5), sm.Float(1e-3),
]  # fmt: skip
UNKNOWN = [
    sm.gamma(x), sm.erf(x), sm.besselj(0, x), sm.Heaviside(x), sm.DiracDelta(x), sm.Function("f")(x), sm.Mod(x, y),
    sm.Integral(sm.exp(x**2), x), sm.Derivative(sm.Function("f")(x), x), sm.Sum(x, (y, 1, 3)), sm.zoo, sm.I * x,
    sm.nan, sm.oo,
    sm.Symbol("stranger"), sm.Eq(x, y), sm.Ne(x, y), sm.sec(x), sm.LambertW(y),
]  # fmt: skip


@pytest.mark.parametrize("expression", KNOWN, ids=str)
def test_known_nodes(expression):
    a, b = ca.SX.sym("a"), ca.SX.sym("b")
    function = ca.Function("f", [a, b], to_casadi([expression], {x: a, y: b}))
    for at in ((0.3, 1.7), (-1.2, 2.5), (2.0, 0.4)):
        expected = float(sm.sympify(expression).subs({x: sm.Float(at[0]), y: sm.Float(at[1])}))
        assert float(function(*at)) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("expression", UNKNOWN, ids=str)
def test_unknown_nodes_raise(expression):
    with pytest.raises(NotImplementedError, match="no translation"):
        to_casadi([x + 1, expression], {x: ca.SX.sym("a"), y: ca.SX.sym("b")})


def test_shared_parts_are_translated_once_and_depth_is_no_limit():
    deep = x
    for _ in range(5000):
        deep = sm.sin(deep, evaluate=False)
    a = ca.SX.sym("a")
    (walked,) = to_casadi([deep], {x: a})
    assert ca.Function("f", [a], [walked]).n_instructions() <= 5003
    one, two = to_casadi([sm.sin(x) + 1, sm.sin(x) + 2], {x: a})
    assert np.isfinite(float(ca.Function("f", [a], [one + two])(0.2)))
