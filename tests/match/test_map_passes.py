"""Passes that improve a map from its neighbours: on valleys known in closed form, and on real matches."""

import random
import time
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from pathlib import Path

import pytest
from match import drawn
from match.conftest import LITTLE

from matching.match import map as maps
from matching.match.case_file import load_case
from matching.match.map import AGREEMENT, Near, Point, improved, improved_at, map_case, match_at

CASE = Path(__file__).parents[2] / "examples" / "road_to_rig" / "case.toml"
STIFFNESS = "rig.shafts.flange_left.stiffness"
FLANGE = "rig.shafts.flange.stiffness"
AXES = ("loop.dead_time=1 ms,2 ms,3 ms,4 ms", f"{STIFFNESS}=1e5:4e5:3")


@pytest.fixture(scope="module")
def case():
    return load_case(CASE)


def depth(x, y, valley):
    """The objective at the bottom of a valley; which one is deepest changes across the map."""
    x, y = 1e3 * x, 1e-5 * y
    return 2 + x + 0.3 * y if valley == 0 else 3 + 0.2 * x + 0.3 * y


def point(x, y, valley, status="matched"):
    if valley is None:
        return Point(x, y, "limited", 9.0, 9.0, 0.0, True, 0.1, (), ("modulus_margin",))
    own = depth(x, y, valley)
    return Point(x, y, status, own, own, 0.0, True, 0.5, (), objective=own, first=own, values={"valley": valley})


def solved(tasks):
    """As the optimiser does it: from a neighbour's solution into the same valley, and better by enough or None."""
    found = []
    for task in tasks:
        best = min((point(task["x"], task["y"], values["valley"]) for values in task["near"]), key=depth_of)
        good = task["below"] is None or best.objective < task["below"] * (1 - AGREEMENT)
        found.append(best if good else None)
    return found


def depth_of(own):
    return own.objective


def test_a_valley_found_once_is_found_wherever_it_is_the_deepest():
    drawn = random.Random(3)
    rows = [[point(1e-3 * x, 1e5 * y, drawn.choice((0, 0, 1, None))) for x in range(7)] for y in range(6)]
    rows[0][0], rows[5][6] = point(0, 0, 0), point(6e-3, 5e5, 1)
    asked = []

    def counted(tasks):
        asked.append(len(tasks))
        return solved(tasks)

    end = improved(rows, counted)
    for y, row in enumerate(end):
        for x, own in enumerate(row):
            best = min(depth(1e-3 * x, 1e5 * y, valley) for valley in (0, 1))
            assert own.objective == pytest.approx(best, rel=AGREEMENT)
            assert own.first == rows[y][x].first
    assert asked[0] >= 40
    assert all(later < asked[0] for later in asked[1:])  # only where a neighbour changed
    assert asked[-1] > 0  # the last pass tried and changed nothing


def toy(monkeypatch, tried):
    """Matches replaced by the landscape above; where tried from starts of its own, a point lands by its place."""

    def alone(case, x, y, seed, starts):
        tried.append((x[1], y[1]))
        time.sleep(random.random() * 0.003)
        return point(x[1], y[1], round(1e3 * x[1] + 1e-5 * y[1]) % 3 % 2)

    def near(case, x, y, given):
        tried.append((x[1], y[1], given.below))
        time.sleep(random.random() * 0.003)
        task = {"x": x[1], "y": y[1], "below": given.below, "near": given.solutions}
        return solved([task])[0]

    monkeypatch.setattr(maps, "match_at", alone)
    monkeypatch.setattr(maps, "improved_at", near)


class Backwards(Executor):
    """Does the last task first, all of them once the last one is asked for; ``dies`` after so many."""

    def __init__(self, count, dies=None):
        self.waiting, self.count, self.left = [], count, dies

    def submit(self, work, /, *given):
        future = Future()
        self.waiting.append((future, work, given))
        if len(self.waiting) == self.count:
            self.count = None
        if self.count is None:
            self._work()
        return future

    def _work(self):
        while self.waiting:
            future, work, given = self.waiting.pop()
            if self.left == 0:
                future.set_exception(KeyboardInterrupt())
                continue
            self.left = None if self.left is None else self.left - 1
            future.set_result(work(*given))


def test_the_map_does_not_depend_on_the_order_in_which_points_end(case, monkeypatch):
    tried = []
    toy(monkeypatch, tried)
    found = []
    for executor in (ThreadPoolExecutor(1), ThreadPoolExecutor(4), Backwards(12)):
        found.append(map_case(case, *AXES, executor).to_dict())
    assert found[0] == found[1] == found[2]
    assert any(own["objective"] < own["objective_from_own_starts"] for own in found[0]["points"])


@pytest.mark.parametrize("after", [3, 12, 17])
def test_a_map_that_was_killed_goes_on_where_it_was(case, monkeypatch, tmp_path, after):
    whole, first, second = [], [], []
    toy(monkeypatch, whole)
    straight = map_case(case, *AXES, ThreadPoolExecutor(2)).to_dict()
    record = tmp_path / "map.jsonl"
    toy(monkeypatch, first)
    with pytest.raises(KeyboardInterrupt):
        map_case(case, *AXES, Backwards(12, dies=after), record=record)
    kept = len(record.read_text().splitlines()) if record.exists() else 0
    assert kept <= len(first) == after
    toy(monkeypatch, second)
    assert map_case(case, *AXES, ThreadPoolExecutor(2), record=record).to_dict() == straight
    assert len(second) == len(whole) - kept  # what is on record is not done again
    toy(monkeypatch, second)
    map_case(case, *AXES, ThreadPoolExecutor(2), record=record)
    assert len(second) == len(whole) - kept


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """One dynamometer, feed-forward, 12 ms."""
    return load_case(drawn.draw(2, tmp_path_factory.mktemp("drawn")))


@pytest.mark.long
def test_a_match_starts_from_a_neighbours_solution_and_says_where_that_is_no_better(small, monkeypatch):
    monkeypatch.setattr(maps, "OF_A_POINT", LITTLE)
    dead_time, here, beside = ("loop.dead_time", 2e-3), (FLANGE, 2e5), (FLANGE, 2.4e5)
    own = match_at(small, dead_time, here, 0, 1)
    near = (own.values,)
    assert own.first == own.objective
    assert improved_at(small, dead_time, here, Near(near, 0.5 * own.objective)) is None
    found = improved_at(small, dead_time, beside, Near(near, 1.1 * own.objective))
    assert found.objective < 1.05 * own.objective  # a flange a fifth stiffer changes little
    assert found.stable
