"""Uncertainties against linear least squares with a known covariance."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from diagnosis.linear import KnownProblem, fit_at
from scipy.signal import lfilter

from matching.diagnosis import screening as backlash_one_flank
from matching.diagnosis.causes import Cause
from matching.diagnosis.data import Weighting
from matching.diagnosis.descent import Fit
from matching.diagnosis.result import correlated_uncertainties, shift_by_memory
from matching.diagnosis.statistics import Estimate, at_least, covariance, discretisation_shift, estimates, inflation

J = np.random.default_rng(1).standard_normal((200, 2)) * [30.0, 0.2]


def straight(bounds: tuple[tuple[float, float], tuple[float, float]], noise: np.ndarray | None = None):
    """A fit of a straight problem at its centre (2, 5); bounds of both variables."""
    noise = np.zeros(len(J)) if noise is None else noise
    problem = KnownProblem(dict(zip("ab", bounds, strict=True)), lambda v: noise - J @ (v - [2.0, 5.0]))
    return fit_at(problem, np.array([2.0, 5.0]), -J)


FREE = (-np.inf, np.inf)


def test_covariance_without_ranges_is_that_of_least_squares() -> None:
    found = covariance(straight((FREE, FREE)))
    np.testing.assert_allclose(found, np.linalg.inv(J.T @ J), rtol=1e-9)
    np.testing.assert_allclose(covariance(straight((FREE, FREE)), 4.0), 4 * np.linalg.inv(J.T @ J), rtol=1e-9)


def test_a_range_adds_the_information_of_a_uniform_distribution() -> None:
    found = covariance(straight(((1.0, 4.0), FREE)), 2.0)
    expected = np.linalg.inv(J.T @ J / 2.0 + np.diag([12 / 3.0**2, 0.0]))
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_at_a_bound_the_range_counts_from_that_bound() -> None:
    for bounds in ((2.0, 5.0), (-1.0, 2.0)):
        found = covariance(straight((bounds, FREE)))
        np.testing.assert_allclose(found, np.linalg.inv(J.T @ J + np.diag([3 / 3.0**2, 0.0])), rtol=1e-9)


def test_a_variable_without_influence_has_the_uncertainty_of_its_range() -> None:
    problem = KnownProblem({"a": (1.0, 4.0), "b": FREE}, lambda v: -J[:, 1] * (v[1] - 5))
    found = estimates(fit_at(problem, np.array([2.0, 5.0]), np.column_stack([np.zeros(len(J)), -J[:, 1]])))
    assert found["a"].standard_uncertainty == pytest.approx(3 / np.sqrt(12), rel=1e-9)
    assert found["a"].note == "not identifiable: the data do not narrow its range"
    assert found["b"].standard_uncertainty == pytest.approx(1 / np.linalg.norm(J[:, 1]), rel=1e-6)
    assert found["b"].note == ""


def test_bound_and_identifiability_are_both_noted() -> None:
    problem = KnownProblem({"a": (2.0, 4.0)}, lambda v: np.zeros(100))
    (found,) = estimates(fit_at(problem, np.array([2.0]), np.zeros((100, 1)))).values()
    assert found.note == "at the bound of its range; not identifiable: the data do not narrow its range"
    assert found.standard_uncertainty == pytest.approx(2 / np.sqrt(12))  # never more than the range


def test_half_of_the_range_is_still_identified() -> None:
    """The threshold is half of the uniform distribution's standard deviation."""
    for share, note in ((0.4, ""), (0.7, "not identifiable: the data do not narrow its range")):
        width = 6.0
        sigma = share * width / np.sqrt(12)
        data = 1 / sigma**2 - 12 / width**2  # information of the data that leaves sigma with that of the range
        problem = KnownProblem({"a": (0.0, width)}, lambda v: np.zeros(100))
        (found,) = estimates(fit_at(problem, np.array([2.0]), np.full((100, 1), np.sqrt(data / 100)))).values()
        assert found.standard_uncertainty == pytest.approx(sigma, rel=1e-9)
        assert found.note == note


