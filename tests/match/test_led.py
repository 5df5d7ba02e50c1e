"""Starts that are led from a shorter dead time, where none at the full one finds a good optimum."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from matching.frequency.attempt import task_of
from matching.frequency.case import load_case
from matching.frequency.demands import demands
from matching.frequency.goals import target_modes
from matching.frequency.problem import OSCILLATING
from matching.frequency.solve import Task, _follows, _led, _one
from matching.frequency.weights import FREEZE_BELOW, counterparts, share
from modelling.modes import modes

CASE = Path(__file__).parents[2] / "examples" / "road_to_rig" / "case.toml"


@pytest.fixture(scope="module")
def task() -> Task:
    """The reference case at 5 ms dead time."""
    case = load_case(CASE)
    case = replace(case, loop=case.loop.with_values({"dead_time": 0.005}))
    vehicle, on_rig = modes(case.vehicle), counterparts(case)
    shares = np.array([share(case, move, vehicle, on_rig) for move in case.moves])
    free = [move for move, part in zip(case.moves, shares, strict=True) if part >= FREEZE_BELOW]
    return task_of(case, shares, free, target_modes(case), demands(case))


def test_led_starts_beat_plain_ones_and_may_let_a_root_become_real(task):
    problem = task.build()
    plain = [end.objective for number in (3, 4) if (end := _one(problem, 0, number))]
    led = [_led(task, 0, number) for number in (1, 2, 3)]
    assert all(end and _follows(task, end) and end.objective < 0.6 * min(plain) for end in led)
    assert any(end.v[len(problem.moves) + 1] < OSCILLATING for end in led)  # the 1.6 Hz mode is overdamped there
    for end in led:
        rows = problem.objective(end.v, problem.extra())[1].full().ravel()
        assert problem.violation(rows) < 1e-5
