"""What starts agree on is left again by searches from about it; the local search is a made-up one."""

from types import SimpleNamespace

import numpy as np
import pytest

from matching.frequency.solver import perturbed
from matching.frequency.solver.ends import End

PROBLEM = SimpleNamespace(moves=(SimpleNamespace(name="loop.integral_gain"), SimpleNamespace(name="rig.J")))
BOTTOMS = (0.1, 0.45, 0.9)  # of basins in the first quantity; lower from right to left
BEGINS: list[float] = []


@pytest.fixture(autouse=True)
def local_search(monkeypatch):
    """From a start to the bottom of the nearest basin; objective 1, 2, 3 from left to right."""

    def ends(problem, begins):
        for begin in begins:
            BEGINS.append(begin[0])
            basin = int(np.argmin(np.abs(np.array(BOTTOMS) - begin[0])))
            yield End(1.0 + basin, np.array([BOTTOMS[basin], begin[1]]), True)

    BEGINS.clear()
    monkeypatch.setattr(perturbed, "stable_ends", ends)
    monkeypatch.setattr(perturbed, "follows_targets", lambda task, end: True)
    monkeypatch.setattr(perturbed, "start", lambda problem, random: np.zeros(2))
    monkeypatch.setattr(perturbed, "merit", lambda problem, v: v[1])


def test_a_poor_optimum_that_starts_agreed_on_is_left():
    """One gain at the other end of its range: the gain is set there by itself, from any seed."""
    agreed = End(3.0, np.array([0.9, 0.5]), True)
    assert all(perturbed.improved(None, PROBLEM, agreed, seed).objective == 1.0 for seed in range(10))
    assert all(0.01 <= begin <= 0.99 for begin in BEGINS)


def test_the_best_is_kept_and_the_search_ends():
    best = End(1.0, np.array([0.1, 0.5]), True)
    assert perturbed.improved(None, PROBLEM, best, 0) is best
    places = len(perturbed.PLACES) - 1  # at one of them the gain is already
    assert len(BEGINS) == places + perturbed.TRIED_ANYWHERE + len(perturbed.STEPS)


def test_what_lost_a_target_mode_is_no_improvement(monkeypatch):
    monkeypatch.setattr(perturbed, "follows_targets", lambda task, end: False)
    agreed = End(3.0, np.array([0.9, 0.5]), True)
    assert perturbed.improved(None, PROBLEM, agreed, 0) is agreed
