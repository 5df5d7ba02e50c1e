"""The standard uncertainty of a delay covers the truth as often as it says, over drawn signals, rates and noises."""

import numpy as np
import pytest
from scipy.stats import binom, chi2

from modelling.fidelity.delay import corner_energy
from tests.fidelity.drawn_delays import RATES, deviations, kinked, smooth

CHANCE = 5e-4  # on either side that a right estimate fails a test


def limits_of_share(draws, lower=0.95, upper=0.95):
    """Shares of ``draws`` that intervals covering between ``lower`` and ``upper`` of all stay within."""
    return binom.ppf(CHANCE, draws, lower) / draws, binom.ppf(1 - CHANCE, draws, upper) / draws


def test_coverage_at_50_hz():
    """Smooth and kinked, in white and coloured noise, 1 and 10 %: each kind scattered as stated, all cover 95 %."""
    kinds = [(smooth, True, 0.01), (smooth, False, 0.1), (kinked, False, 0.01), (kinked, True, 0.1)]
    groups = [deviations(signal, coloured, 50.0, level, 30) for signal, coloured, level in kinds]
    for errors in groups:
        low, high = np.sqrt(chi2.ppf([CHANCE, 1 - CHANCE], len(errors)) / len(errors))
        assert 0.9 * low < np.sqrt(np.mean(errors**2)) < 1.1 * high  # 93 and 97 % mean 1.08 and 0.90 times the rms
    every = np.concatenate(groups)
    assert len(every) >= 115
    low, high = limits_of_share(len(every))
    assert low <= np.mean(np.abs(every) < 1.96) <= high


def test_corners_between_samples_are_what_moves_a_delay_without_noise():
    """Ramps sampled at 50 Hz with hardly any noise: the residual alone would tell a fraction of these errors."""
    errors = deviations(kinked, False, 50.0, 1e-4, 40)
    low, high = np.sqrt(chi2.ppf([CHANCE, 1 - CHANCE], 40) / 40)
    # A few narrow ramps decide, so the errors have longer tails than normal ones, at worst a factor of 1.5 in the rms.
    assert low / 1.2 < np.sqrt(np.mean(errors**2)) < 1.5 * high


def test_energy_of_corners_is_the_square_of_their_change_of_slope():
    """Averaged over places between samples; smooth parts and noise add nothing."""
    t, slope = np.arange(400.0), 0.3
    totals = []
    for part in np.linspace(0, 1, 20, endpoint=False):
        signal = slope * np.maximum(t - 200 - part, 0) + np.sin(0.2 * t)
        totals.append(corner_energy(signal)[100:300].sum())
    assert np.mean(totals) == pytest.approx(slope**2, rel=0.02)
    white = np.random.default_rng(0).standard_normal(20_000)
    assert abs(corner_energy(white).mean()) < 0.05 * np.mean(corner_energy(white) ** 2) ** 0.5


@pytest.mark.long
@pytest.mark.parametrize("rate", RATES)
def test_coverage_from_50_hz_to_10_khz(rate):
    """93 to 97 % in each cell, smooth and kinked, in white and coloured noise of 1 % and 10 %."""
    for signal in (smooth, kinked):
        for coloured in (False, True):
            for level in (0.01, 0.1):
                errors = deviations(signal, coloured, rate, level, 100)
                low, high = limits_of_share(len(errors), 0.93, 0.97)
                assert low <= np.mean(np.abs(errors) < 1.96) <= high
