"""Pooled errors and the worst time, by hand."""

import numpy as np
import pytest
from diagnosis.linear import KnownProblem, fit_at

from matching.diagnosis import result as errors
from matching.diagnosis.causes import ExtendedModel
from matching.diagnosis.data import FitData, Segment
from matching.diagnosis.hypotheses import Hypothesis
from matching.diagnosis.result import pooled_errors


def test_errors_are_pooled_over_each_sensors_range() -> None:
    readings = np.array([[0.0, 10.0, np.nan], [4.0, 10.0, np.nan], [-4.0, 30.0, np.nan]])
    whole = FitData((Segment(np.arange(3.0), np.zeros((3, 0)), readings),), np.array([0.1, 0.5, 9.0]))
    found = pooled_errors(whole, np.array([20.0, 4.0, np.nan]), np.array([2.0, 8.0, np.nan]))
    assert found.nrmse_before == pytest.approx(np.sqrt(((20 * 0.1 / 8) ** 2 + (4 * 0.5 / 20) ** 2) / 2))
    assert found.nrmse_after == pytest.approx(np.sqrt(((2 * 0.1 / 8) ** 2 + (8 * 0.5 / 20) ** 2) / 2))
    assert found.noise_floor == pytest.approx(np.sqrt(((0.1 / 8) ** 2 + (0.5 / 20) ** 2) / 2))


def test_the_worst_time_is_the_sixteenth_with_the_largest_error() -> None:
    residual = np.ones(1600)
    residual[710:760] = 9.0  # in the eighth sixteenth, samples 700 to 799
    problem = KnownProblem({"a": (0.0, 1.0)}, lambda v: residual)
    fit = fit_at(problem, np.array([0.5]), np.ones((1600, 1)))
    worst = errors._worst_time(Hypothesis(ExtendedModel(None, (), {}, {}), fit), 0)
    assert (worst.segment, worst.first, worst.last) == (0, 700, 800)
    assert worst.square == pytest.approx((81 + 1) / 2)
