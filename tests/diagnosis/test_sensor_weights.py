"""Sensors weighted by what the base model leaves of them."""

from types import SimpleNamespace

import numpy as np
import pytest

from matching.diagnosis import hypotheses
from matching.diagnosis.data import FEWEST_INDEPENDENT, FitData, Segment, weighting_of
from matching.diagnosis.descent import balanced_fit, innovation_power, iteratively_reweighted, solve
from matching.diagnosis.problem import base_problem
from modelling.model_file import from_dict


@pytest.mark.parametrize("angle_uncertainty", [6e-6, 2e-3])
def test_balanced_weights_do_not_depend_on_how_precise_an_encoder_is_said_to_be(angle_uncertainty: float) -> None:
    """The speed channel is filtered, which the model lacks; J = 0.5 kg·m² and drag 0.3 N·m·s/rad are what was made."""
    J, drag, lag = 0.5, 0.3, 0.02
    system = from_dict({
        "inertias": {"rotor": {"J": {"value": J, "tolerance": 0.3}, "drag": {"value": drag, "lower": 0, "upper": 3}}},
        "inputs": {"motor": {"on": "rotor"}},
        "sensors": {
            "angle": {"measures": "angle", "of": "rotor", "uncertainty": angle_uncertainty},
            "speed": {"measures": "speed", "of": "rotor", "uncertainty": 0.02},
        },
    })  # fmt: skip
    time = np.arange(0, 4, 2e-3)
    frequencies = 2 * np.pi * np.array([1.5, 4.0, 9.0, 17.0])
    response = 1 / (1j * frequencies * J + drag)
    waves = np.exp(1j * np.outer(time, frequencies))
    torque, speed = waves.real.sum(axis=1), (waves * response).real.sum(axis=1)
    angle = (waves * response / (1j * frequencies)).real.sum(axis=1)
    filtered = (waves * response / (1 + 1j * frequencies * lag)).real.sum(axis=1)
    noise = np.random.default_rng(3).normal(size=(2, len(time)))
    readings = np.stack([angle + 6e-6 * noise[0], filtered + 0.02 * noise[1]], axis=1)
    sensors = np.array([angle_uncertainty, 0.02])
    problem, v = base_problem(system, FitData([Segment(time, torque[:, None], readings)], sensors))
    by_noise = solve(problem, v)
    fit = balanced_fit(by_noise, v)
    assert innovation_power(fit) <= innovation_power(iteratively_reweighted(by_noise)) + 1e-9
    assert fit.values["inertias.rotor.J"] == pytest.approx(J, rel=0.02)
    assert speed.std() > filtered.std()


def test_no_sensor_is_switched_off() -> None:
    """An error that never changes would have the memory 1 and cost nothing: its readings count as a few at least."""
    errors, count = np.full((400, 1), 7.0), 399
    memory = float(weighting_of([errors], [np.ones_like(errors, dtype=bool)]).memory[0])
    assert count * (1 - memory) / (1 + memory) == pytest.approx(FEWEST_INDEPENDENT)


def test_the_pooled_error_is_that_of_readings_over_their_ranges() -> None:
    """Errors of 3 times 0.5 over a range of 8 and of 4 times 0.1 over one of 2; a missing reading does not count."""
    readings = np.array([[-3.0, 0.0, np.nan], [5.0, 2.0, np.nan], [0.0, np.nan, np.nan]])
    errors = np.array([[3.0, 4.0, 9.0], [-3.0, -4.0, 9.0], [3.0, 100.0, 9.0]])
    segment = SimpleNamespace(measured=np.isfinite(readings), readings=readings)
    data = SimpleNamespace(noise=np.array([0.5, 0.1, 1.0]), segments=[segment])
    fit = SimpleNamespace(errors=[errors], problem=SimpleNamespace(data=data))
    assert hypotheses.pooled_error(fit) == pytest.approx(np.sqrt(((1.5 / 8) ** 2 + 0.2**2) / 2), rel=1e-12)
