"""A search never answers worse than the point it is given."""

from dataclasses import replace

import numpy as np
import pytest
from match import drawn

from matching.match import solve as searching
from matching.match.case_file import load_case
from matching.match.solve import Solution, given_end, never_worse
from modelling.bed.controllers import STRUCTURES
from tests.match.programme import programme_of


@pytest.fixture(scope="module")
def solved(tmp_path_factory):
    """One dynamometer, feedback alone across 2 ms: a task that starts at its own solution, and that solution."""
    case = load_case(drawn.draw(2, tmp_path_factory.mktemp("drawn")))
    loop = replace(case.loop.with_values({"dead_time": 0.002}), structure=STRUCTURES["pi"])
    first = programme_of(replace(case, loop=loop))
    solution = searching.solve(first, starts=1)
    assert solution.feasible
    moves = tuple(replace(move, start=solution.values[move.name]) for move in first.moves)
    return replace(first, moves=moves), solution


def test_the_given_point_is_an_end_with_its_eigenpairs(solved):
    task, solution = solved
    given = given_end(task.build())
    assert given is not None
    assert given.objective <= solution.objective * (1 + 1e-6)  # no change is charged for at the start itself
    assert given.margin >= task.case.limits["modulus_margin"]


def test_a_second_search_is_no_worse(solved):
    task, _ = solved
    given = given_end(task.build())
    again = searching.solve(task, seed=3, starts=1)
    assert again.objective <= given.objective


def test_what_searches_find_elsewhere_does_not_replace_a_better_given_point(solved):
    task, solution = solved
    given = given_end(task.build())
    worse = replace(solution, objective=given.objective * 70)
    assert never_worse(task, worse, given).objective == given.objective
    assert never_worse(task, worse, given).values == {n: m.start for m in task.moves for n in m.together}
    better = replace(solution, objective=given.objective * 0.9)
    assert never_worse(task, better, given) is better
    assert never_worse(task, replace(better, holds=False), given).objective == given.objective
    assert never_worse(task, worse, None) is worse
    assert never_worse(task, worse, given._replace(margin=0.1)) is worse


def test_ends_that_agree_on_something_worse_than_the_given_point_do_not_agree(solved):
    task, _ = solved
    given = given_end(task.build())
    same = [given._replace(objective=2 * given.objective)] * 3
    assert not searching._agree(task, same, 3, given)
    assert searching._agree(task, same, 3, None)
    assert searching._agree(task, [given] * 3, 3, given)
    assert not searching._agree(task, [given, None, None], 3, given)


def test_an_infeasible_given_point_is_none(solved):
    task, _ = solved
    far = tuple(replace(move, start=move.upper) for move in task.moves)
    assert given_end(replace(task, moves=far).build()) is None
    assert isinstance(never_worse(task, Solution({}, float("nan"), (), False), None), Solution)
    assert np.isnan(never_worse(task, Solution({}, float("nan"), (), False), None).objective)
