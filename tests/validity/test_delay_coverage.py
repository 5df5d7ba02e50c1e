"""The standard uncertainty of a delay covers the truth as often as it says, over drawn signals, rates and noises."""

import numpy as np
import pytest
from scipy.signal import lfilter

from modelling.fidelity.delay import delay

SECONDS, MOST_SAMPLES = 10.0, 20_000
COLOUR = 0.9  # of one sample's noise that is left in the next


def smooth(generator, _):
    """Fifteen sines of 0.3 to 8 Hz."""
    parts = [(generator.normal(), generator.uniform(0.3, 8), generator.uniform(0, 6.28)) for _ in range(15)]
    return lambda t: sum(a * np.sin(2 * np.pi * f * t + phase) for a, f, phase in parts)


def kinked(generator, seconds):
    """Five ramps of 0.05 to 0.3 s."""
    begins = generator.uniform(0.1, 0.85, 5) * seconds
    parts = [(begin, generator.normal(), generator.uniform(0.05, 0.3)) for begin in begins]
    return lambda t: sum(height * np.clip((t - begin) / width, 0, 1) for begin, height, width in parts)


def noise(generator, count, coloured):
    white = generator.standard_normal(count + 200)
    return (lfilter([np.sqrt(1 - COLOUR**2)], [1, -COLOUR], white) if coloured else white)[200:]


def deviations(signal, coloured, rate, level, draws):
    """Errors over standard uncertainties of the delays that are determined."""
    found = []
    for draw in range(draws):
        generator = np.random.default_rng([draw, int(rate), int(coloured)])
        count = int(min(SECONDS * rate, MOST_SAMPLES))
        time, late = np.arange(count) / rate, generator.uniform(-0.02, 0.02)
        law = signal(generator, count / rate)
        spread = level * np.std(law(time))
        reference = law(time) + spread * noise(generator, count, coloured)
        test = 0.9 * law(time - late) + 0.3 + spread * noise(generator, count, coloured)
        estimate = delay(reference, test, 1 / rate)
        if estimate.value is not None:
            found.append((estimate.value - late) / estimate.standard_uncertainty)
    return np.array(found)


def test_coverage_in_coloured_noise():
    """Newey and West's estimate alone, with the band's correlation length, covers about two thirds of these."""
    found = deviations(kinked, True, 100.0, 0.01, 24)
    assert len(found) >= 22
    assert np.mean(np.abs(found) < 1.96) >= 0.82  # 95 % but for three standard deviations of 24 draws
    assert 0.6 < np.sqrt(np.mean(found**2)) < 1.4


@pytest.mark.long
@pytest.mark.parametrize("rate", [50.0, 100.0, 200.0, 1000.0, 10_000.0])
def test_coverage_from_50_hz_to_10_khz(rate):
    """95 % of all, smooth and kinked, in white and coloured noise of 1 % and 10 %."""
    draws = 100 if rate < 500 else 40
    found = np.concatenate(
        [
            deviations(signal, coloured, rate, level, draws)
            for signal in (smooth, kinked)
            for coloured in (False, True)
            for level in (0.01, 0.1)
        ]
    )
    assert 0.93 <= np.mean(np.abs(found) < 1.96) <= 0.97
