"""Steps, Jacobians and descents against quadratics whose answers are known."""

import numpy as np
import pytest
from diagnosis.linear import KnownProblem, fit_at
from scipy.optimize import minimize

from matching.diagnosis.descent import FitOptions, Quadratic, chi_square, difference_steps, polished, solve
from matching.diagnosis.problem import jacobian

A = np.random.default_rng(2).standard_normal((30, 3)) * [1.0, 50.0, 1e-3]
B = np.random.default_rng(3).standard_normal(30)
OPEN = np.full(3, np.inf)


def test_free_step_is_least_squares() -> None:
    step, decrease = Quadratic(A).step(A.T @ B, -OPEN, OPEN, np.inf)
    expected, left = np.linalg.lstsq(A, -B, rcond=None)[:2]
    np.testing.assert_allclose(step, expected, rtol=1e-6)
    assert decrease == pytest.approx(B @ B - left[0], rel=1e-6)
    assert Quadratic(A).length(step) == pytest.approx(np.linalg.norm(A @ step), rel=1e-6)


def test_bounded_step_is_the_bounded_minimum() -> None:
    free, _ = Quadratic(A).step(A.T @ B, -OPEN, OPEN, np.inf)
    low, high = -np.abs(free) * [0.5, 2, 2], np.abs(free) * [0.5, 2, 2]
    step, decrease = Quadratic(A).step(A.T @ B, low, high, np.inf)
    scale = np.abs(free)
    found = minimize(
        lambda z: np.sum((B + A @ (z * scale)) ** 2),
        np.zeros(3),
        bounds=list(zip(low / scale, high / scale)),
        tol=1e-14,
    )
    np.testing.assert_allclose(step, found.x * scale, rtol=1e-4)
    assert decrease == pytest.approx(B @ B - found.fun, rel=1e-6)


def test_step_within_a_radius_is_shortened_and_promises_less() -> None:
    step, _ = Quadratic(A).step(A.T @ B, -OPEN, OPEN, np.inf)
    radius = 0.25 * np.linalg.norm(A @ step)
    short, decrease = Quadratic(A).step(A.T @ B, -OPEN, OPEN, radius)
    np.testing.assert_allclose(short, 0.25 * step, rtol=1e-6)
    assert decrease == pytest.approx(B @ B - np.sum((B + A @ short) ** 2), rel=1e-6)


def test_a_variable_without_influence_stays() -> None:
    still = np.column_stack([A[:, :2], np.zeros(30)])
    step, _ = Quadratic(still).step(still.T @ B, -OPEN, OPEN, np.inf)
    assert step[2] == 0
    np.testing.assert_allclose(step[:2], np.linalg.lstsq(A[:, :2], -B, rcond=None)[0], rtol=1e-6)


def curved(lower: float = -np.inf, upper: float = np.inf) -> KnownProblem:
    """Residuals a·exp(−b·t) − 2·exp(−3·t) over t."""
    t = np.linspace(0, 1, 50)
    return KnownProblem(
        {"a": (lower, upper), "b": (0.1, 50.0)}, lambda v: 100 * (v[0] * np.exp(-v[1] * t) - 2 * np.exp(-3 * t))
    )


def derivatives(v: np.ndarray) -> np.ndarray:
    t = np.linspace(0, 1, 50)
    return 100 * np.column_stack([np.exp(-v[1] * t), -v[0] * t * np.exp(-v[1] * t)])


def test_differences_are_the_derivatives() -> None:
    problem, v = curved(), np.array([1.3, 4.0])
    residual, exact = problem.function(v), derivatives(v)
    forward = jacobian(problem, v, residual)
    central = jacobian(problem, v, residual, largest_central=np.full(2, np.inf))
    assert np.abs(forward - exact).max() < 3e-3 * np.abs(exact).max()
    assert np.abs(central - exact).max() < 3e-6 * np.abs(exact).max()
    small = jacobian(problem, v, residual, largest_central=np.full(2, 1e-5))
    assert np.abs(small - exact).max() < 1e-8 * np.abs(exact).max()
    np.testing.assert_array_equal(jacobian(problem, v, residual, np.array([1]))[:, 0], forward[:, 1])


def test_differences_stay_within_the_bounds() -> None:
    problem, v = curved(upper=1.3), np.array([1.3, 4.0])
    seen = []
    function = problem.function
    problem.function = lambda v: seen.append(v.copy()) or function(v)
    for largest in (None, np.full(2, np.inf)):
        found = jacobian(problem, v, function(v), largest_central=largest)
        assert np.abs(found - derivatives(v)).max() < 3e-3 * np.abs(derivatives(v)).max()
    assert max(one[0] for one in seen) <= 1.3


def test_descent_ends_at_the_minimum_free_and_at_a_bound() -> None:
    fit = solve(curved(), np.array([0.5, 8.0]))
    assert fit.cost < 0.03  # of χ², whose minimum is 0: what is not worth a step
    np.testing.assert_allclose(fit.v, [2, 3], rtol=1e-3)
    bound = solve(curved(upper=1.5), np.array([0.5, 8.0]))
    assert bound.v[0] == 1.5
    best = minimize(lambda b: chi_square(curved().function(np.array([1.5, b[0]]))), [3.0], tol=1e-12)
    assert bound.cost == pytest.approx(best.fun, abs=0.05)


def test_held_variables_stay() -> None:
    fit = solve(curved(), np.array([1.5, 8.0]), None, FitOptions(held=(0,)))
    assert fit.v[0] == 1.5
    assert np.all(fit.jacobian[:, 0] == 0)


def test_polish_reaches_the_exact_minimum() -> None:
    problem = curved()
    v = np.array([2.02, 3.05])
    start = fit_at(problem, v, derivatives(v))
    fit = polished(start)
    assert start.cost > 10
    assert fit.cost < 0.02
    np.testing.assert_allclose(difference_steps(start), 1 / np.linalg.norm(derivatives(v), axis=0))


def creeping(ratio: float, promise: float = 1.1) -> KnownProblem:
    """One variable e, minimum 0: with the Jacobian (1, 0)ᵀ each step decreases χ² to ``ratio`` times and as promised.

    The steps are c·e with (1 − c)² = ratio; χ² = (c² + d²)·e², of which c²·e² is promised and (c² + d²)(2c − c²)·e²
    gained.
    """
    c = 1 - np.sqrt(ratio)
    column = 1e3 * np.array([c, np.sqrt(promise * c / (2 - c) - c**2)])
    return KnownProblem({"e": (-np.inf, np.inf)}, lambda v: v[0] * column)
