"""Several recordings that are not fitted judge together."""

import numpy as np
import pytest

from matching.diagnosis.diagnose import diagnose
from modelling.model_file import from_dict
from modelling.recordings.recording import Recording

J, DRAG, NOISE = 0.2, 0.5, 0.02
MODEL = {
    "inertias": {"rotor": {"J": J, "drag": {"value": DRAG, "lower": 0.1, "upper": 1.0}}},
    "inputs": {"motor": {"on": "rotor"}},
    "sensors": {"speed": {"measures": "speed", "of": "rotor", "uncertainty": NOISE}},
}


def recording(count: int, error: float, seed: int) -> Recording:
    """Steady vibration at 1.3 Hz, 4 N·m; the sensor errs by so much noise (rad/s)."""
    time, rate = 5e-3 * np.arange(count), 2 * np.pi * 1.3
    wave = 4 * np.exp(1j * rate * time)
    speed = (wave / (1j * rate * J + DRAG)).real + error * np.random.default_rng(seed).normal(size=count)
    return Recording(time, {"motor": wave.real, "speed": speed}, (), f"{seed}.csv", {})


def test_error_is_that_of_all_samples_held_out() -> None:
    fitted, small, large = recording(800, NOISE, 1), recording(400, NOISE, 2), recording(1200, 3 * NOISE, 3)
    found = diagnose(from_dict(MODEL), [fitted], [small, large])
    mean_square = (400 * NOISE**2 + 1200 * (3 * NOISE) ** 2) / 1600
    assert found.errors["speed"].after_holdout == pytest.approx(np.sqrt(mean_square), rel=0.05)
