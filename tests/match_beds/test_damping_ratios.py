"""Damping ratios of sampled loops from poles that are known."""

import numpy as np
import pytest

from matching.match.damping import damping_ratios

STEP = 1e-3


def pole(hertz, ratio):
    """z of a mode."""
    omega = 2 * np.pi * hertz
    return np.exp(STEP * omega * (-ratio + 1j * np.sqrt(1 - ratio**2)))


def test_ratios_of_swinging_poles_and_one_of_all_others():
    still = [0.9, 1e-4, 1e-4 * np.exp(1j), np.exp(STEP * (-0.2 + 0.9j))]  # real, forgotten, forgotten, a drift
    z = np.array([[pole(8.0, 0.02), pole(150.0, 0.6), pole(3.0, -0.01), *still]])
    assert damping_ratios(z, STEP)[0] == pytest.approx([0.02, 0.6, -0.01, 1, 1, 1, 1], rel=1e-9)


def test_a_slow_pair_swings_from_one_radian_a_second_on():
    for omega, ratio in ((0.99, 1.0), (1.01, 0.5 / np.hypot(0.5, 1.01))):
        z = np.array([[np.exp(STEP * (-0.5 + 1j * omega))]])
        assert damping_ratios(z, STEP)[0, 0] == pytest.approx(ratio, rel=1e-9)
