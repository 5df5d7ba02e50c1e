"""The rounds of a search on made-up costs: steps add up and stay within what is allowed."""

import numpy as np
import pytest
from beds.test_blind_weights import Search

from matching.frequency.tuning.rounds import TuningEffort, end_at, rounds


@pytest.mark.parametrize("most", [1, 3, 100])
def test_steps_add_up_and_end_the_rounds(most):
    search = Search(0.5)
    end = rounds(search, end_at(search, np.array([2.0, 0.0])), TuningEffort(rounds=9, steps=2), most)
    assert 1 <= end.steps <= most
