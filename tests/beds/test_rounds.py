"""The rounds of a search on made-up costs: steps add up and stay within what is allowed."""

import numpy as np
import pytest
from beds.test_blind_weights import Search

from matching.match import tune_observer as module
from matching.match.beds import Judged
from matching.match.tune_observer import TuningEffort, end_at, rounds


@pytest.mark.parametrize("most", [1, 3, 100])
def test_steps_add_up_and_end_the_rounds(most):
    search = Search(0.5)
    end = rounds(search, end_at(search, np.array([2.0, 0.0])), TuningEffort(rounds=9, steps=2), most)
    assert 1 <= end.steps <= most


@pytest.mark.parametrize(("gains", "count"), [((0.5, 0.004, 0.5), 2), ((0.5, 0.015, 0.004, 0.5), 3)])
def test_rounds_end_with_the_first_that_gains_less_than_a_hundredth(monkeypatch, gains, count):
    """Each round lowers the cost by a stated share of it."""
    costs = np.cumprod([1.0, *(1 - np.array(gains))])
    search, kept = Search(0.5), np.ones(4)
    search.judged = lambda logarithms: Judged(float(costs[round(logarithms[0])]), kept, kept)
    at = 0

    def improve(*_):
        nonlocal at
        at += 1
        return 1

    monkeypatch.setattr(module, "_improve", improve)
    monkeypatch.setattr(Search, "best", property(lambda self: np.array([float(at), 0.0])))
    end = rounds(search, end_at(search, np.zeros(2)), TuningEffort(rounds=len(gains)), 100)
    assert (end.steps, end.merit) == (count, pytest.approx(costs[count]))
