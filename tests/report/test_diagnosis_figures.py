"""Spectra of residuals: white noise is 1 at every frequency and order, a wave stands where it belongs."""

import numpy as np
import pytest

from matching.report.diagnosis.residual_figure import _orders, _spectrum

RNG = np.random.default_rng(11)


def test_white_noise_is_one_over_frequency_and_orders() -> None:
    noise = RNG.standard_normal(20_000)
    frequency, amplitude = _spectrum(noise, 0.002)
    assert frequency[-1] == pytest.approx(250)
    assert np.sqrt(np.mean(amplitude[1:-1] ** 2)) == pytest.approx(1, abs=0.05)
    _, amplitude = _orders(noise, np.cumsum(RNG.uniform(0, 0.1, len(noise))))
    assert np.sqrt(np.mean(amplitude**2)) == pytest.approx(1, abs=0.15)


def test_a_wave_over_the_angle_shows_at_its_order_though_the_shaft_reverses() -> None:
    time = np.arange(0, 12, 0.001)
    angle = 30 * np.sin(0.9 * time) + 4 * time
    residual = RNG.standard_normal(len(time)) + 0.5 * np.sin(3 * angle + 0.4)
    residual[100:300] = np.nan
    order, amplitude = _orders(residual, angle)
    assert order[np.argmax(amplitude)] == pytest.approx(3, abs=0.03)
    expected = 0.5 * np.sqrt(np.isfinite(residual).sum()) / 2  # of a sine of amplitude ½ among so many readings
    assert amplitude.max() == pytest.approx(expected, rel=0.1)
    far = np.abs(order - 3) > 1  # the angle is not sampled evenly, so the wave leaks to the sides
    assert np.median(amplitude[far]) < 0.1 * expected


def test_a_wave_over_time_shows_at_its_frequency() -> None:
    time = np.arange(0, 12, 0.001)
    frequency, amplitude = _spectrum(RNG.standard_normal(len(time)) + np.sin(2 * np.pi * 7 * time), 0.001)
    assert frequency[np.argmax(amplitude)] == pytest.approx(7, abs=0.25)
