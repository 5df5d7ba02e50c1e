"""What a model leaves of its sensors, as weights of the fit: autoregressive errors against their known figures."""

import numpy as np
import pytest
from scipy.signal import lfilter

from matching.diagnosis.data import Weighting, weighting_of
from matching.diagnosis.descent import power_left


def test_memory_and_scale_of_a_known_process() -> None:
    rng = np.random.default_rng(3)
    count, memory, scale = 200_000, 0.9, 50.0
    errors = np.column_stack([
        scale * lfilter([1], [1, -memory], rng.standard_normal(count)),
        7.0 * rng.standard_normal(count),
        rng.standard_normal(count),
    ])  # fmt: skip
    found = weighting_of([errors], [np.ones_like(errors, dtype=bool)])
    np.testing.assert_allclose(found.memory, [memory, 0, 0], atol=0.01)
    np.testing.assert_allclose(found.scale, [scale, 7.0, 1.0], rtol=0.01)
    weighted = found.weigh(errors[None], np.ones_like(errors, dtype=bool))[0]
    np.testing.assert_allclose(np.mean(weighted**2, axis=0), 1, atol=0.01)
    assert np.corrcoef(weighted[1:, 0], weighted[:-1, 0])[0, 1] == pytest.approx(0, abs=0.01)
    np.testing.assert_allclose(found.without_memory.scale, np.sqrt(np.mean(errors**2, axis=0)), rtol=0.01)


def test_what_is_stated_of_a_sensor_does_not_matter() -> None:
    errors = np.cumsum(np.random.default_rng(5).standard_normal((5000, 1)), axis=0)
    measured = np.ones((5000, 1), dtype=bool)
    one, other = weighting_of([errors], [measured]), weighting_of([errors / 300], [measured])
    np.testing.assert_allclose(one.weigh(errors[None], measured), other.weigh(errors[None] / 300, measured), rtol=1e-9)


def test_missing_readings_do_not_count_and_break_the_memory() -> None:
    weighting = Weighting(np.array([0.6]), np.array([2.0]))
    errors = np.array([[1.0], [3.0], [0.0], [5.0], [4.0]])
    measured = np.array([[True], [True], [False], [True], [True]])
    first = 0.8 / 2  # √(1 − 0.6²)/scale
    expected = [1.0 * first, (3 - 0.6) / 2, 0.0, 5 * first, (4 - 3) / 2]
    np.testing.assert_allclose(weighting.weigh(errors[None], measured)[0, :, 0], expected)


def test_adjoint_belongs_to_the_weighting() -> None:
    rng = np.random.default_rng(4)
    weighting = Weighting(np.array([0.6, 0.0]), np.array([2.0, 3.0]))
    measured = rng.random((40, 2)) > 0.2
    errors, weights = rng.standard_normal((2, 40, 2))
    forward = np.sum(weights * weighting.weigh(errors[None], measured)[0] * measured)
    assert forward == pytest.approx(np.sum(errors * weighting.weigh_transposed(weights, measured) * measured))


def test_power_left_of_a_known_process() -> None:
    """Power scale² of the innovation and scale²/(1 − memory²) of the error; their geometric mean."""
    rng, memory, scale = np.random.default_rng(8), 0.95, 4.0
    errors = scale * lfilter([1], [1, -memory], rng.standard_normal(200_000))[:, None]
    left = power_left([errors], [np.ones_like(errors, dtype=bool)])
    assert left == pytest.approx(scale**2 / np.sqrt(1 - memory**2), rel=0.03)
