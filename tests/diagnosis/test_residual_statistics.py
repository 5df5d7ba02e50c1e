"""Statistics of residuals against noise whose properties are known."""

import numpy as np
import pytest
from scipy.signal import lfilter

from matching.diagnosis.statistics import effective_share, whiteness


def test_white_noise_is_found_white() -> None:
    rng = np.random.default_rng(1)
    found = whiteness([rng.standard_normal(20000), rng.standard_normal(5000)])
    assert found.ratio == pytest.approx(1, abs=0.02)
    assert np.all(np.abs(found.score) < 4)


def test_slow_part_far_below_the_noise_is_seen_at_long_scales() -> None:
    rng = np.random.default_rng(2)
    slow = 0.2 * np.sin(2 * np.pi * np.arange(20000) / 5000)
    found = whiteness([rng.standard_normal(20000) + slow])
    assert found.score[0] < 5
    assert found.score.max() > 8
    assert found.excess[int(np.argmax(found.score))] == pytest.approx(0.02, rel=0.3)


def test_missing_samples_are_not_counted() -> None:
    rng = np.random.default_rng(3)
    own = rng.standard_normal(8000)
    own[1000:1500] = np.nan
    assert whiteness([own]).ratio == pytest.approx(1, abs=0.03)


@pytest.mark.parametrize("memory", [0.0, 0.5, 0.9])
def test_effective_share_of_a_first_order_process(memory: float) -> None:
    rng = np.random.default_rng(4)
    own = lfilter([1], [1, -memory], rng.standard_normal(200_000))
    assert effective_share(own) == pytest.approx((1 - memory) / (1 + memory), rel=0.15)
