"""The noise threshold against Gumbel's distribution and exact χ² quantiles."""

import numpy as np
import pytest
from scipy.stats import chi2, gumbel_r

from matching.diagnosis.screening import DRAWS, PASSED_BY_NOISE, NoiseDraws, best_of


def draws(decreases: list[np.ndarray], samples: int = 8) -> NoiseDraws:
    made = NoiseDraws(np.ones(samples, bool), lambda signal: signal)
    made.decreases = decreases
    return made


def test_threshold_is_the_quantile_of_gumbels_distribution_with_the_moments_of_the_largest() -> None:
    rng = np.random.default_rng(0)
    first, second = rng.chisquare(2, DRAWS), rng.chisquare(2, DRAWS)
    largest = np.maximum(first, second)
    scale = largest.std(ddof=1) / gumbel_r.std()
    expected = gumbel_r.isf(PASSED_BY_NOISE, largest.mean() - scale * gumbel_r.mean(), scale)
    assert draws([first, second]).threshold() == pytest.approx(expected, rel=1e-9)


def test_threshold_of_many_independent_guesses_is_near_the_exact_one() -> None:
    """Of 200 orthogonal signatures the largest of 200 χ² with one degree of freedom."""
    samples, guesses = 4000, 200
    made = NoiseDraws(np.ones(samples, bool), lambda signal: signal, seed=3)
    spans = np.linalg.qr(np.random.default_rng(1).standard_normal((samples, guesses)))[0]
    made.offer(list((spans.T @ made.noise)[:, None, :]), [1.0] * guesses)
    exact = chi2.isf(-np.expm1(np.log1p(-PASSED_BY_NOISE) / guesses), 1)
    assert made.threshold() == pytest.approx(exact, rel=0.25)
    assert np.mean(made.decreases) == pytest.approx(1.0, rel=0.1)


def test_noise_stands_where_there_are_readings_and_base_parameters_take_their_share() -> None:
    mask = np.arange(100) % 2 == 0
    made = NoiseDraws(mask, lambda signal: signal - signal[0])
    assert np.ptp(made.noise[1::2]) == pytest.approx(np.ptp(made.noise[1]), abs=1e-6)  # 0 minus the first, everywhere
    assert np.all(made.noise[0] == 0)


def test_nothing_offered_is_no_threshold() -> None:
    assert draws([]).threshold() == 0.0


@pytest.mark.parametrize("count", [1.0, 3.0, 50.0])
def test_the_best_of_several_guesses_in_closed_form(count: float) -> None:
    """χ² with two degrees of freedom exceeds d with exp(−d/2); the largest of n with 1 − (1 − exp(−d/2))^n."""
    alone = np.array([0.3, 2.0, 9.0, 25.0])
    expected = -2 * np.log(-np.expm1(np.log1p(-np.exp(-alone / 2)) / count))
    np.testing.assert_allclose(best_of(count, alone, 2), expected, rtol=1e-9)
