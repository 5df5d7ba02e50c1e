"""Responses from recordings: closed-form systems, several recordings, honest variances."""

import numpy as np
import pytest
from scipy.signal import lfilter

from matching.bed.measured import estimated_response as response
from matching.bed.measured import measured_mode, spectra

STEP = 0.005
FREQUENCIES = np.geomspace(0.5, 20, 40)


def resonance(f, frequency=1.6, damping=0.02):
    """H of a sampled pair of poles, in closed form, and its coefficients."""
    pole = np.exp(2 * np.pi * frequency * STEP * (-damping + 1j * np.sqrt(1 - damping**2)))
    a = np.real(np.poly([pole, pole.conjugate()]))
    z = np.exp(2j * np.pi * f * STEP)
    return 1 / (a[0] + a[1] / z + a[2] / z**2), a


def recorded(rng, count, active=(True, True), noise=0.0):
    u = np.stack([rng.normal(size=count) * on for on in active], axis=1)
    _, a = resonance(FREQUENCIES)
    _, b = resonance(FREQUENCIES, 8.0, 0.05)
    y = lfilter([1.0], a, u[:, 0]) + 3 * lfilter([1.0], b, u[:, 1])
    return u, (y + noise * rng.normal(size=count))[:, None]


def truth():
    return np.stack([resonance(FREQUENCIES)[0], 3 * resonance(FREQUENCIES, 8.0, 0.05)[0]], axis=1)


def test_two_inputs_at_once_beside_a_lightly_damped_mode():
    """No window, no periods: transient of the beginning and leakage go into the local model."""
    found = response([spectra(*recorded(np.random.default_rng(0), 8000), STEP, 30)], FREQUENCIES)
    np.testing.assert_allclose(found.values[:, 0], truth(), rtol=0.02)


def test_each_input_in_a_recording_of_its_own():
    rng = np.random.default_rng(1)
    own = [spectra(*recorded(rng, 6000, active), STEP, 30) for active in ((True, False), (False, True))]
    np.testing.assert_allclose(response(own, FREQUENCIES).values[:, 0], truth(), rtol=0.02)


def test_variances_are_those_that_repeated_recordings_show():
    values, stated = [], []
    for seed in range(60):
        found = response([spectra(*recorded(np.random.default_rng(seed), 4000, noise=3.0), STEP, 30)], FREQUENCIES[::5])
        values.append(found.values[:, 0])
        stated.append(found.variances[:, 0])
    scatter = np.var(np.array(values), axis=0)
    assert 0.6 < np.median(np.mean(stated, axis=0) / scatter) < 1.6


def test_an_input_that_never_moves_is_not_determined():
    found = response([spectra(*recorded(np.random.default_rng(2), 4000, (True, False)), STEP, 30)], FREQUENCIES)
    assert np.isnan(found.values).all()


def test_a_recording_with_too_few_lines():
    with pytest.raises(ValueError, match="lines are needed"):
        response([spectra(*recorded(np.random.default_rng(3), 60), STEP, 30)], FREQUENCIES)


def test_mode_with_its_uncertainty():
    """Frequency and damping of the sampled pair of poles, within the uncertainty stated, over drawn noise."""
    fine = np.geomspace(1.25, 2.05, 60)
    off = []
    for seed in range(12):
        own = response([spectra(*recorded(np.random.default_rng(seed), 12000, noise=5.0), STEP, 30)], fine)
        mode = measured_mode([own.function(0, 0)], 1.5, 0.05)
        off.append(
            [
                (mode.frequency - 1.6) / mode.frequency_uncertainty,
                (mode.damping_ratio - 0.02) / mode.damping_uncertainty,
            ]
        )
    assert np.abs(off).max() < 5
    assert 0.2 < np.sqrt(np.mean(np.square(off))) < 2.5


def test_a_mode_that_does_not_show():
    fine = np.geomspace(3.0, 5.0, 60)
    own = response([spectra(*recorded(np.random.default_rng(4), 12000, noise=30.0), STEP, 30)], fine)
    assert measured_mode([own.function(0, 0)], 4.0, 0.02) is None
