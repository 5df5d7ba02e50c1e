"""The small bed, with an observer."""

from __future__ import annotations

import pytest
from small_bed import write

from matching.match.attempt import question_of
from matching.match.case import Case
from matching.match.case_file import load_case
from matching.match.match import match_with_observer
from matching.match.result import MatchResult
from matching.match.tune_observer import Tuner, TuningEffort, tuner


@pytest.fixture(scope="session")
def small_case(tmp_path_factory: pytest.TempPathFactory) -> Case:
    """The case with ``observer``, at a dead time that is no multiple of the sample time."""
    return load_case(write(tmp_path_factory.mktemp("small")))


@pytest.fixture(scope="session")
def small_search(small_case: Case) -> Tuner:
    """The search on the small bed; it changes as it is used, so tests take copies."""
    return tuner(small_case, drawn=3, pool=6)


@pytest.fixture(scope="session")
def small_result(small_case: Case) -> MatchResult:
    """The small bed matched with little effort."""
    effort = TuningEffort(drawn=4, rounds=1, steps=1, fresh=8)
    return match_with_observer(question_of(small_case), 0, lambda _: None, effort)
