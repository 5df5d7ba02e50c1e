"""Errors of hypotheses on unseen data: figures by hand, and what a cause has to earn with them."""

from types import SimpleNamespace

import numpy as np
import pytest

from matching.diagnosis.data import FitData, Segment
from matching.diagnosis.selection import BLOCKS, UnseenData, UnseenError

SAMPLES = 64
NOISE = np.array([0.5, 0.1, 0.2])
TIME = np.arange(SAMPLES) * 1e-2
READINGS = np.stack([np.linspace(-3, 5, SAMPLES), np.linspace(0, 2, SAMPLES), np.full(SAMPLES, np.nan)], axis=1)


def hypothesis(*errors, weighting=None):
    """One that leaves these errors (t, y), in times the noise; the third sensor measures nothing."""
    left = np.stack([*(np.broadcast_to(error, SAMPLES) for error in errors), np.full(SAMPLES, np.nan)], axis=1)
    fit = SimpleNamespace(left=left, problem=SimpleNamespace(data=SimpleNamespace(noise=NOISE), weighting=weighting))
    return SimpleNamespace(fit=fit)


@pytest.fixture
def unseen():
    """Held-out data whose simulation is what a hypothesis leaves; the number of simulations."""
    simulated = []

    def simulate(fit):
        simulated.append(fit)
        if fit.left is None:
            raise FloatingPointError
        return [SimpleNamespace(errors=fit.left, parts=lambda errors: [errors])]

    segment = Segment(TIME, np.zeros((SAMPLES, 0)), READINGS)
    data = UnseenData(SimpleNamespace(simulate=simulate, data=FitData((segment,), NOISE)))
    return SimpleNamespace(of=data, simulated=simulated)


def test_errors_are_mean_squares_by_block_and_pooled_over_the_ranges(unseen):
    half = np.repeat([1.0, 3.0], SAMPLES // 2)
    found = unseen.of.error(hypothesis(half, 4.0))
    assert found.blocks.shape == (BLOCKS, 3)
    np.testing.assert_allclose(found.blocks[:, 0], np.repeat([1.0, 9.0], BLOCKS // 2))
    np.testing.assert_allclose(found.mean_squares, [5.0, 16.0, 0.0])
    shares = np.array([np.sqrt(5.0) * 0.5 / 8.0, 4.0 * 0.1 / 2.0])  # error over the range of the readings
    assert found.pooled == pytest.approx(np.sqrt(np.mean(shares**2)), rel=1e-12)
    assert np.isnan(found.blocks[:, 2]).all()


def test_a_sensor_read_in_one_block_alone_has_the_mean_square_of_that_block():
    blocks = np.array([[4.0, np.nan], [8.0, 9.0], [np.nan, np.nan]])
    np.testing.assert_allclose(UnseenError(blocks, np.zeros(2), 0.0).mean_squares, [6.0, 9.0])


def test_a_place_is_earned_where_all_falls_and_no_sensor_rises(unseen):
    parent = hypothesis(10.0, 3.0)
    assert unseen.of.earns_place(hypothesis(5.0, 3.0), parent)
    assert unseen.of.gains(hypothesis(5.0, 3.3), parent)
    assert not unseen.of.earns_place(hypothesis(5.0, 3.3), parent)  # 21 % more in the second
    assert not unseen.of.earns_place(hypothesis(11.0, 3.0), parent)


@pytest.mark.parametrize(("second", "earned"), [(1.65, True), (1.7, False)])
def test_a_rise_that_is_slight_against_what_all_gain_does_not_count(unseen, second, earned):
    """The first falls by 75 × (0.5/8)²; the second rises by 0.40 and 0.55 % of what both gain."""
    assert unseen.of.earns_place(hypothesis(5.0, second), hypothesis(10.0, 1.5)) is earned


@pytest.mark.parametrize(
    ("after", "before", "worse"),
    [
        (3.0, 2.0, [1]),
        (2.0, 3.0, []),
        (2.03, 2.0, []),  # 3 % in the mean square does not matter
        (2.06, 2.0, [1]),  # 6 % does
        (1.04, 0.5, []),  # at its noise
        (2.0 + 2.0 * np.repeat(np.tile([1.0, -1.0], BLOCKS // 2), SAMPLES // BLOCKS), 2.1, []),  # scatters: 3.6 ± 2.1
    ],
)
def test_a_sensor_is_worse_beyond_its_scatter_where_it_matters(unseen, after, before, worse):
    assert unseen.of.worse_sensors(hypothesis(1.0, after), hypothesis(1.0, before)) == worse


def test_the_rise_is_compared_with_twice_its_standard_error(unseen):
    """Alternating rises a ± b over 16 blocks: mean a, standard error b·√(16/15)/4."""
    a, b = 1.0, 1.0

    def alternating(spread):
        squares = 4.0 + a + spread * np.tile([1.0, -1.0], BLOCKS // 2)
        return hypothesis(1.0, np.repeat(np.sqrt(squares), SAMPLES // BLOCKS))

    edge = a / 2 * 4 / np.sqrt(16 / 15)
    parent = hypothesis(1.0, 2.0)
    assert edge > b
    assert unseen.of.worse_sensors(alternating(0.97 * edge), parent) == [1]
    assert unseen.of.worse_sensors(alternating(1.03 * edge), parent) == []


def test_a_weighted_search_judges_by_what_is_left_fast_and_slow(unseen):
    """A slow error twice as large in range, a fast one much smaller: promising where sensors are weighted."""
    rng = np.random.default_rng(0)
    fast, slow = rng.standard_normal(SAMPLES), np.sin(2 * np.pi * np.arange(SAMPLES) / SAMPLES)
    parent, child = hypothesis(8 * fast, 8 * fast, weighting="balanced"), hypothesis(
        12 * slow, 12 * slow, weighting="balanced"
    )  # fmt: skip
    assert unseen.of.error(child).pooled > unseen.of.error(parent).pooled
    assert not unseen.of.gains(child, parent)
    assert unseen.of.may_gain(child, parent)
    assert not unseen.of.may_gain(parent, child)
    child.fit.problem.weighting = None
    assert not unseen.of.may_gain(child, parent)


def test_nothing_measured_leaves_no_figure(unseen):
    unseen.of.holdout.data = FitData((Segment(TIME, np.zeros((SAMPLES, 0)), np.full((SAMPLES, 3), np.nan)),), NOISE)
    found = unseen.of.error(hypothesis(1.0, 1.0))
    assert np.isnan(found.pooled)
    assert np.isnan(found.power_left)
