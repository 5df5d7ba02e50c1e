"""Responses from periods: closed-form systems, honest variances, shared noise, and what is not linear."""

import numpy as np
import pytest
from scipy.signal import lfilter

from matching.bed.measured import measured_mode, periodic_responses, repetition

STEP, COUNT = 0.005, 4000  # s, samples of a period of 20 s
OWNERS = np.random.default_rng(2).permuted(np.tile(np.arange(4), (200, 1)), axis=1).ravel()
LINES = tuple(np.flatnonzero(owner == OWNERS)[3:] for owner in (0, 1))  # of the two inputs; half of them stay empty


def resonance(f, frequency, damping):
    """H of a sampled pair of poles, in closed form, and its coefficients."""
    pole = np.exp(2 * np.pi * frequency * STEP * (-damping + 1j * np.sqrt(1 - damping**2)))
    a = np.real(np.poly([pole, pole.conjugate()]))
    z = np.exp(2j * np.pi * f * STEP)
    return 1 / (a[0] + a[1] / z + a[2] / z**2), a


def recorded(seed, periods=3, noise=0.0, own=0.0, bent=0.0):
    """Two multisines, one at rest before; two outputs, of which noise is shared or each one's own."""
    rng, drawn = np.random.default_rng(1), np.random.default_rng(seed)
    u = np.zeros(((periods + 1) * COUNT, 2))
    t = np.arange(len(u)) / COUNT
    for j, lines in enumerate(LINES):
        for line, phase in zip(lines, 2 * np.pi * rng.random(len(lines)), strict=True):
            u[:, j] += np.cos(2 * np.pi * line * t + phase)
    u[: COUNT // 10] = 0
    _, first = resonance(np.ones(1), 1.6, 0.06)
    _, second = resonance(np.ones(1), 8.0, 0.05)
    y = lfilter([1.0], first, u[:, 0]) + 3 * lfilter([1.0], second, u[:, 1])
    y = y + bent * y**2
    both = noise * drawn.normal(size=len(u))
    return u, np.stack([y + both + own * drawn.normal(size=len(u)), 2 * y + both], axis=1)


def responses(*arguments, **keywords):
    u, y = recorded(*arguments, **keywords)
    return periodic_responses(u, y, STEP, repetition(u, 400), 40.0)


def test_periods_are_found_after_a_rest_and_before_an_end():
    u, _ = recorded(0)
    u = np.vstack([np.zeros((700, 2)), u, np.zeros((900, 2))])
    found = repetition(u, 400)
    assert (found.period, found.count) == (COUNT, 3)
    assert 700 + COUNT // 10 <= found.first <= 710 + COUNT


@pytest.mark.parametrize("kind", ["noise", "steps", "chirp"])
def test_what_does_not_repeat_has_no_period(kind):
    t = np.arange(12000) * STEP
    u = {"noise": np.random.default_rng(0).normal(size=len(t)), "steps": np.sign(np.sin(t**1.5 / 9)),
         "chirp": np.sin(0.2 * t**2)}[kind]  # fmt: skip
    assert repetition(u[:, None], 400) is None


def test_both_inputs_at_once_beside_lightly_damped_modes():
    """The quotient at a line is exact: no window, no model of the resonance."""
    found = responses(0)
    for j, (frequency, damping, size) in enumerate(((1.6, 0.06, 1.0), (8.0, 0.05, 3.0))):
        function = found[0][j].within(0.7, 30.0)
        truth = size * resonance(function.frequencies, frequency, damping)[0]
        np.testing.assert_allclose(function.values, truth, rtol=1e-3)


def test_variances_and_shared_noise_are_those_that_repeated_recordings_show():
    """Half of the noise is shared between the outputs."""
    values, stated, shared = [], [], []
    for seed in range(24):
        first, second = (row[0].within(0.7, 30.0) for row in responses(seed, noise=1.0, own=1.0))
        values.append([first.values, second.values])
        stated.append([first.variances, second.variances])
        shared.append(np.sum(first.noise * second.noise.conj(), axis=1))
    scatter = np.array(values) - np.mean(values, axis=0)
    ratio = np.mean(np.array(stated), axis=0) / np.mean(np.abs(scatter) ** 2, axis=0)
    assert np.median(ratio, axis=1) == pytest.approx([1.0, 1.0], abs=0.15)
    found = np.mean(scatter[:, 0] * scatter[:, 1].conj(), axis=0).real / np.mean(shared, axis=0).real
    assert np.median(found) == pytest.approx(1.0, abs=0.15)


def test_what_is_not_linear_counts_as_noise():
    """Lines that nothing excites show it: a square adds but what looks like noise."""
    straight, bent = (responses(0, bent=size)[0][0].within(1.0, 20.0) for size in (0.0, 1e-4))
    off = np.abs(bent.values - straight.values)
    assert np.median(straight.variances) < 1e-4 * np.median(bent.variances)
    assert 0.2 < np.median(off**2 / bent.variances) < 3


def test_inputs_that_share_their_lines_have_no_response_of_their_own():
    u, y = recorded(0)
    u[:, 1] = u[:, 0]
    assert periodic_responses(u, y, STEP, repetition(u, 400), 40.0) is None


def test_a_mode_within_its_uncertainty():
    off = []
    for seed in range(12):
        mode = measured_mode([responses(seed, noise=30.0)[0][1]], 7.5, 0.08)
        off.append([(mode.frequency - 8.0) / mode.frequency_uncertainty,
                    (mode.damping_ratio - 0.05) / mode.damping_uncertainty])  # fmt: skip
    assert np.abs(off).max() < 4
    assert 0.4 < np.sqrt(np.mean(np.square(off))) < 2
