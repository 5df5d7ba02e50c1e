"""First and second derivatives of the programme against finite differences."""

from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from match import drawn
from needs import compiles

from matching.match.case import demands, goals, target_modes
from matching.match.case_file import load_case
from matching.match.objectives import ResponseErrorObjective
from matching.match.programme import _REMEMBERED, _functions, build
from matching.match.solve import start
from modelling.simulation.compiled import compiler, folder

EXTRA = [7.0, 33.0]  # Hz: the margin is asked for there, too
EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module", params=["road_to_rig", "compact_bev"])
def programme(request):
    """How to build one with the given options."""
    case = load_case(EXAMPLES / request.param / "case.toml")
    weights = np.linspace(1, 3, len(case.moves))
    own = goals(case, target_modes(case))
    objective = ResponseErrorObjective.of(case)
    asked = demands(case)
    return lambda **how: build(case, case.moves, weights, own, objective, asked, slots=len(EXTRA), **how)


@pytest.fixture(scope="module")
def problem(programme):
    return programme(exact=True, compiled=False)


@pytest.fixture(scope="module")
def functions(problem):
    """Objective, gradient, product of the Hessian with a direction; the same of a weighted sum of all constraints."""
    v, d = ca.MX.sym("v", len(problem.lower)), ca.MX.sym("d", len(problem.lower))
    f, g = problem.objective(v, EXTRA)
    weights = np.random.default_rng(3).normal(size=g.shape[0])
    found = []
    for value in (f, ca.DM(weights).T @ g):
        gradient = ca.gradient(value, v)
        found.append(ca.Function("derivatives", [v, d], [value, gradient, ca.jtimes(gradient, v, d)]))
    return found


@pytest.fixture(scope="module")
def point(problem):
    return start(problem, np.random.default_rng(7))


def _differences(at, step=2e-4):
    """Slopes of value and gradient, of fourth order.

    Scaled minors are differences of large numbers: of steps small enough for the second order the rounding leaves
    1e-5 (measured: it grows with 1/step below 3e-5), so the steps are long and their curvature is taken out.
    """
    one, half = ([(ahead - back) / (2 * h) for ahead, back in zip(at(h), at(-h))][:2] for h in (step, step / 2))
    return [(4 * fine - coarse) / 3 for coarse, fine in zip(one, half)]


@pytest.mark.parametrize("which", [0, 1], ids=["objective", "constraints"])
def test_against_differences(problem, functions, point, which):
    function = functions[which]
    direction = np.random.default_rng(1).normal(size=len(point))
    _, gradient, product = (part.full().ravel() for part in function(point, direction))
    slope, bend = _differences(
        lambda step: [part.full().ravel() for part in function(point + step * direction, direction)]
    )
    assert np.isfinite(product).all()
    assert gradient @ direction == pytest.approx(slope[0], rel=3e-6)
    np.testing.assert_allclose(product, bend, rtol=1e-4, atol=1e-5 * np.abs(bend).max())


@pytest.mark.parametrize("error_limit", [None, 0.37], ids=["error", "least change"])
def test_compact_derivatives_against_casadis_own(programme, point, error_limit):
    """What IPOPT is given, term by term mapped over frequencies, against CasADi's own of the same expressions."""
    problem = programme(exact=True, compiled=False, error_limit=error_limit)
    v = ca.MX.sym("v", len(point))
    f, g = problem.objective(v, EXTRA)
    weights = np.random.default_rng(5).normal(size=g.shape[0])
    lagrangian = 0.7 * f + ca.dot(ca.DM(weights), g)
    own = ca.Function("own", [v], [ca.gradient(f, v), ca.jacobian(g, v), ca.triu(ca.hessian(lagrangian, v)[0])])
    gradient, jacobian, hessian = (part.full() for part in own(point))
    oracle = problem.solver.get_function
    np.testing.assert_allclose(oracle("nlp_grad_f")(point, EXTRA)[1].full(), gradient, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(oracle("nlp_jac_g")(point, EXTRA)[1].full(), jacobian, rtol=1e-8, atol=1e-8)
    found = oracle("nlp_hess_l")(point, EXTRA, 0.7, weights).full()
    np.testing.assert_allclose(found, hessian, rtol=1e-7, atol=1e-7 * np.abs(hessian).max())


def test_compiled_is_the_same(programme, problem, point):
    """What a compiler makes of the terms gives the numbers of CasADi's own machine, from the cache as well."""
    compiled = [programme(compiled=True) for _ in range(2)]
    if compiler() is None:
        pytest.skip("no C compiler")
    for own in compiled:
        for name in ("nlp_grad_f", "nlp_jac_g"):
            pairs = zip(own.solver.get_function(name)(point, EXTRA), problem.solver.get_function(name)(point, EXTRA))
            for found, wanted in pairs:
                np.testing.assert_allclose(found.full(), wanted.full(), rtol=1e-9, atol=1e-9)
        for found, wanted in zip(own.objective(point, EXTRA), problem.objective(point, EXTRA), strict=True):
            np.testing.assert_allclose(found.full(), wanted.full(), rtol=1e-9, atol=1e-9)


@compiles
def test_one_compilation_serves_every_case_of_a_structure(tmp_path, monkeypatch):
    """Another dead time, inertia or bound compiles nothing; another structure does."""
    monkeypatch.setenv("RIGMATCH_CACHE", str(tmp_path))
    folder.cache_clear()
    _REMEMBERED.clear()
    _functions.cache_clear()
    case = load_case(drawn.draw(1, tmp_path / "case"))
    own, found = goals(case, target_modes(case)), []
    fewer = replace(case, moves=case.moves[1:])
    later = replace(case, loop=case.loop.with_values({"dead_time": 0.0041}))
    narrower = replace(later, moves=tuple(replace(move, upper=0.95 * move.upper) for move in case.moves))
    cases = (case, later, narrower, fewer)
    asked = [demands(one) for one in cases]
    simulation = len(list(tmp_path.glob("*.so")))  # steps of the manoeuvre's simulation, no terms
    for one, demanded in zip(cases, asked, strict=True):
        weights, objective = np.ones(len(one.moves)), ResponseErrorObjective.of(one)
        build(one, one.moves, weights, own, objective, demanded)
        _REMEMBERED.clear()
        _functions.cache_clear()
        found.append(len(list(tmp_path.glob("*.so"))) - simulation)
    folder.cache_clear()
    assert found[0] == found[1] == found[2] == 6
    assert found[3] == 12
