"""Starts by continuation in dead time: ends are judged by feasibility, optimality and the reported figure."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from match import drawn
from scipy.optimize import lsq_linear

from matching.match.case_file import load_case
from matching.match.programme import LEAST_OSCILLATION, eigenpairs, scaled
from matching.match.solve import End, TuningTask, check, continued_starts, finish, follows_targets, run_from, start
from modelling.bed.controllers import STRUCTURES
from tests.match.programme import programme_of

REFERENCE = Path(__file__).parents[2] / "examples" / "road_to_rig" / "case.toml"
ACTIVE = 1e-3  # of a scaled variable or constraint: so near its bound it may carry a multiplier


@pytest.fixture(scope="module")
def task(tmp_path_factory) -> TuningTask:
    """One dynamometer, feedback alone across 5 ms."""
    case = load_case(drawn.draw(2, tmp_path_factory.mktemp("drawn")))
    loop = replace(case.loop.with_values({"dead_time": 0.005}), structure=STRUCTURES["pi"])
    return programme_of(replace(case, loop=loop))


def stationarity(problem, v, extra):
    """Share of the objective's gradient that no admissible multipliers balance (Karush-Kuhn-Tucker), 0 at a minimum."""
    gradient = problem.solver.get_function("nlp_grad_f")(v, extra)[1].full().ravel()
    jacobian = problem.solver.get_function("nlp_jac_g")(v, extra)[1].full()
    g = problem.objective(v, extra)[1].full().ravel()
    columns, low, high = [], [], []
    both = [(problem.lower, v, problem.upper, np.eye(len(v))), (problem.g_lower, g, problem.g_upper, jacobian)]
    for lower, at, upper, rows in both:
        for i in range(len(at)):
            below, above = at[i] - lower[i] < ACTIVE, upper[i] - at[i] < ACTIVE
            if below or above:
                columns.append(rows[i])
                low.append(-np.inf if below else 0.0)
                high.append(np.inf if above else 0.0)
    balance = lsq_linear(np.array(columns).T, -gradient, (np.array(low), np.array(high)))
    return np.sqrt(2 * balance.cost) / np.linalg.norm(gradient)


def test_a_start_led_from_a_shorter_dead_time_ends_in_a_stable_minimum(task):
    (end,) = continued_starts(task, 0, (1,))
    assert end is not None
    assert follows_targets(task, end)
    solution = finish(task, end, ())
    problem = task.build(tight=True, slots=30)
    v, extra = np.array([*_scaled(problem, solution.values), *solution.pairs]), problem.extra(solution.added)
    value, rows = (part.full().ravel() for part in problem.objective(v, extra))
    assert value[0] == pytest.approx(solution.objective, rel=1e-9)
    assert problem.violation(rows) < 1e-5
    margin, _, stable = check(problem, v)
    assert stable
    assert margin >= task.case.limits["modulus_margin"]
    assert stationarity(problem, v, extra) < 0.02
    moved = v.copy()
    moved[0] += 0.05 if v[0] < 0.5 else -0.05
    assert stationarity(problem, moved, extra) > 0.1  # the measure itself notices


def _scaled(problem, values):
    return [scaled(values[move.name], move) for move in problem.moves]


def test_only_a_continued_start_may_let_a_root_become_real(task):
    problem = task.build()
    held = problem.oscillating()
    assert (eigenpairs(held.lower, len(problem.moves), task.case)[:, 1] == LEAST_OSCILLATION).all()
    assert (eigenpairs(problem.lower, len(problem.moves), task.case)[:, 1] == 0).all()


def test_a_root_that_ran_away_follows_no_mode(task):
    problem = task.build()
    end = End(0.0, start(problem, None), False)
    pair = eigenpairs(end.v, len(task.moves), task.case)
    pair[0, :2] = (-1.0, 1.9)
    assert not follows_targets(task, end)
    pair[0, :2] = (-1.0, 1.7)
    assert follows_targets(task, end)


@pytest.mark.long
def test_continued_starts_of_the_reference_case_are_optima_and_may_let_a_root_become_real():
    """At 5 ms; a local search from each end stays there, whatever the processor's rounding."""
    case = load_case(REFERENCE)
    task = programme_of(replace(case, loop=case.loop.with_values({"dead_time": 0.005})))
    problem = task.build()
    ends = list(continued_starts(task, 0, (1, 2, 3)))
    for end in ends:
        assert end is not None
        assert end.converged
        assert follows_targets(task, end)
        assert problem.violation(problem.objective(end.v, problem.extra())[1].full().ravel()) < 1e-5
        assert run_from(problem, end.v).objective == pytest.approx(end.objective, rel=1e-5)
    oscillation = [eigenpairs(end.v, len(problem.moves), task.case)[0, 1] for end in ends]
    assert any(part < LEAST_OSCILLATION for part in oscillation)  # the 1.6 Hz mode is overdamped there
