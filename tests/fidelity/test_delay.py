"""Sub-sample delay: recovered at 20 dB, its uncertainty honest, and undetermined where nothing determines it."""

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline
from scipy.signal import butter, sosfiltfilt

from modelling.fidelity.delay import delay

COUNT, STEP = 2000, 1e-3


def tip_ins(x):
    """Torque of a drive that is tipped in and backed out with a shuffle at 25 Hz, over samples."""
    total = np.zeros_like(x)
    for start, height in ((300, 1.0), (700, -0.7), (1100, 0.9), (1500, -1.2)):
        since = np.maximum(x - start, 0.0)
        total += height * (1 - np.exp(-0.05 * since) * np.cos(2 * np.pi * 0.025 * since))
    return total


def chirp(x):
    return np.sin(2 * np.pi * (0.002 * x + 0.05 * x**2 / COUNT))


def band_noise(seed, cutoff=0.3):
    """Band-limited noise as a function of a real-valued sample number."""
    raw = np.random.default_rng(seed).standard_normal(COUNT + 400)
    return make_interp_spline(np.arange(-200.0, COUNT + 200), sosfiltfilt(butter(6, cutoff, output="sos"), raw), k=5)


def pair(signal, lag, noise, seed):
    generator, x = np.random.default_rng(seed), np.arange(float(COUNT))
    clean = signal(x)
    spread = noise * np.std(clean)  # 20 dB: a tenth of the signal's standard deviation
    return (
        clean + spread * generator.standard_normal(COUNT),
        0.9 * signal(x - lag) + 0.3 + spread * generator.standard_normal(COUNT),
    )


@pytest.mark.parametrize("kind", ["chirp", "noise", "tip-ins"])
def test_recovered_to_a_twentieth_of_a_sample_at_20_db(kind):
    errors, uncertainties = [], []
    for seed in range(12):
        lag = float(np.random.default_rng(1000 + seed).uniform(-30, 30))
        signal = {"chirp": chirp, "noise": band_noise(seed), "tip-ins": tip_ins}[kind]
        found = delay(*pair(signal, lag, 0.1, seed), STEP)
        assert found.value is not None, found.reason
        errors.append(found.value / STEP - lag)
        uncertainties.append(found.standard_uncertainty / STEP)
    errors, uncertainties = np.array(errors), np.array(uncertainties)
    limit = 0.05 if kind != "tip-ins" else 0.25  # slow signals: no estimator can do better, see the next test
    assert np.max(np.abs(errors)) < limit
    assert 0.6 < np.sqrt(np.mean((errors / uncertainties) ** 2)) < 1.6


def test_near_the_bound_of_cramer_and_rao():
    """For white noise in both signals no unbiased estimator scatters less than σ√2/‖slope‖; this one is close to it."""
    errors, bounds = [], []
    x = np.arange(float(COUNT))
    for seed in range(16):
        lag = float(np.random.default_rng(2000 + seed).uniform(-30, 30))
        found = delay(*pair(tip_ins, lag, 0.1, seed), STEP)
        errors.append(found.value / STEP - lag)
        slope = np.gradient(tip_ins(x))
        bounds.append(0.1 * np.std(tip_ins(x)) * np.sqrt(1 + 1 / 0.81) / np.linalg.norm(slope - slope.mean()))
    assert np.sqrt(np.mean(np.square(errors))) < 1.6 * np.mean(bounds)


def test_exact_without_noise():
    x = np.arange(float(COUNT))
    assert delay(chirp(x), chirp(x - 7.3), STEP).value == pytest.approx(7.3 * STEP, abs=1e-3 * STEP)
    assert delay(chirp(x), -2 * chirp(x - 7.3), STEP).value != pytest.approx(7.3 * STEP, abs=1e-3 * STEP)


@pytest.mark.parametrize(
    ("reference", "test", "reason"),
    [
        (lambda x: np.sin(0.05 * x), lambda x: np.sin(0.05 * (x - 7)), "apart explain the signals as well"),
        (
            lambda x: np.sign(np.sin(0.05 * x)),
            lambda x: np.sign(np.sin(0.05 * (x - 7))),
            "apart explain the signals as well",
        ),
        (lambda x: np.sin(0.05 * x), lambda x: np.sin(0.05 * x), "apart explain the signals as well"),
        (lambda x: np.sin(0.05 * x), lambda x: 0 * x + 3, "the test signal is constant"),
        (lambda x: 0 * x, lambda x: np.sin(0.05 * x), "the reference signal is constant"),
        (lambda x: 2 * x, lambda x: 2 * (x - 5), "apart explain the signals as well"),
        (lambda x: chirp(x), lambda x: chirp(x - 900), "not"),
    ],
)
def test_undetermined(reference, test, reason):
    x = np.arange(float(COUNT))
    found = delay(reference(x), test(x), STEP)
    assert found.value is None
    assert found.standard_uncertainty is None
    assert reason in found.reason


def test_noisy_periodic_signals_are_undetermined_and_the_nearest_delay_is_told():
    found = delay(*pair(lambda x: np.sin(0.05 * x), 7.0, 0.1, 3), STEP)
    assert found.value is None
    assert found.nearest == pytest.approx(7 * STEP, abs=0.2 * STEP)


def test_unrelated_noise_is_undetermined():
    undetermined = 0
    for seed in range(20):
        generator = np.random.default_rng(seed)
        undetermined += delay(generator.standard_normal(COUNT), generator.standard_normal(COUNT), STEP).value is None
    assert undetermined == 20


def test_a_slow_noisy_rise_reaches_the_bound_and_knows_its_uncertainty():
    """Noise puts small peaks on the broad correlation of a slow signal; none of them must be taken for the delay."""
    time, sigma = STEP * np.arange(COUNT), 0.05
    generator = np.random.default_rng(0)

    def rise(t):
        return 1 - np.exp(-np.maximum(t - 0.5, 0.0) / 0.1)

    slope = np.gradient(rise(time), time)
    bound = np.sqrt(2) * sigma / np.linalg.norm(slope - slope.mean())
    errors, uncertainties = [], []
    for _ in range(30):
        lag = float(generator.uniform(-0.02, 0.02))
        reference, test = (rise(time - late) + sigma * generator.standard_normal(COUNT) for late in (0.0, lag))
        found = delay(reference, test, STEP)
        errors.append(found.value - lag)
        uncertainties.append(found.standard_uncertainty)
    assert np.sqrt(np.mean(np.square(errors))) < 1.4 * bound
    assert 0.7 < np.sqrt(np.mean((np.array(errors) / uncertainties) ** 2)) < 1.4


@pytest.mark.parametrize("late", [0.013, -0.021])
def test_a_periodic_signal_names_its_period_and_the_nearest_delay(late):
    """A sine of 0.1 s: late by any whole number of periods more or less explains it as well."""
    step, period = 0.001, 0.1
    time = np.arange(0, 1.5, step)
    found = delay(np.sin(2 * np.pi * time / period), np.sin(2 * np.pi * (time - late) / period), step)
    assert found.value is None
    assert found.standard_uncertainty is None
    assert found.reason == "delays 0.1 s apart explain the signals as well"
    assert found.nearest == pytest.approx(late, abs=1e-5)
