"""Frequency and damping read off made-up signals."""

import numpy as np
import pytest

from matching.match.verify import SwingingModes, neighbours
from modelling.modal import ringing
from modelling.modal.ringing import pencil, read_modes, thinned

STEP = 1e-3
TIME = np.arange(4000) * STEP
SHAPES = np.array([[1, -1], [0.5 * np.exp(1j), 0.7]])
TRUE = [(1.6, 0.044), (8.44, 0.022)]


def rings(frequency, ratio, amplitude=1.0):
    rate = 2 * np.pi * frequency * (-ratio + 1j * np.sqrt(1 - ratio**2))
    return (amplitude * np.exp(rate * TIME)).real


def signals(noise=0.0, seed=0):
    drift = np.stack([3 + 2 * TIME, 1 - 0.2 * TIME], axis=1)
    made = sum(np.stack([rings(*mode, a) for a in shape], axis=1) for mode, shape in zip(TRUE, SHAPES, strict=True))
    fast = np.stack([rings(45, 0.25, 2), rings(46, 0.2, 1)], axis=1)
    return drift + made + fast + noise * np.random.default_rng(seed).normal(size=made.shape)


@pytest.mark.parametrize(("noise", "frequency", "damping"), [(0.0, 1e-9, 1e-9), (0.01, 5e-4, 5e-4), (0.05, 3e-3, 2e-3)])
def test_two_modes_on_a_drift(noise, frequency, damping):
    for seed in range(3 if noise else 1):
        found = read_modes(signals(noise, seed), STEP, SHAPES)
        for one, (f, ratio) in zip(found, TRUE, strict=True):
            assert one is not None
            assert one.frequency == pytest.approx(f, rel=frequency)
            assert one.damping_ratio == pytest.approx(ratio, abs=damping)


def test_thinning_keeps_poles():
    few, step = thinned(signals(), STEP, 30.0)
    assert len(few) < 1000
    poles = pencil(few, step).poles
    for f, ratio in TRUE:
        true = 2 * np.pi * f * (-ratio + 1j * np.sqrt(1 - ratio**2))
        assert np.abs(poles - true).min() < 1e-8 * abs(true)


def test_what_does_not_ring_is_not_seen():
    quiet = np.stack([3 + 2 * TIME, np.exp(-TIME / 0.5)], axis=1)
    assert read_modes(quiet, STEP, SHAPES) == [None, None]
    line = np.stack([3 + 2 * TIME, 1 - 0.2 * TIME], axis=1)  # what rounding adds, differs by processor: here a mode
    rounding = 1e-13 * np.outer(np.sin(2 * np.pi * 3.7 * TIME), [1, -1])
    assert read_modes(line + rounding, STEP, SHAPES) == [None, None]
    assert read_modes(line + 1e6 * rounding, STEP, SHAPES)[0].frequency == pytest.approx(3.7, rel=1e-6)
    noise = np.random.default_rng(1).normal(size=(4000, 2))
    assert read_modes(noise, STEP, SHAPES) == [None, None]


@pytest.mark.parametrize("ratio", [0.1, 0.15, 0.25])
def test_what_dies_away_soon(ratio):
    """Over before a tenth of the record is, beside a slower one that rings on; noise of a thousandth."""
    noise = 1e-3 * np.random.default_rng(2).normal(size=(4000, 2))
    parts = [
        np.stack([rings(*mode, a) for a in shape], axis=1) for mode, shape in zip([TRUE[0], (8.44, ratio)], SHAPES)
    ]
    slow, fast = read_modes(sum(parts) + noise, STEP, SHAPES)
    assert slow.frequency == pytest.approx(TRUE[0][0], rel=1e-3)
    assert fast.frequency == pytest.approx(8.44, rel=5e-3)
    assert fast.damping_ratio == pytest.approx(ratio, abs=5e-3)


def test_shorter_parts_add_no_modes_of_noise(monkeypatch):
    """Pure noise passes for a mode here and there on a whole record (10 of 80 times, measured): its parts add none."""

    def taken():
        random = np.random.default_rng(3)
        pairs = [read_modes(random.normal(size=(1000, 2)), STEP, SHAPES) for _ in range(12)]
        return [one is not None for pair in pairs for one in pair]

    with_parts = taken()
    monkeypatch.setattr(ringing, "HALVINGS", 0)
    assert with_parts == taken()


def test_a_mode_of_another_shape_is_not_taken():
    both = np.stack([rings(1.6, 0.04), rings(1.6, 0.04)], axis=1)
    assert read_modes(both, STEP, np.array([[1, -1]])) == [None]
    assert read_modes(both, STEP, np.array([[1, 1]]))[0].frequency == pytest.approx(1.6)


def test_too_short_a_record():
    assert read_modes(signals()[:15], STEP, SHAPES) == [None, None]
    with pytest.raises(ValueError, match="20 finite"):
        pencil(np.full((50, 1), np.nan), STEP)


def test_a_neighbour_that_moves_the_sensors_nearly_alike_is_not_taken_for_the_mode():
    """7.854 Hz wanted, 7.749 Hz beside it: within any tolerance in frequency, told apart by shape alone."""
    wanted, beside = np.array([1.0, 0.8, 0.2]), np.array([1.0, 0.5, 0.1])
    only_beside = np.outer(rings(7.749, 0.01), beside)
    taken = read_modes(only_beside, STEP, wanted[None])[0]
    assert taken.frequency == pytest.approx(7.749, rel=1e-6)  # so it was: nothing else looks like it
    assert read_modes(only_beside, STEP, wanted[None], neighbours=beside[None]) == [None]
    both = only_beside + np.outer(rings(7.854, 0.02, 0.3), wanted)
    (mode,) = read_modes(both, STEP, wanted[None], neighbours=beside[None])
    assert mode.frequency == pytest.approx(7.854, rel=1e-6)
    assert mode.damping_ratio == pytest.approx(0.02, rel=1e-5)


def test_neighbours_are_near_in_frequency_and_not_damped_much_more():
    values = np.array([-0.1 + 49j, -0.5 + 48.5j, -30 + 40j, -0.3 + 270j])
    swinging = SwingingModes(values, np.eye(4))
    assert neighbours(swinging, [1]) == [0]
    assert neighbours(swinging, [0]) == []  # the other is damped five times as much
    assert neighbours(swinging, [1, 0, None]) == []