def test_a_shift_by_the_steps_is_added_in_quadrature() -> None:
    fit = straight((FREE, FREE))
    plain, shifted = estimates(fit), estimates(fit, np.array([0.3, -4.0]))
    for name, shift in (("a", 0.3), ("b", 4.0)):
        u = plain[name].standard_uncertainty
        assert shifted[name].standard_uncertainty == pytest.approx(np.sqrt(u**2 + shift**2), rel=1e-9)


def test_discretisation_moves_the_variables_by_least_squares() -> None:
    """With steps half as long the simulation reads more by J·(0.5, −2): the variables make up for it."""
    more = J @ [0.5, -2.0]

    class Stepped(KnownProblem):
        def residuals(self, batch: np.ndarray) -> np.ndarray:
            return super().residuals(batch) - (more if self.steps_per_second == 2.0 else 0.0)

    problem = Stepped({"a": FREE, "b": FREE}, lambda v: -J @ (v - [2.0, 5.0]))
    fit = fit_at(problem, np.array([2.0, 5.0]), -J)
    np.testing.assert_allclose(discretisation_shift(fit), [-0.5, 2.0], rtol=1e-9)


def test_inflation_of_noise_is_none_and_of_correlated_residual_by_its_independent_samples() -> None:
    rng = np.random.default_rng(2)

    def of(residual: np.ndarray) -> float:
        problem = KnownProblem({"a": FREE}, lambda v: residual)
        return inflation(fit_at(problem, np.array([1.0]), np.ones((len(residual), 1))))

    white = rng.standard_normal(40_000)
    assert of(white) == 1.0
    assert of(3 * white) == pytest.approx(9, rel=0.05)
    memory = 0.8  # mean square 1/(1 − memory²), correlation time (1 + memory)/(1 − memory)
    expected = 1 / (1 - memory**2) * (1 + memory) / (1 - memory)
    assert of(lfilter([1], [1, -memory], white)) == pytest.approx(expected, rel=0.15)


def test_the_worst_sensor_counts() -> None:
    white = np.random.default_rng(3).standard_normal((20_000, 2)) * [1.0, 2.0]
    problem = KnownProblem({"a": FREE}, lambda v: white.ravel(), sensors=2)
    assert inflation(fit_at(problem, np.array([1.0]), np.ones((white.size, 1)))) == pytest.approx(4, rel=0.05)


def test_what_no_reading_depends_on_is_unknown_not_certain() -> None:
    problem = KnownProblem({"a": FREE, "b": FREE}, lambda v: -J[:, 1] * (v[1] - 5))
    found = estimates(fit_at(problem, np.array([2.0, 5.0]), np.column_stack([np.zeros(len(J)), -J[:, 1]])))
    assert found["a"].standard_uncertainty == np.inf
    assert found["a"].note == "unknown: no reading depends on it"
    assert found["b"].note == ""


def test_estimates_are_no_more_certain_than_windows_have_them() -> None:
    found = {"a": Estimate(1.0, 1e-8), "b": Estimate(2.0, 0.5), "c": Estimate(3.0, 0.1)}
    widened = at_least(found, {"a": 1e-5, "b": 0.1})
    assert [own.standard_uncertainty for own in widened.values()] == [1e-5, 0.5, 0.1]
    assert [own.value for own in widened.values()] == [1.0, 2.0, 3.0]


def test_errors_that_two_sensors_share_over_time_count_once() -> None:
    """A mean of n values of AR(1) noise, read twice: variance of the process times (1 + m)/(1 − m) over n."""
    count, memory = 40_000, 0.8
    error = lfilter([1], [1, -memory], np.random.default_rng(4).standard_normal(count))
    problem = KnownProblem({"a": FREE}, lambda v: np.repeat(error - v[0], 2), sensors=2)
    fit = fit_at(problem, np.array([error.mean()]), -np.ones((2 * count, 1)))
    process = 1 / (1 - memory**2)
    expected = np.sqrt(process * (1 + memory) / (1 - memory) / count)
    assert correlated_uncertainties(fit)["a"] == pytest.approx(expected, rel=0.1)
    assert np.sqrt(covariance(fit)[0, 0]) < 0.2 * expected  # as independent white noise of size 1


