"""What a fit leaves of another recording once its variables have adapted: against a fit of both."""

from dataclasses import replace

import numpy as np
import pytest

from matching.diagnosis.data import FitData, Segment
from matching.diagnosis.descent import polished, solve
from matching.diagnosis.holdout import holdout_residuals, simulate_other
from matching.diagnosis.problem import base_problem
from matching.diagnosis.statistics import adapted
from modelling.model_file import from_dict

J, DRAG, NOISE = 0.5, 0.3, 0.02

SYSTEM = from_dict({
    "inertias": {"rotor": {"J": {"value": 0.55, "tolerance": 0.9}, "drag": {"value": 0.25, "tolerance": 0.9}}},
    "inputs": {"motor": {"on": "rotor"}},
    "sensors": {"speed": {"measures": "speed", "of": "rotor", "uncertainty": NOISE}},
})  # fmt: skip


def whole(seed: int) -> FitData:
    """Speed of J·ω̇ = M − drag·ω after a step of 2 N·m, from 1 rad/s."""
    time = np.arange(0, 4, 0.01)
    speed = 2 / DRAG + (1 - 2 / DRAG) * np.exp(-DRAG * time / J)
    measured = speed + NOISE * np.random.default_rng(seed).standard_normal(len(time))
    return FitData((Segment(time, np.full((len(time), 1), 2.0), measured[:, None], "made"),), np.array([NOISE]))


@pytest.mark.parametrize("seen", [60, 200])
def test_what_is_left_is_that_of_a_fit_of_both(seen: int) -> None:
    """A short beginning tells the drag badly: it foretells the other recording badly, which speaks for no cause."""
    data = whole(seen)
    fit = polished(solve(*base_problem(SYSTEM, replace(data, segments=(data.segments[0].part(0, seen),)))))
    other = replace(data, segments=(whole(4).segments[0].part(100, 400),))
    runs = simulate_other(fit, other)
    left = adapted(fit, runs)
    assert left is not None
    both = solve(*base_problem(SYSTEM, replace(data, segments=(*fit.problem.data.segments, *other.segments))))
    told = float(np.sum(both.by_sensor()[1] ** 2))
    assert sum(float(np.sum(part**2)) for part in left) == pytest.approx(told, rel=0.02)
    raw = sum(float(np.sum(part**2)) for part in holdout_residuals(runs))
    assert raw > told
