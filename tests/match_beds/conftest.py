"""The small bed, with an observer."""

from __future__ import annotations

import pytest
from small_bed import write

from matching.match.case import Case
from matching.match.case_file import load_case
from matching.match.match import match
from matching.match.objective import Search, search_for
from matching.match.problem import problem_of
from matching.match.result import MatchResult
from matching.match.variables import SearchSettings


@pytest.fixture(scope="session")
def small_case(tmp_path_factory: pytest.TempPathFactory) -> Case:
    """The case with ``observer``, at a dead time that is no multiple of the sample time."""
    return load_case(write(tmp_path_factory.mktemp("small")))


@pytest.fixture
def small_search(small_case: Case) -> Search:
    """The search on the small bed."""
    problem = problem_of(small_case)
    return search_for(small_case, problem.moves, problem.shares, problem.demands, SearchSettings(drawn=3, pool=6))


@pytest.fixture(scope="session")
def small_result(small_case: Case) -> MatchResult:
    """The small bed matched with little effort."""
    return match(
        small_case, beds=8, settings=SearchSettings(drawn=4, pool=16, rounds=1, steps=8, emulated=0.0, scenarios=0)
    )
