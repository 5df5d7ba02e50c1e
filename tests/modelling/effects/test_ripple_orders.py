"""Orders of a torque over an angle, found in one spectrum whose size follows the recording and not the angle."""

import tracemalloc

import numpy as np
import pytest

from modelling.effects.torques import outstanding_orders


def test_the_order_of_a_ripple_stands_out_first():
    angle = 3.0 * np.linspace(0, 20, 20001) ** 2  # rad, a run-up to 1150 1/min
    torque = np.sin(3.2 * angle) + 0.1 * np.random.default_rng(1).standard_normal(len(angle))
    order, _ = next(iter(outstanding_orders(angle, torque)))
    assert order == pytest.approx(3.2, abs=np.pi / np.ptp(angle) * 2)


@pytest.mark.parametrize("order", [36, 72, 90])
def test_cogging_stands_out_first(order):
    """The least common multiple of slots and poles, in noise that is five times as large; 2000 samples a second."""
    rng = np.random.default_rng(order)
    time = np.arange(20_000) / 2000
    angle = 2 * np.pi * (2.0 * time + 0.4 * time**2)
    torque = np.sin(order * angle + 1) + 5 * rng.standard_normal(len(time))
    found = [found for found, _ in outstanding_orders(angle, torque) if found > 24]
    assert found[0] == pytest.approx(order, abs=2 * np.pi / np.ptp(angle))


def test_over_a_turn_or_two_every_order_is_tried():
    """Half a spectral line is 0.4 orders of 1.25 turns; the spectrum alone would offer the four that stand out most."""
    angle = 2.5 * np.pi * np.sin(np.linspace(0, 9, 4001)) / 2
    orders = [order for order, _ in outstanding_orders(angle, np.sin(2.0 * angle))]
    assert np.diff(orders) == pytest.approx(np.pi / np.ptp(angle))
    assert min(orders) < 0.5 < 23.5 < max(orders)


def test_the_ends_of_the_spectrum_do_not_stand_out_of_noise():
    angle = np.linspace(0, 200.0, 20001)
    for seed in range(20):
        torque = np.random.default_rng(seed).standard_normal(len(angle))
        orders = [order for order, _ in outstanding_orders(angle, torque)]
        assert sum(order < 0.6 for order in orders) < 2
        assert sum(order > 99.2 for order in orders) < 2


def test_an_angle_far_beyond_the_samples_costs_no_memory():
    """500 samples over 9e5 rad: with ten bins a period of order 100 the spectrum would need gigabytes."""
    angle = np.linspace(0, 9e5, 500)
    tracemalloc.start()
    list(outstanding_orders(angle, np.sin(angle)))
    largest = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert largest < 5e6
