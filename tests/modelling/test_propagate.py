"""Linear motions from sample to sample: closed forms, and stepping one sample after another."""

import numpy as np
import pytest

from modelling.linear.state_space import linear_motion, propagated


@pytest.mark.parametrize("count", [1, 2, 3, 10, 17])
def test_it_is_stepping(count):
    random = np.random.default_rng(1)
    transition, added, x = 0.6 * random.normal(size=(3, 3)), random.normal(size=(count, 3)), random.normal(size=3)
    states = propagated(transition, added, x)
    assert states.shape == (count, 3)
    for state, push in zip(states, added, strict=True):
        np.testing.assert_allclose(state, x, rtol=1e-9, atol=1e-9)
        x = transition @ x + push


def test_a_ramp_drives_a_lag_as_its_closed_form_says():
    """T·y' + y = u, u = t: y = t − T·(1 − exp(−t/T)), exact for inputs that are linear between samples."""
    time, lag = 0.01 * np.arange(301), 0.3
    (y,) = linear_motion(np.array([[-1 / lag]]), np.array([[1 / lag]]), time[:, None], 0.01).T
    np.testing.assert_allclose(y, time - lag * (1 - np.exp(-time / lag)), atol=1e-12)


def test_a_motion_that_grows_beyond_a_float_is_not_finite():
    states = propagated(np.array([[1e20]]), np.ones((400, 1)), np.zeros(1))
    assert not np.isfinite(states).all()
