"""What to order: the range that is as good, against ranges known beforehand."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from matching.match.adapters import HALVINGS, PLACES, Retuning
from matching.match.case import apply
from matching.match.case_file import case_files, load_case
from matching.match.solve import End
from tests.match.programme import programme_of

STARTER = Path(__file__).parents[2] / "matching" / "starter" / "case.toml"
ELSEWHERE = {
    "loop.proportional_gain": 150.0, "residual_vehicle.inertias.body.J": 190.0, "rig.shafts.flange.stiffness": 7.3e5,
}  # fmt: skip


class MadeUp(Retuning):
    """One quantity whose answer is as good between two values; nothing is solved."""

    def __init__(self, low, high, ordered):
        self.low, self.high, self.ordered, self.ends = low, high, ordered, {}
        self.solution = SimpleNamespace(as_good_to=1.0)
        self.asked = []

    def _tuned(self, place):
        self.asked.append(place)
        return None if place > 0.97 else End(1.0 if self.low <= place <= self.high else 2.0, np.zeros(1), True)


@pytest.mark.parametrize(("low", "high", "at"), [(0.3, 0.8, 0.6), (-1.0, 2.0, 0.5), (0.45, 3.0, 0.5), (0.0, 0.02, 0.0)])
def test_the_range_that_is_as_good_is_found_to_a_part_of_the_way_to_the_next_value_tried(low, high, at):
    retuning = MadeUp(low, high, at)
    retuning.survey(0.1)
    assert set(retuning.ends) == {*PLACES, at, 0.1}
    first, last = retuning.as_good_between()
    low, high = max(low, 0.0), min(high, 0.97)
    step = (PLACES[1] - PLACES[0]) / 2**HALVINGS
    assert low <= first <= low + step
    assert high - step <= last <= high


def test_each_value_is_tuned_next_to_one_that_was():
    """It begins from its nearest neighbour's answer: from the ordered value upwards, then from there downwards."""
    retuning = MadeUp(0.0, 1.0, 0.6)
    retuning.survey()
    assert retuning.asked == [0.6, 0.75, 1.0, 0.5, 0.25, 0.0]


class TwoOptima(Retuning):
    """A good optimum, slowly falling, that steps of more than 0.1 leave for a poor one; none at all beyond a value."""

    def __init__(self, none_above=2.0):
        self.ordered, self.ends, self.none_above = 0.5, {}, none_above
        self.solution = SimpleNamespace(as_good_to=1.0)
        self.begin = np.array([0.5, 1.0])  # the value that it was tuned for, and whether at the good optimum

    def _tuned_from(self, start, place):
        good = start[1] and abs(place - start[0]) < 0.1
        if place > self.none_above and not good:
            return None
        return End(1.2 - 0.4 * place if good else 2.0, np.array([place, good]), True)


@pytest.mark.parametrize("none_above", [2.0, 0.9])
def test_the_error_over_a_quantity_does_not_jump_to_another_optimum(none_above):
    """At both ends, where a step from the neighbour leads to a poor optimum or to no loop at all."""
    retuning = TwoOptima(none_above)
    retuning.survey()
    assert any(end is None or end.objective == 2.0 for end in retuning.ends.values())
    retuning.follow_neighbours()
    assert {place: end.objective for place, end in retuning.ends.items()} == pytest.approx(
        {place: 1.2 - 0.4 * place for place in PLACES}
    )


def test_what_is_looked_for_does_not_depend_on_where_one_starts(tmp_path):
    """A case matched before, read again from its files: the same objective, weights and bed as planned."""
    case = load_case(STARTER)
    for name, text in case_files(apply(case, ELSEWHERE)).items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    again = load_case(tmp_path / "case.toml")
    starts = {move.name: move.start for move in again.moves}
    assert starts == {move.name: move.start for move in case.moves} | ELSEWHERE  # it does start elsewhere
    planned = [each.rig.parameters["shafts.flange.stiffness"] for each in (case, again)]
    np.testing.assert_allclose(*([each.value, each.lower, each.upper] for each in planned), rtol=1e-12)
    tasks = [programme_of(each) for each in (case, again)]
    assert [move.name for move in tasks[0].moves] == [move.name for move in tasks[1].moves]
    np.testing.assert_allclose(tasks[0].weights, tasks[1].weights, rtol=1e-12)
    problems = [task.build(compiled=False) for task in tasks]
    v = np.random.default_rng(1).uniform(0.2, 0.8, len(problems[0].lower))
    first, second = (problem.objective(v, problem.extra()) for problem in problems)
    np.testing.assert_allclose(float(first[0]), float(second[0]), rtol=1e-9)
    np.testing.assert_allclose(first[1].full(), second[1].full(), rtol=1e-9)
    changes = [replace(task, error_limit=1.0).build(compiled=False) for task in tasks]
    there, here = (float(problem.objective(v, problem.extra())[0]) for problem in changes)
    assert there == pytest.approx(here, rel=1e-9)
    moved = replace(tasks[0], moves=tuple(replace(move, planned=move.upper) for move in tasks[0].moves))
    moved = replace(moved, error_limit=1.0).build(compiled=False)
    assert float(moved.objective(v, moved.extra())[0]) != pytest.approx(there, rel=1e-3)


def test_the_range_of_an_adapter_goes_with_what_is_ordered():
    """Made within 10 %: a flange that is ordered twice as stiff is, too; a tolerance study draws it from there."""
    case = load_case(STARTER)
    flange = case.rig.parameters["shafts.flange.stiffness"]
    ordered = apply(case, {"rig.shafts.flange.stiffness": 2 * flange.value}).rig.parameters["shafts.flange.stiffness"]
    assert (ordered.lower, ordered.upper) == pytest.approx((2 * flange.lower, 2 * flange.upper))
    assert (flange.lower, flange.upper) == pytest.approx((0.9 * flange.value, 1.1 * flange.value))
