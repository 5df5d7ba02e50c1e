"""Equivalent fits of two springs in series, of which only the sum of the compliances is measured."""

import numpy as np
import pytest
from diagnosis.linear import KnownProblem, fit_at

from matching.diagnosis.causes import Cause
from matching.diagnosis.hypotheses import equivalent_fits, widened
from matching.diagnosis.statistics import Estimate

CAUSE = Cause("compliance", "shafts.link", ("stiffness",))
NAME = "shafts.link.compliance.stiffness"
SIGMA = 1e-3  # of one of the 100 readings of the compliance


def springs(known: float = 0.0):
    """Compliance 1/base + 1/further = 0.02 rad/(N·m), read 100 times; ``known`` weighs a reading of the further spring
    at 100 N·m/rad."""

    def residual(v: np.ndarray) -> np.ndarray:
        return np.append(np.full(100, (0.02 - 1 / v[0] - 1 / v[1]) / SIGMA), known * (v[1] - 100.0))

    problem = KnownProblem({"base": (1.0, 1e5), NAME: (1.0, 1e5)}, residual)
    v = np.array([100.0, 100.0])
    slope = np.append(np.full(100, 1 / 100.0**2 / SIGMA), 0.0)
    return fit_at(problem, v, np.column_stack([slope, slope + np.append(np.zeros(100), known)]))


def test_springs_in_series_are_equivalent_over_the_whole_profile() -> None:
    fits = equivalent_fits(springs(), (CAUSE,))
    further = sorted(one.values[NAME] for one in fits)
    np.testing.assert_allclose(further[-1], 100 * 1.5**8, rtol=1e-9)  # eight steps up; softer than 50 is impossible
    assert 50 < further[0] < 70
    for one in fits:
        assert 1 / one.values["base"] + 1 / one.values[NAME] == pytest.approx(0.02, abs=3 * SIGMA / 10)
        assert one.cost < fits[0].cost + 9.0


def test_a_spring_that_a_reading_fixes_has_no_equivalent() -> None:
    fits = equivalent_fits(springs(known=1.0), (CAUSE,))
    assert [one.values[NAME] for one in fits] == [100.0]


def test_a_parameter_that_no_other_compensates_is_not_profiled() -> None:
    """Uncertain by itself: the width that the Jacobian gives is the whole of it."""
    problem = KnownProblem(
        {"base": (1.0, 1e5), NAME: (1.0, 1e5)}, lambda v: np.array([v[0] - 100.0, (v[1] - 100.0) / 1000.0])
    )
    fits = equivalent_fits(fit_at(problem, np.array([100.0, 100.0]), np.diag([1.0, 1e-3])), (CAUSE,))
    assert [one.values[NAME] for one in fits] == [100.0]


def test_equivalent_up_to_three_standard_uncertainties() -> None:
    """A reading of weight w makes χ² rise by (w·Δ)²: the profile at 150 is in for w·50 < 3, out beyond."""
    for known, values in ((0.055, [100.0, 150.0]), (0.065, [100.0])):
        upward = [one.values[NAME] for one in equivalent_fits(springs(known), (CAUSE,)) if one.values[NAME] >= 100]
        assert sorted(upward) == pytest.approx(values)


@pytest.mark.parametrize(("ratio", "values"), [(5.0, [100.0, 150.0]), (3.5, [100.0])])
def test_profiled_from_four_times_the_uncertainty_that_it_has_with_the_others_known(ratio, values, monkeypatch) -> None:
    """Of two springs and a reading of weight w of one of them: √(1 + S/w²), with S of the compliance's readings."""
    known = 0.05
    information = known**2 * (ratio**2 - 1)
    monkeypatch.setitem(springs.__globals__, "SIGMA", np.sqrt(100 / information) / 100.0**2)
    upward = [one.values[NAME] for one in equivalent_fits(springs(known), (CAUSE,)) if one.values[NAME] >= 100]
    assert sorted(upward) == pytest.approx(values)


def test_estimates_reach_as_far_as_equivalent_fits() -> None:
    best, same, higher = (springs() for _ in range(3))
    best.v[:] = 100.0, 100.0
    same.v[:] = 70.0, 100.0
    higher = fit_at(higher.problem, np.array([100.0, 180.0]), higher.jacobian)
    for one, cost in ((best, 5.0), (same, 5.0), (higher, 9.0)):
        object.__setattr__(one, "cost", cost)
    estimates = {"base": Estimate(100.0, 1.0), NAME: Estimate(100.0, 50.0)}
    found = widened(estimates, [best, same, higher])
    assert found["base"].standard_uncertainty == 30.0  # |70 − 100|, χ² as low
    assert found[NAME].standard_uncertainty == 50.0  # |180 − 100|/√4 = 40 is less
    assert widened({NAME: Estimate(100.0, 5.0)}, [best, higher])[NAME].standard_uncertainty == 40.0
