"""Confidence, its shares of evidence, and what a residual that is not noise is worth: closed forms."""

from types import SimpleNamespace

import numpy as np
import pytest
from diagnosis.linear import KnownProblem, fit_at
from scipy.signal import lfilter

from matching.diagnosis.causes import Cause, ExtendedModel
from matching.diagnosis.hypotheses import Hypothesis, at_noise, share_explained
from matching.diagnosis.result import differs_from_nothing
from matching.diagnosis.statistics import Estimate, inflation
from matching.diagnosis.verdict import (
    evidence_shares,
    residual_inflation,
    stacking_weights,
)


def with_cost(mean_square: float, variables: int = 1, readings: int = 1000) -> Hypothesis:
    names = {f"p{i}": (-np.inf, np.inf) for i in range(variables)}
    problem = KnownProblem(names, lambda v: np.full(readings, np.sqrt(mean_square)))
    fit = fit_at(problem, np.ones(variables), np.ones((readings, variables)))
    causes = tuple(Cause("sensor_offset", f"sensors.s{i}", ("offset",)) for i in range(variables))
    return Hypothesis(ExtendedModel(None, causes, names, {}), fit)


def test_shares_of_evidence_are_likelihood_ratios() -> None:
    shares = evidence_shares(np.array([1000.0, 1002.0, 1e30]))
    assert shares[0] / shares[1] == pytest.approx(np.e)
    assert shares[2] == 0
    assert shares.sum() == pytest.approx(1)


def test_residual_inflation() -> None:
    rng = np.random.default_rng(6)
    white = rng.standard_normal((30_000, 1))
    assert residual_inflation([white]) == pytest.approx(1.0, abs=0.05)
    assert residual_inflation([0.5 * white]) == 1.0
    assert residual_inflation([2 * white]) == pytest.approx(4, rel=0.1)
    memory = 0.7
    slow = lfilter([1], [1, -memory], white[:, 0])[:, None]
    independent = (1 - memory) / (1 + memory)
    assert residual_inflation([slow]) == pytest.approx(1 / (1 - memory**2) / independent, rel=0.2)
    both = np.hstack([white, np.full_like(white, np.nan)])
    assert residual_inflation([2 * both]) == pytest.approx(4, rel=0.1)


def stacked(*squares: list[float], independent: float = 20.0) -> np.ndarray:
    return stacking_weights([SimpleNamespace(blocks=np.array(own)[:, None], independent=np.array([independent]))
                             for own in squares])  # fmt: skip


def test_weights_are_of_the_hypotheses_that_predict_blocks_best_together() -> None:
    good, bad = [4.0] * 16, [9.0] * 16
    np.testing.assert_allclose(stacked(good, bad), [1.0, 0.0], atol=1e-3)
    np.testing.assert_allclose(stacked(good, good), [0.5, 0.5])
    halves = stacked([4.0] * 8 + [9.0] * 8, [9.0] * 8 + [4.0] * 8)  # each right in half of the blocks
    np.testing.assert_allclose(halves, [0.5, 0.5], atol=0.05)
    slight = stacked(good, [4.001] * 16)  # a difference of a hundredth of what one reading tells
    assert 0.45 < slight[0] < 0.55
    assert stacking_weights([SimpleNamespace(blocks=np.ones((4, 1)), independent=np.ones(1)), None])[0] == 1.0


def test_share_of_the_misfit_that_a_cause_explains() -> None:
    parent, child = with_cost(5.0), with_cost(2.0)
    assert share_explained(parent, child) == pytest.approx(3 / 4)  # beyond the noise, which is 1
    assert share_explained(parent, with_cost(1.0)) == 1.0
    assert share_explained(parent, with_cost(0.5)) == 1.0
    assert share_explained(child, parent) == pytest.approx(-3.0)
    assert share_explained(with_cost(0.9), with_cost(0.8)) == 1.0
    assert share_explained(with_cost(0.9), with_cost(0.95)) == 0.0


def test_price_of_a_variable_is_the_logarithm_of_the_readings() -> None:
    assert with_cost(1.0, 3).cost - with_cost(1.0, 1).cost == pytest.approx(2 * np.log(1000))


def test_at_noise_judges_size_and_colour() -> None:
    rng = np.random.default_rng(8)

    def of(residual: np.ndarray) -> bool:
        problem = KnownProblem({"a": (0.0, 1.0)}, lambda v: residual)
        fit = fit_at(problem, np.array([0.5]), np.ones((len(residual), 1)))
        return at_noise(Hypothesis(ExtendedModel(None, (), {}, {}), fit))

    white = rng.standard_normal(50_000)
    slow = np.sin(2 * np.pi * np.arange(50_000) / 20_000)
    assert of(white)
    assert not of(1.1 * white)  # 21 % more power
    assert of(1.001 * white)
    assert not of(white + 0.2 * slow)  # 2 % of the power, all of it slow
    assert of(white + 0.05 * slow)  # 0.13 %, less than what matters


@pytest.mark.parametrize(
    ("away", "correlation", "told"),
    [((0.0, 0.0), 0.0, False), ((2.1, 0.0), 0.0, False), ((2.6, 0.0), 0.0, True), ((1.5, 1.5), 0.0, False),
     ((1.9, 1.9), 0.0, True), ((0.8, -0.9), 0.95, True), ((0.8, 0.9), 0.95, False)],
)  # fmt: skip
def test_values_that_others_compensate_are_told_from_nothing_together(away, correlation, told):
    """Two normal values in units of their uncertainty: χ² of two degrees of freedom passes 6.18 in 4.55 % of cases."""
    own = np.array([[1.0, correlation], [correlation, 1.0]])
    square = np.array(away) @ np.linalg.inv(own) @ np.array(away)
    assert (square > 6.18) == told
    columns = np.linalg.cholesky(np.linalg.inv(own)).T
    matrix = np.zeros((1000, 2))
    matrix[:2] = columns
    cause = Cause("coulomb_friction", "inertias.a", ("torque", "torque_reverse"))
    names = list(cause.names().values())
    problem = KnownProblem(dict.fromkeys(names, (-np.inf, np.inf)), lambda v: np.zeros(1000))
    fit = fit_at(problem, np.array(away), matrix)
    estimates = {name: Estimate(value, 1.0) for name, value in zip(names, away, strict=True)}
    final = Hypothesis(ExtendedModel(None, (cause,), {}, {}), fit)
    assert differs_from_nothing(final, cause, estimates, 2.0) == told


@pytest.mark.parametrize(("readings", "judged"), [(63, False), (64, True)])
def test_few_readings_do_not_say_that_a_residual_is_more_than_noise(readings: int, judged: bool) -> None:
    assert (inflation(with_cost(4.0, readings=readings).fit) > 1.0) == judged