def test_a_parameter_is_at_least_as_uncertain_as_stated_but_never_more_than_its_range() -> None:
    fit = straight(((1.0, 4.0), FREE))
    found = estimates(fit, least={"a": 10.0, "b": 0.7})
    assert found["a"].standard_uncertainty == pytest.approx(3 / np.sqrt(12))
    assert found["a"].note == "not identifiable: the data do not narrow its range"
    assert found["b"].standard_uncertainty == 0.7


def test_a_gap_is_known_no_better_than_the_time_of_contact(monkeypatch: pytest.MonkeyPatch) -> None:
    """A twist that crosses a gap of 0.02 rad with 2 rad/s, sampled at 1 kHz: 2 rad/s over 10 µs."""
    time = np.linspace(0.0, 0.1, 101)
    twist = 0.05 * np.sign(np.sin(100 * time + 0.1))
    twist[50:61] = np.linspace(-0.0099, 0.0099, 11)
    rate = np.where(np.abs(twist) < 0.01, 2.0, 300.0)
    motion = SimpleNamespace(twist={"link": twist}, twist_rate={"link": rate})
    monkeypatch.setattr(backlash_one_flank, "simulated_motion", lambda fit: motion)
    fit = SimpleNamespace(problem=SimpleNamespace(data=SimpleNamespace(sampling_interval=1e-3)))
    cause = Cause("backlash", "shafts.link", ("gap",))
    name = "shafts.link.backlash.gap"
    found = backlash_one_flank.as_late_as_contact(
        {name: Estimate(0.02, 1.5e-5), "other": Estimate(1.0, 0.1)}, fit, [cause]
    )
    assert found[name].standard_uncertainty == pytest.approx(2.5e-5)
    assert found["other"] == Estimate(1.0, 0.1)


class Weighted(KnownProblem):
    """Errors of one sensor that count as a weighting has them."""

    def residuals(self, batch: np.ndarray) -> np.ndarray:
        errors = np.array([self.function(v) for v in batch])[:, :, None]
        if self.weighting is None:
            return errors[:, :, 0]
        return self.weighting.weigh(errors, np.ones(errors.shape[1:], bool))[:, :, 0]


def test_parameters_are_as_uncertain_as_fast_and_slow_changes_disagree() -> None:
    """A gain of 1.2 on a fast wave and of 1.0 on a slow one: with a memory nearly the former, without it the mean."""
    time = np.arange(4000)
    fast, slow = np.sin(2 * np.pi * time / 7), np.sin(2 * np.pi * time / 1000)
    signal, reading = fast + slow, 1.2 * fast + slow
    weighting = Weighting(np.array([0.99]), np.array([0.02]))
    problem = Weighted({"a": FREE}, lambda v: reading - v[0] * signal, weighting=weighting)
    change, target = (x[1:] - 0.99 * x[:-1] for x in (signal, reading))
    with_memory, without = (float(x @ y / (x @ x)) for x, y in ((change, target), (signal, reading)))
    v = np.array([with_memory])
    residual = problem.residuals(v[None])[0]
    fit = Fit(problem, v, residual, problem.residuals(v[None] + 1)[0][:, None] - residual[:, None], 1.0)
    assert with_memory > 1.19
    assert shift_by_memory(fit)[0] == pytest.approx(without - with_memory, rel=1e-3)
    plain = fit_at(replace(problem, weighting=None), np.array([without]), -signal[:, None])
    assert shift_by_memory(plain)[0] > 0.03  # towards the gain of the fast wave
    assert correlated_uncertainties(fit)["a"] == pytest.approx((with_memory - without) / np.sqrt(3), rel=1e-3)
