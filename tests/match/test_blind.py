"""Where no start leads to a stable loop, stable settings are found by drawing blindly, if there are any."""

from dataclasses import replace

import pytest
from match import drawn
from matching.match.continuous_loop import encirclements

from matching.match import solve as searching
from matching.match.case import apply
from matching.match.case_file import load_case
from modelling.bed.controllers import STRUCTURES
from tests.match.programme import programme_of


@pytest.fixture(scope="module")
def task(tmp_path_factory):
    """One dynamometer, feedback alone across 2 ms, gains that may be far too large: few settings are stable."""
    case = load_case(drawn.draw(2, tmp_path_factory.mktemp("drawn")))
    loop = replace(case.loop.with_values({"dead_time": 0.002}), structure=STRUCTURES["pi"])
    wide = {"proportional_gain": 10, "lead_time": 0.0}
    moves = tuple(
        replace(move, upper=move.upper * wide.get(move.name.removeprefix("loop."), 1.0) or 0.01) for move in case.moves
    )
    return programme_of(replace(case, loop=loop, moves=moves))


def test_a_search_whose_starts_all_fail_answers_with_a_stable_loop(task, monkeypatch):
    monkeypatch.setattr(searching, "_ends", lambda *_: (end for end in [None]))
    monkeypatch.setattr(searching, "continued_starts", lambda *_: iter(()))
    monkeypatch.setattr(searching, "given_end", lambda _: None)
    solution = searching.solve(task, starts=1)
    winding = encirclements(linear_bed(apply(task.case, solution.values)))
    assert winding.unstable == 0
    assert solution.feasible or solution.blind[1] > 0
