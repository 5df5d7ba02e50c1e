"""Of answers as good the one that changes least; a rerun from the answer comes to the answer."""

from dataclasses import replace

import numpy as np
import pytest
from match import drawn

from matching.match import solve as searching
from matching.match.adapters import some_as_planned
from matching.match.case import apply, scaled
from matching.match.case_file import load_case
from matching.match.solve import AS_GOOD, as_good_as, given_end, least_change, vector_of, with_nearest_roots
from tests.match.programme import programme_of


@pytest.fixture(scope="module")
def solved(tmp_path_factory):
    """A task, feedback alone, and its answer."""
    task = programme_of(load_case(drawn.draw(3, tmp_path_factory.mktemp("drawn"))))
    return task, searching.solve(task, starts=3)


def change(task, values):
    """Weighted squares of the changes over their ranges, from the definition."""
    total = 0.0
    for weight, move in zip(task.weights, task.moves, strict=True):
        place = np.log if move.lower > 0 and move.upper / move.lower > 4 else float
        moved = (place(values[move.name]) - place(move.planned)) / (place(move.upper) - place(move.lower))
        total += weight * moved**2
    return total


def test_less_change_for_as_good_an_error(solved):
    task, best = solved
    limit = as_good_as(best.objective, AS_GOOD)
    nearest = least_change(task, best, limit)
    assert best.objective < nearest.objective <= limit * (1 + 1e-4)
    assert change(task, nearest.values) < change(task, best.values)
    assert nearest.holds
    problem = task.build()
    random, size = np.random.default_rng(2), len(task.moves)
    v = vector_of(task, nearest)
    assert nearest.objective == pytest.approx(limit, rel=1e-3)  # the limit binds: nothing is planned as is best
    for _ in range(20):  # no setting near it that keeps the limit changes less
        near = v.copy()
        near[:size] = np.clip(v[:size] + 0.02 * random.normal(size=size), 0, 1)
        near = with_nearest_roots(problem, near)
        error, rows = (part.full().ravel() for part in problem.objective(near, problem.extra()))
        good = error[0] <= limit and rows[: len(rows) - 4].min() > 0
        assert not good or change(task, problem.values(near)) > 0.999 * change(task, nearest.values)


def test_a_rerun_from_the_answer_comes_to_the_answer(solved):
    task, first = solved
    moves = tuple(replace(move, start=first.values[move.name]) for move in task.moves)
    again = searching.solve(replace(task, moves=moves), seed=7, starts=3)
    assert again.objective <= first.objective * (1 + 1e-4)
    for move in task.moves:
        assert abs(again.values[move.name] - first.values[move.name]) <= 5e-3 * (move.upper - move.lower)


def test_the_given_point_is_judged_by_the_roots_nearest_to_the_targets(solved):
    """Eigenpairs begun elsewhere may end on another root, and the point then counts as worse than it is."""
    task, answer = solved
    moves = tuple(replace(move, start=answer.values[move.name]) for move in task.moves)
    problem = replace(task, moves=moves).build()
    v = vector_of(task, answer)
    pairs = with_nearest_roots(problem, np.concatenate([v[: len(moves)], 0 * v[len(moves) :]]))
    np.testing.assert_allclose(pairs[len(moves) :], v[len(moves) :], atol=1e-4)
    point = given_end(problem)
    assert point.objective == pytest.approx(answer.objective, rel=1e-6)


def test_an_answer_with_an_adapter_held_is_one_of_the_programme_without_it(solved):
    """Here it is better than what the search without the adapter finds, which begins from other values."""
    task, best = solved
    adapter = next(move for move in task.moves if move.name.startswith("rig."))
    held = some_as_planned(task, best, [adapter])
    assert held.values[adapter.name] == pytest.approx(adapter.planned, rel=1e-12)
    assert held.objective > best.objective
    left = np.array([move is not adapter for move in task.moves])
    moves = tuple(move for move in task.moves if move is not adapter)
    case = apply(task.case, dict.fromkeys(adapter.together, adapter.planned))
    without = replace(task, case=case, moves=moves, weights=task.weights[left])
    problem = without.build()
    v = np.array([*(scaled(held.values[move.name], move) for move in moves), *held.pairs])
    assert float(problem.objective(v, problem.extra())[0]) == pytest.approx(held.objective, rel=1e-4)
    assert held.objective <= searching.warm(without, best).objective * (1 + 1e-3)
