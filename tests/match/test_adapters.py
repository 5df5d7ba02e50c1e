"""What to order: the range that is as good, against ranges known beforehand."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from matching.frequency.case.case_file import case_files
from matching.frequency.case.load import load_case
from matching.frequency.case.tuned import apply
from matching.frequency.search.adapters import HALVINGS, as_good_between
from tests.match.programme import programme_of

STARTER = Path(__file__).parents[2] / "matching" / "starter" / "case.toml"
ELSEWHERE = {
    "loop.proportional_gain": 150.0, "residual_vehicle.inertias.body.J": 190.0, "rig.shafts.flange.stiffness": 7.3e5,
}  # fmt: skip


@pytest.mark.parametrize(("low", "high", "at"), [(0.3, 0.8, 0.5), (-1.0, 2.0, 0.5), (0.45, 3.0, 0.5), (0.0, 0.02, 0.0)])
def test_the_range_that_is_as_good_is_found_to_a_part_of_the_way_to_its_bound(low, high, at):
    tried = []

    def as_good(part):
        tried.append(part)
        return low <= part <= high

    first, last = as_good_between(as_good, at)
    low, high = max(low, 0.0), min(high, 1.0)
    assert low <= first <= low + (at - 0.0) / 2**HALVINGS
    assert high - (1.0 - at) / 2**HALVINGS <= last <= high
    assert all(0 <= part <= 1 for part in tried)
    assert len(tried) <= 2 * (HALVINGS + 1)


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
    moved = replace(tasks[0], moves=tuple(replace(move, planned=move.upper) for move in tasks[0].moves))
    assert float(moved.build(compiled=False).objective(v, problems[0].extra())[0]) != float(first[0])


def test_the_range_of_an_adapter_goes_with_what_is_ordered():
    """Made within 10 %: a flange that is ordered twice as stiff is, too; a tolerance study draws it from there."""
    case = load_case(STARTER)
    flange = case.rig.parameters["shafts.flange.stiffness"]
    ordered = apply(case, {"rig.shafts.flange.stiffness": 2 * flange.value}).rig.parameters["shafts.flange.stiffness"]
    assert (ordered.lower, ordered.upper) == pytest.approx((2 * flange.lower, 2 * flange.upper))
    assert (flange.lower, flange.upper) == pytest.approx((0.9 * flange.value, 1.1 * flange.value))
