"""Noise from the scatter of readings, where the answer is known."""

import numpy as np
import pytest

from matching.diagnosis.data import SMALLEST, SMALLEST_SHARE, noise_from_scatter


def test_white_noise_on_a_smooth_signal_with_jumps_and_gaps():
    random = np.random.default_rng(1)
    time = np.linspace(0, 10, 20_001)
    reading = 30 * np.sin(2 * np.pi * time) + 0.05 * random.normal(size=len(time))
    reading[5000:] += 40.0
    reading[7000:7100] = np.nan
    assert noise_from_scatter([reading[:10_000], reading[10_000:]]) == pytest.approx(0.05, rel=0.03)


@pytest.mark.parametrize(
    ("parts", "least"),
    [([[3.0, -7.0]], 7 * SMALLEST_SHARE), ([[2.0] * 9], 2 * SMALLEST_SHARE), ([[0.0] * 9], SMALLEST)],
)
def test_without_scatter_it_is_the_least_that_a_reading_resolves(parts, least):
    """Two readings have no second difference, a constant none but zero."""
    assert noise_from_scatter([np.array(part) for part in parts]) == pytest.approx(least, rel=1e-12)
