"""Which of several ends is taken when each may give way to the margin between the frequencies of the grid."""

from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest

from matching.match import solve as finishing
from matching.match.solve import End, Solution


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


@dataclass
class NoLoopFarAway:
    """A programme whose search leaves the start's optimum unless it is held near by."""

    moves: tuple = (SimpleNamespace(name="loop.integral_gain"), SimpleNamespace(name="rig.J"))
    lower: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, -np.inf]))
    upper: np.ndarray = field(default_factory=lambda: np.array([1.0, 1.0, np.inf]))

    def build(self, **asked):
        return self

    def missed(self, v):
        return np.zeros(0)

    def values(self, v):
        return {"gain": v[0]}


def test_where_the_margin_is_missed_by_far_the_optimum_is_kept_by_small_steps(monkeypatch):
    """The whole range leads to an unstable loop, gentler loops to a poor optimum: the answer stays by the end."""

    def ends(problem, begins, extra=()):
        for begin in begins:
            if (problem.upper[:2] - problem.lower[:2] < 0.1).all():
                assert np.isinf(problem.upper[2])  # eigenpairs are free
                yield End(1.1, begin, True, margin=0.5)
            elif begin[0] < 0.8:
                yield End(2.0, begin, True, margin=0.5)

    monkeypatch.setattr(finishing, "stable_ends", ends)
    task = SimpleNamespace(build=NoLoopFarAway().build, case=SimpleNamespace(limits={"modulus_margin": 0.4}))
    end = End(1.0, np.array([0.8, 0.5, 0.3]), True, margin=0.2, margin_frequency=25.0)
    assert finishing.finish(task, end, ()).objective == 1.1
