"""Drawn pairs of signals, one late, in noise: errors of their estimated delays over the stated uncertainties."""

import numpy as np
from scipy.signal import lfilter

from modelling.fidelity.delay import delay

SECONDS, MOST_SAMPLES = 10.0, 20_000
COLOUR = 0.9  # of one sample's noise that is left in the next
RATES = (50.0, 100.0, 200.0, 1000.0, 10_000.0)  # Hz


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
    """Of unit variance, (t,): white, or of first order."""
    white = generator.standard_normal(count + 200)
    return (lfilter([np.sqrt(1 - COLOUR**2)], [1, -COLOUR], white) if coloured else white)[200:]


def deviations(signal, coloured, rate, level, draws):
    """Errors over standard uncertainties of the delays that are determined; ``level`` is noise over signal."""
    errors = []
    for draw in range(draws):
        generator = np.random.default_rng([draw, int(rate), int(coloured), round(1e4 * level)])
        count = int(min(SECONDS * rate, MOST_SAMPLES))
        time, late = np.arange(count) / rate, generator.uniform(-0.02, 0.02)
        law = signal(generator, count / rate)
        spread = level * np.std(law(time))
        reference = law(time) + spread * noise(generator, count, coloured)
        test = 0.9 * law(time - late) + 0.3 + spread * noise(generator, count, coloured)
        estimate = delay(reference, test, 1 / rate)
        if estimate.value is not None:
            errors.append((estimate.value - late) / estimate.standard_uncertainty)
    return np.array(errors)
