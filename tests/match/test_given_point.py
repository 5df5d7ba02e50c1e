"""A search never answers worse than the point it is given."""

from dataclasses import replace

import pytest
from match import drawn

from matching.match import solve as searching
from matching.match.case_file import load_case
from matching.match.solve import given_end
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


def test_a_second_search_is_no_worse(solved):
    task, _ = solved
    given = given_end(task.build())
    again = searching.solve(task, seed=3, starts=1)
    assert again.objective <= given.objective
