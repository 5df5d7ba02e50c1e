"""First and second derivatives of the programme against finite differences."""

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from matching.frequency.case import load_case
from matching.frequency.demands import demands
from matching.frequency.goals import goals, target_modes
from matching.frequency.problem import build, grid
from matching.frequency.solve import _start
from matching.frequency.verification.responses import responses

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module", params=["road_to_rig", "compact_bev"])
def problem(request):
    case = load_case(EXAMPLES / request.param / "case.toml")
    weights = np.linspace(1, 3, len(case.moves))
    own = goals(case, target_modes(case))
    return build(case, case.moves, weights, own, responses(case, grid(case)).vehicle, demands(case))


@pytest.fixture(scope="module")
def functions(problem):
    """Objective, gradient, product of the Hessian with a direction; the same of a weighted sum of all constraints."""
    v, d = ca.MX.sym("v", len(problem.lower)), ca.MX.sym("d", len(problem.lower))
    f, g = problem.objective(v)
    weights = np.random.default_rng(3).normal(size=g.shape[0])
    found = []
    for value in (f, ca.DM(weights).T @ g):
        gradient = ca.gradient(value, v)
        found.append(ca.Function("derivatives", [v, d], [value, gradient, ca.jtimes(gradient, v, d)]))
    return found


@pytest.fixture(scope="module")
def point(problem):
    return _start(problem, np.random.default_rng(7))


@pytest.mark.parametrize("which", [0, 1], ids=["objective", "constraints"])
def test_against_differences(problem, functions, point, which):
    function = functions[which]
    direction = np.random.default_rng(1).normal(size=len(point))
    _, gradient, product = (part.full().ravel() for part in function(point, direction))
    step = 1e-5
    around = [
        [part.full().ravel() for part in function(point + side * step * direction, direction)] for side in (1, -1)
    ]
    slope = (around[0][0][0] - around[1][0][0]) / (2 * step)
    bend = (around[0][1] - around[1][1]) / (2 * step)
    assert np.isfinite(product).all()
    assert gradient @ direction == pytest.approx(slope, rel=1e-5)
    np.testing.assert_allclose(product, bend, rtol=1e-4, atol=1e-5 * np.abs(bend).max())


def test_compact_derivatives_against_casadis_own(problem, point):
    """What IPOPT is given, term by term mapped over frequencies, against CasADi's own of the same expressions."""
    v = ca.MX.sym("v", len(point))
    f, g = problem.objective(v)
    weights = np.random.default_rng(5).normal(size=g.shape[0])
    lagrangian = 0.7 * f + ca.dot(ca.DM(weights), g)
    own = ca.Function("own", [v], [ca.gradient(f, v), ca.jacobian(g, v), ca.triu(ca.hessian(lagrangian, v)[0])])
    gradient, jacobian, hessian = (part.full() for part in own(point))
    oracle = problem.solver.get_function
    np.testing.assert_allclose(oracle("nlp_grad_f")(point, [])[1].full(), gradient, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(oracle("nlp_jac_g")(point, [])[1].full(), jacobian, rtol=1e-8, atol=1e-8)
    found = oracle("nlp_hess_l")(point, [], 0.7, weights).full()
    np.testing.assert_allclose(found, hessian, rtol=1e-7, atol=1e-7 * np.abs(hessian).max())
