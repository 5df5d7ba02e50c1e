"""What a fit foretells of unseen data: against the dense covariance, a fit of everything, and nested kinds."""

from dataclasses import replace

import numpy as np
import pytest

from matching.diagnosis.data import FitData, Segment
from matching.diagnosis.descent import Fit, polished, solve
from matching.diagnosis.holdout import HoldoutRun, RestOfRecordings, holdout_residuals, simulate_other
from matching.diagnosis.problem import base_problem
from matching.diagnosis.statistics import covariance, prediction
from modelling.model_file import from_dict

J, DRAG, NOISE = 0.5, 0.3, 0.02
SEEN = 60  # samples, which tell the drag badly

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


def told(seed: int, seen: int = SEEN) -> tuple[FitData, Fit, list[HoldoutRun]]:
    """A recording, a fit to its short beginning, and what that says of the rest."""
    data = whole(seed)
    beginning = replace(data, segments=(data.segments[0].part(0, seen),))
    fit = polished(solve(*base_problem(SYSTEM, beginning)))
    return data, fit, RestOfRecordings(data, [seen]).simulate(fit)


@pytest.mark.parametrize("spread", [1.0, 3.0])
def test_score_is_the_normal_density_with_the_covariance_of_the_variables(spread: float) -> None:
    data, fit, (one,) = told(1)
    own = prediction(fit, [one], 2.0)
    assert own is not None
    J, free = fit.values["inertias.rotor.J"], fit.values["inertias.rotor.drag"]
    time, start = data.segments[0].time[SEEN:], fit.starts[0][1]
    decay = np.exp(-free * time / J)
    level = start - 2 / free
    slopes = np.column_stack([
        level * decay * free * time / J**2,
        2 / free**2 * (decay - 1) - level * decay * time / J,
        decay,
    ])  # fmt: skip
    error = data.segments[0].readings[SEEN:, 0] - (2 / free + level * decay)
    slopes, error = slopes / NOISE, error / NOISE
    dense = spread * np.eye(len(error)) + slopes @ covariance(fit, 2.0) @ slopes.T
    expected = error @ np.linalg.solve(dense, error) + np.linalg.slogdet(dense / spread)[1]
    assert own.score(spread) == pytest.approx(expected, rel=1e-3)


def test_foretold_is_what_a_fit_of_everything_pays_more() -> None:
    data, fit, ahead = told(2)
    own = prediction(fit, ahead)
    assert own is not None
    both = solve(*base_problem(SYSTEM, data))
    raw = sum(float(np.sum(part**2)) for part in holdout_residuals(ahead))
    assert raw > 2 * len(data.segments[0].time)
    surprise = own.score(1.0) - np.linalg.slogdet(np.eye(len(own.gram)) + own.gram)[1]
    assert fit.cost + surprise == pytest.approx(both.cost, abs=3)
    assert sum(float(np.sum(part**2)) for part in own.updated) == pytest.approx(surprise, rel=0.05)


def test_start_states_of_another_recording_cost_nothing() -> None:
    """Parameters are known from one recording, the start of the other is not: two fits in one say the same."""
    data, fit, _ = told(3, 200)
    other = replace(data, segments=(whole(4).segments[0].part(100, 300),))
    own = prediction(fit, simulate_other(fit, other))
    assert own is not None
    seen = fit.problem.data.segments
    both = solve(*base_problem(SYSTEM, replace(data, segments=(*seen, *other.segments))))
    surprise = own.score(1.0) - np.linalg.slogdet(np.eye(len(own.gram)) + own.gram)[1]
    assert fit.cost + surprise == pytest.approx(both.cost, abs=1)
