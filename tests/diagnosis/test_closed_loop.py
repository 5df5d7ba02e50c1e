"""Noise that comes back through a controller, against its share in closed form."""

import numpy as np
import pytest

from matching.diagnosis.closed_loop import share_fed_back

COUNT = 20_000


def recording(gain: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """White noise e and an input whose changes are white plus gain·e of the sample before."""
    rng = np.random.default_rng(seed)
    noise, changes = rng.standard_normal(COUNT), rng.standard_normal(COUNT)
    changes[1:] += gain * noise[:-1]
    return noise, np.cumsum(changes)


def test_share_of_a_controlled_input() -> None:
    """Power gain² of 1 + gain²."""
    assert share_fed_back([recording(0.3), recording(0.3, 1)]) == pytest.approx(0.09 / 1.09, rel=0.1)


@pytest.mark.parametrize("seed", range(5))
def test_an_input_without_feedback_has_none(seed: int) -> None:
    assert share_fed_back([recording(0.0, seed)]) == 0.0


def test_noise_after_the_input_is_no_feedback() -> None:
    """A sensor whose error follows the input before it: the model's error, not the controller's answer."""
    noise, signal = recording(0.0)
    noise[1:] += 0.5 * np.diff(signal)
    assert share_fed_back([(noise, signal)]) == 0.0


def test_a_constant_input_has_none() -> None:
    noise, _ = recording(0.0)
    assert share_fed_back([(noise, np.ones(COUNT))]) == 0.0
