"""Errors of hypotheses on unseen data: figures by hand, and what a cause has to earn with them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from matching.diagnosis import unseen as module
from matching.diagnosis.data import FitData, Segment
from matching.diagnosis.settings import DiagnosisSettings

SAMPLES = 64
BLOCKS = DiagnosisSettings().blocks
NOISE = np.array([0.5, 0.1, 0.2])
TIME = np.arange(SAMPLES) * 1e-2
READINGS = np.stack([np.linspace(-3, 5, SAMPLES), np.linspace(0, 2, SAMPLES), np.full(SAMPLES, np.nan)], axis=1)


def hypothesis(*errors):
    """One that leaves these errors (t, y), in times the noise; the third sensor measures nothing."""
    left = np.stack([*(np.broadcast_to(error, SAMPLES) for error in errors), np.full(SAMPLES, np.nan)], axis=1)
    data = FitData((Segment(TIME, np.zeros((SAMPLES, 0)), READINGS),), NOISE)
    return SimpleNamespace(fit=SimpleNamespace(left=left, problem=SimpleNamespace(data=data)))


@pytest.fixture
def unseen(monkeypatch):
    """Unseen data on which a hypothesis leaves what it is said to leave."""
    monkeypatch.setattr(module, "unseen_errors", lambda fit, blocks: [fit.left])
    return module.UnseenData(None, DiagnosisSettings())


def test_errors_are_mean_squares_by_block_and_pooled_over_the_ranges(unseen):
    half = np.repeat([1.0, 3.0], SAMPLES // 2)
    found = unseen.error(hypothesis(half, 4.0))
    assert found.blocks.shape == (BLOCKS, 3)
    np.testing.assert_allclose(found.blocks[:, 0], np.repeat([1.0, 9.0], BLOCKS // 2))
    shares = np.array([np.sqrt(5.0) * 0.5 / 8.0, 4.0 * 0.1 / 2.0])  # error over the range of the readings
    assert found.pooled == pytest.approx(np.sqrt(np.mean(shares**2)), rel=1e-12)
    assert np.isnan(found.blocks[:, 2]).all()


@pytest.mark.parametrize(
    ("after", "accepted", "kept"),
    [
        ((5.0, 3.0), True, True),  # one falls, the other stays
        ((5.0, 3.05), True, True),  # 3 % in the mean square does not matter
        ((5.0, 3.3), True, False),  # a fall by three quarters against a rise by a sixth: not at the end
        ((5.0, 7.0), False, False),
        ((11.0, 3.0), False, False),
        ((10.0, 3.0), False, False),  # nothing changes
    ],
)
def test_what_is_accepted_falls_in_all_and_what_is_kept_rises_in_none(unseen, after, accepted, kept):
    child, parent = hypothesis(*after), hypothesis(10.0, 3.0)
    assert unseen.accepts(child, parent) is accepted
    assert unseen.keeps(child, parent) is kept


def test_a_sensor_at_its_noise_is_not_worse(unseen):
    assert unseen.keeps(hypothesis(5.0, 1.04), hypothesis(10.0, 0.5))


@pytest.mark.parametrize(("spread", "accepted"), [(0.5, True), (8.0, False)])
def test_a_fall_within_its_scatter_from_block_to_block_is_chance(unseen, spread, accepted):
    """Mean squares fall by 1 ± spread over 16 blocks: four standard errors of the mean are 0.5 and 8."""
    squares = 16.0 - 1.0 + spread * np.tile([1.0, -1.0], BLOCKS // 2)
    child = hypothesis(np.repeat(np.sqrt(squares), SAMPLES // BLOCKS), 1.0)
    assert unseen.accepts(child, hypothesis(4.0, 1.0)) is accepted


def test_a_model_that_does_not_simulate_is_never_accepted_and_always_beaten(unseen):
    fails = hypothesis(1.0, np.inf)
    assert unseen.accepts(hypothesis(5.0, 5.0), fails)
    assert not unseen.accepts(fails, hypothesis(5.0, 5.0))
    assert unseen.pooled(fails) == np.inf


def test_share_of_the_misfit_beyond_noise_that_is_explained(unseen):
    """Ranges are 16 and 20 times the noise: mean squares of 9 and 4 leave 8/256 + 3/400, of 3 and 1 only 2/256."""
    parent, child = hypothesis(3.0, 2.0), hypothesis(np.sqrt(3.0), 1.0)
    share = unseen.share_explained(child, parent)
    assert share == pytest.approx(1 - (2 / 256) / (8 / 256 + 3 / 400), rel=1e-9)
    assert unseen.share_explained(parent, child) == 0.0
    assert unseen.share_explained(hypothesis(1.0, 1.0), parent) == pytest.approx(1.0)
    assert unseen.share_explained(child, hypothesis(1.0, 1.0)) == 0.0  # there is no misfit


def test_nothing_measured_leaves_no_figure(unseen):
    found = hypothesis(1.0, 1.0)
    found.fit.left[:] = np.nan
    segment = replace(found.fit.problem.data.segments[0], readings=np.full((SAMPLES, 3), np.nan))
    found.fit.problem.data = FitData((segment,), NOISE)
    assert np.isnan(unseen.error(found).pooled)
