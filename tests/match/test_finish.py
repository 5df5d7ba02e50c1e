"""Which of several ends is taken when each may give way to the margin between the frequencies of the grid."""

from types import SimpleNamespace

import numpy as np
import pytest

from matching.frequency.solver import finish as finishing
from matching.frequency.solver.ends import End
from matching.frequency.solver.task import Solution


def taken(monkeypatch, finished):
    """The objective taken of ends (objective before: objective after, holds), and those that were tried."""
    tried = []

    def finish(task, end, starts):
        after, holds = finished[end.objective]
        tried.append(end.objective)
        return Solution({}, after, starts, True, holds)

    monkeypatch.setattr(finishing, "finish", finish)
    ends = [End(objective, np.empty(0), True) for objective in finished]
    return finishing.first_that_holds(SimpleNamespace(), ends, ()).objective, tried


@pytest.mark.parametrize(
    ("finished", "best", "tried"),
    [
        ({1.8: (1.8, True), 1.0: (2.0, True), 1.5: (1.5, True)}, 1.5, [1.0, 1.5]),  # the second came out better
        ({1.0: (2.0, True), 1.5: (2.5, True), 3.0: (3.0, True)}, 2.0, [1.0, 1.5]),
        ({1.0: (1.1, True), 1.5: (1.5, True)}, 1.1, [1.0]),
        ({1.0: (1.0, False), 1.5: (1.6, True), 1.7: (1.7, True)}, 1.6, [1.0, 1.5]),
        ({1.0: (1.0, True), 1.001: (0.5, True)}, 1.0, [1.0]),  # the same optimum once more
        ({1.0: (1.0, False), 2.0: (2.0, False), 3.0: (3.0, False), 4.0: (4.0, True)}, 1.0, [1.0, 2.0, 3.0]),
    ],
)
def test_the_best_that_holds_is_taken(monkeypatch, finished, best, tried):
    assert taken(monkeypatch, finished) == (best, tried)
