"""Starts that are led from a shorter dead time, where none at the full one finds a good optimum."""

from dataclasses import replace
from pathlib import Path

import pytest

from matching.frequency.case.load import load_case
from matching.frequency.programme.problem import LEAST_OSCILLATION, eigenpairs
from matching.frequency.search.solve import Task, _follows, _led, _one
from tests.match.programme import programme_of

CASE = Path(__file__).parents[2] / "examples" / "road_to_rig" / "case.toml"


@pytest.fixture(scope="module")
def task() -> Task:
    """The reference case at 5 ms dead time."""
    case = load_case(CASE)
    case = replace(case, loop=case.loop.with_values({"dead_time": 0.005}))
    return programme_of(case)


def test_led_starts_beat_plain_ones_and_may_let_a_root_become_real(task):
    problem = task.build()
    plain = [end.objective for number in (3, 4) if (end := _one(problem, 0, number))]
    led = list(_led(task, 0, (1, 2, 3)))
    assert all(end and _follows(task, end) and end.objective < 0.6 * min(plain) for end in led)
    turning = [eigenpairs(end.v, len(problem.moves), task.case)[0, 1] for end in led]
    assert any(own < LEAST_OSCILLATION for own in turning)  # the 1.6 Hz mode is overdamped there
    for end in led:
        rows = problem.objective(end.v, problem.extra())[1].full().ravel()
        assert problem.violation(rows) < 1e-5
