"""What starts agree on is left again by searches from about it; the local search is a made-up one."""

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest

from matching.match import solve as perturbed
from matching.match.case_file import load_case
from matching.match.solve import End, solve
from tests.match import drawn
from tests.match.programme import programme_of


@dataclass
class MadeUp:
    """A programme of two quantities, nothing of which is solved."""

    moves: tuple = (SimpleNamespace(name="loop.integral_gain"), SimpleNamespace(name="rig.J"))
    lower: np.ndarray = field(default_factory=lambda: np.zeros(2))
    upper: np.ndarray = field(default_factory=lambda: np.ones(2))


PROBLEM = MadeUp()
BOTTOMS = (0.1, 0.45, 0.9)  # of basins in the first quantity; lower from right to left
BEGINS: list[float] = []
HELD: list[float] = []


def nearest_basin(problem, begin):
    """To the bottom of the nearest basin; objective 1, 2, 3 from left to right."""
    basin = int(np.argmin(np.abs(np.array(BOTTOMS) - begin[0])))
    return End(1.0 + basin, np.array([BOTTOMS[basin], begin[1]]), True)


def gain_with_inertia(problem, begin):
    """A small gain with a large inertia, 3, or a large gain with a small inertia, 1: which one, the inertia decides."""
    gain, inertia = begin
    if problem.lower[0] == problem.upper[0]:  # the gain is held: the inertia that goes with it, near either bottom
        return End(1.1 if gain > 0.6 else 3.1, np.array([gain, 0.1 if gain > 0.6 else 0.9]), True)
    return End(3.0, np.array([0.05, 0.9]), True) if inertia > 0.5 else End(1.0, np.array([0.95, 0.1]), True)


@pytest.fixture
def local_search(monkeypatch):
    """What a start leads to is asked of a made-up search."""
    searches = [nearest_basin]

    def ends(problem, begins):
        for begin in begins:
            (HELD if problem.lower[0] == problem.upper[0] else BEGINS).append(begin[0])
            yield searches[-1](problem, begin)

    BEGINS.clear()
    HELD.clear()
    monkeypatch.setattr(perturbed, "stable_ends", ends)
    monkeypatch.setattr(perturbed, "follows_targets", lambda task, end: True)
    monkeypatch.setattr(perturbed, "start", lambda problem, random: np.zeros(2))
    monkeypatch.setattr(perturbed, "merit", lambda problem, v: v[1])
    return searches


def test_a_poor_optimum_that_starts_agreed_on_is_left(local_search):
    """One gain at the other end of its range: the gain is held there and released, from any seed."""
    agreed = End(3.0, np.array([0.9, 0.5]), True)
    assert all(perturbed.improved(None, PROBLEM, agreed, seed).objective == 1.0 for seed in range(10))
    assert all(0.01 <= begin <= 0.99 for begin in BEGINS)


def test_a_gain_is_left_that_comes_back_unless_the_inertia_that_goes_with_it_is_tuned_first(local_search, monkeypatch):
    local_search.append(gain_with_inertia)
    monkeypatch.setattr(perturbed, "TRIED_ANYWHERE", 0)
    monkeypatch.setattr(perturbed, "STEPS", ())
    poor = End(3.0, np.array([0.05, 0.9]), True)
    assert gain_with_inertia(PROBLEM, np.array([0.98, 0.9])).objective == poor.objective  # the gain alone comes back
    assert perturbed.improved(None, PROBLEM, poor, 0).objective == 1.0


def test_the_best_is_kept_and_the_search_ends(local_search):
    best = End(1.0, np.array([0.1, 0.5]), True)
    assert perturbed.improved(None, PROBLEM, best, 0) is best
    assert [place for place in perturbed.PLACES if abs(place - 0.1) > perturbed.NEAR_PLACE] == HELD
    assert len(BEGINS) == perturbed.TRIED_ANYWHERE + len(perturbed.STEPS)  # what is held is far worse: not released


def test_where_a_held_gain_leads_nowhere_it_is_set_without_being_held(local_search, monkeypatch):
    """No loop keeps its limits with the gain held: still it is set there, free."""
    searched = perturbed.stable_ends
    none_held = lambda problem, begins: () if problem.lower[0] == problem.upper[0] else searched(problem, begins)  # noqa: E731
    monkeypatch.setattr(perturbed, "stable_ends", lambda *asked: iter(none_held(*asked)))
    monkeypatch.setattr(perturbed, "TRIED_ANYWHERE", 0)
    monkeypatch.setattr(perturbed, "STEPS", ())
    agreed = End(3.0, np.array([0.9, 0.5]), True)
    assert perturbed.improved(None, PROBLEM, agreed, 0).objective == 1.0


def test_what_lost_a_target_mode_is_no_improvement(local_search, monkeypatch):
    monkeypatch.setattr(perturbed, "follows_targets", lambda task, end: False)
    agreed = End(3.0, np.array([0.9, 0.5]), True)
    assert perturbed.improved(None, PROBLEM, agreed, 0) is agreed


def test_a_wider_bound_does_not_worsen_the_answer(tmp_path):
    """A drawn case whose starts agree on a small integral gain with a heavy residual vehicle.

    A gain at its bound with a lighter one is better by a tenth; the wider the bounds, the fewer starts came there.
    """
    task = programme_of(load_case(drawn.draw(34, tmp_path)))
    wider = replace(
        task,
        moves=tuple(
            replace(move, upper=3 * move.upper) if move.name.startswith("loop.") else move for move in task.moves
        ),
    )
    narrow_answer, wide_answer = solve(task, 0), solve(wider, 0)
    poor = min(objective for objective in narrow_answer.starts if objective is not None)
    assert narrow_answer.objective < 0.95 * poor
    assert wide_answer.objective < 0.95 * narrow_answer.objective
