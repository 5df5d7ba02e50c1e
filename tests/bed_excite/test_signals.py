"""Shapes of excitation in closed form."""

import numpy as np
import pytest

from matching.bed.excite import chirp, fade, multisine, steps

STEP = 1e-3


def test_a_window_rises_over_a_quarter_of_a_second_and_falls_alike():
    window, time = fade(2000, STEP), np.arange(2000) * STEP
    np.testing.assert_allclose(window[:250], np.sin(np.pi / 2 * time[:250] / 0.25) ** 2, atol=1e-12)
    assert (window[250:1750] == 1).all()
    np.testing.assert_array_equal(window, window[::-1])


def test_a_short_window_rises_over_a_quarter_of_itself():
    window = fade(400, STEP)
    assert np.flatnonzero(window == 1)[[0, -1]].tolist() == [100, 299]
    assert window[50] == pytest.approx(0.5)


def test_a_chirp_passes_every_frequency_when_it_should():
    """Frequency low·(high/low)^(t/T); its phase is 2π times the integral of that, by cumulated trapezoids."""
    low, high, samples = 2.0, 20.0, 4000
    found = chirp(low, high, 1, 3, samples, STEP)
    assert (found[:, [0, 2]] == 0).all()
    time = np.arange(samples) * STEP
    frequency = low * (high / low) ** (time / 4.0)
    phase = 2 * np.pi * np.concatenate([[0.0], np.cumsum((frequency[1:] + frequency[:-1]) / 2 * STEP)])
    np.testing.assert_allclose(found[:, 1], np.sin(phase) * fade(samples, STEP), atol=1e-4)


@pytest.mark.parametrize(
    ("at", "torque"),
    [(0.04, 0.0), (0.06, 1.0), (0.34, 1.0), (0.355, 0.0), (0.37, -1.0), (0.64, -1.0), (0.66, 0.0), (0.9, 0.0)],
)
def test_steps_go_up_through_zero_and_back(at, torque):
    """At shares of two seconds; each ramp takes 0.02 s, a hundredth of them: its middle is 0.005 after its start."""
    found = steps(0, 2, 2000, STEP)
    assert found[round(at * 2000), 0] == pytest.approx(torque, abs=1e-9)
    assert (found[:, 1] == 0).all()


def test_a_multisine_has_the_power_of_its_lines_on_their_inputs():
    """Whole periods in the flat part: the Fourier sum over them gives each line's mean square exactly."""
    lines, of_input = np.array([2.0, 3.0, 5.0, 7.0]), np.array([0, 1, 0, 1])
    powers = np.array([4.0, 9.0, 0.0, 1.0])
    found = multisine(lines, of_input, powers, 3, 3000, STEP, 7)
    flat = found[500:2500]
    spectrum = 2 * np.abs(np.fft.rfft(flat, axis=0) / 2000) ** 2  # mean squares
    for line, j, power in zip(lines, of_input, powers, strict=True):
        assert spectrum[round(2 * line), j] == pytest.approx(power, abs=1e-9)
    assert spectrum[:, 2].max() == 0
    assert spectrum.sum(axis=0) == pytest.approx([4.0, 10.0, 0.0])


def test_phases_are_drawn_for_a_small_peak():
    """Forty draws: flatter than nearly all sums of the same lines with phases of another seed."""
    lines = np.arange(1.0, 21.0)
    found = multisine(lines, np.zeros(20, int), np.ones(20), 1, 4000, STEP, 0)[500:3500]
    rng, time = np.random.default_rng(99), np.arange(500, 3500) * STEP
    peaks = [
        np.abs(np.sqrt(2) * np.cos(2 * np.pi * (lines[:, None] * time + rng.random((20, 1)))).sum(axis=0)).max()
        for _ in range(60)
    ]
    assert np.abs(found).max() < np.quantile(peaks, 0.1)
    again = multisine(lines, np.zeros(20, int), np.ones(20), 1, 4000, STEP, 0)[500:3500]
    np.testing.assert_array_equal(found, again)
    assert np.abs(multisine(lines, np.zeros(20, int), np.ones(20), 1, 4000, STEP, 1)[500:3500] - found).max() > 1
