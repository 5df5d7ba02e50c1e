"""Matching the tuned case again gains nothing: the search itself begins again at its answer, here a made-up one."""

from types import SimpleNamespace

import numpy as np
import pytest

from matching.match import solve as solving
from matching.match.solve import End, Solution

BEST = Solution({"gain": 0.4}, 6.1, (6.0,), feasible=True)
TRIED = [End(6.0, np.zeros(1), True), End(10.0, np.zeros(1), True)]


def again(monkeypatch, end, finished, holds=True, follows=True, best=BEST, torqueless=False):
    """The objective after a search from the best that ends at ``end`` and is finished to ``finished``."""
    ends = [] if end is None else [End(end, np.zeros(1), True)]
    begun = []
    monkeypatch.setattr(solving, "start_at", lambda problem, values: begun.append(values) or np.zeros(1))
    monkeypatch.setattr(solving, "stable_ends", lambda problem, begins: iter(ends))
    monkeypatch.setattr(solving, "follows_targets", lambda task, end: follows)
    monkeypatch.setattr(solving, "finish", lambda task, end, starts: Solution({}, finished, starts, True, holds))
    task = SimpleNamespace(case=SimpleNamespace(loop=SimpleNamespace(torqueless=torqueless)))
    answer = solving._searched_again(task, None, best, TRIED)
    assert begun in ([], [best.values])
    return answer.objective


@pytest.mark.parametrize(
    ("asked", "objective"),
    [
        ({"end": 5.8, "finished": 5.9}, 5.9),  # another optimum, better with the margin held
        ({"end": 5.8, "finished": 6.2}, 6.1),  # it gives way to the margin
        ({"end": 5.8, "finished": 5.9, "holds": False}, 6.1),
        ({"end": 5.8, "finished": 5.9, "follows": False}, 6.1),  # it lost a target mode
        ({"end": 5.99, "finished": 5.9}, 6.1),  # an end that was there before: the best came of it
        ({"end": 6.3, "finished": 5.9}, 6.1),  # worse than the best
        ({"end": None, "finished": 5.9}, 6.1),
        ({"end": 5.8, "finished": 5.9, "torqueless": True}, 6.1),  # no loop to search for
        ({"end": 5.8, "finished": 5.9, "best": Solution({}, 6.1, (), True, holds=False)}, 6.1),
    ],
)
def test_only_another_optimum_that_is_better_and_holds_is_taken(monkeypatch, asked, objective):
    assert again(monkeypatch, **asked) == objective
