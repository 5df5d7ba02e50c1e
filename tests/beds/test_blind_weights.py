"""Where every start of the structure's is stuck with a requirement missed, weights are sought over all bounds."""

from types import SimpleNamespace

import numpy as np
import pytest

from matching.frequency.beds.design_point import Judged
from matching.frequency.beds.tune import TuningEffort, tuned_weights

NAMES = ("command_weight", "torque_drift")


class Search:
    """Two weights; below 10³ of the first a requirement is missed and 1 is cheapest, beyond it is kept, best at 10⁴."""

    def __init__(self, missed):
        quantities = dict.fromkeys(NAMES, SimpleNamespace(lower=1e-6, upper=1e6))
        structure = SimpleNamespace(quantities=quantities, further_starts=())
        self.case = SimpleNamespace(loop=SimpleNamespace(structure=structure, values=dict.fromkeys(NAMES, 1.0)))
        self.gains, self.missed, self.known = SimpleNamespace(names=NAMES), missed, {}

    def guard(self, logarithms):
        self.known.clear()

    def judged(self, logarithms):
        best, cost, left = self.minimum(logarithms)
        room = np.array([1.0, left, 0.5, 0.5])
        return self.known.setdefault(tuple(logarithms), Judged(cost + (logarithms[0] - best) ** 2, room, room))

    def minimum(self, logarithms):
        return (4.0, 0.1, 0.2) if logarithms[0] > 3 else (0.0, 0.5, -self.missed)

    def slopes(self, logarithms):
        return np.array([2 * (logarithms[0] - self.minimum(logarithms)[0]), 0.0]), np.zeros((4, 2))

    @property
    def best(self):
        return np.array(min(self.known, key=lambda key: self.known[key].merit))


@pytest.mark.parametrize(
    ("missed", "weight", "cost"), [(0.5, 1e4, 0.1), (0.02, 1.0, 0.5)], ids=["missed", "within the reserve"]
)
def test_settings_are_drawn_where_every_start_misses_a_requirement(missed, weight, cost):
    weights, reached = tuned_weights(Search(missed), TuningEffort(rounds=9, scenarios=0))
    assert reached == pytest.approx(cost, abs=1e-3)
    assert weights["command_weight"] == pytest.approx(weight, rel=0.1)
