"""Functions worked out for many points at once: the same values as one by one, and really compiled."""

import casadi as ca
import numpy as np
import pytest
from needs import compiles

from modelling.simulation import compiled as c_library
from modelling.simulation.compiled import VectorFunction


@pytest.fixture(scope="module")
def function():
    x, s = ca.SX.sym("x", 2), ca.SX.sym("s")
    outputs = [
        ca.vertcat(ca.exp(s) * x[0] / x[1], ca.atan2(x[0], s)),
        ca.sqrt(x[1]) + ca.log(x[1]) - 2 * ca.cos(s) ** 2,
    ]
    return ca.Function("several", [s, x], outputs)


@pytest.fixture(scope="module")
def points():
    random = np.random.default_rng(0)
    return random.normal(size=(1, 3, 1)), random.uniform(0.5, 2, (2, 1, 13))  # 13: no whole number of vectors


def by_hand(s, x):
    return np.stack(np.broadcast_arrays(
        np.exp(s[0]) * x[0] / x[1], np.arctan2(x[0], s[0]), np.sqrt(x[1]) + np.log(x[1]) - 2 * np.cos(s[0]) ** 2
    ))  # fmt: skip


@compiles
def test_compiled_it_gives_what_is_worked_out_by_hand(function, points):
    vectors = VectorFunction(function)
    assert vectors.compiled
    np.testing.assert_allclose(vectors(*points), by_hand(*points), rtol=1e-14)


def test_without_a_compiler_too(function, points, monkeypatch):
    monkeypatch.setattr(c_library, "compiler", lambda: None)
    vectors = VectorFunction(function)
    assert not vectors.compiled
    np.testing.assert_allclose(vectors(*points), by_hand(*points), rtol=1e-14)


def test_an_instruction_that_is_not_known_in_c_is_left_to_casadi():
    x = ca.SX.sym("x")
    vectors = VectorFunction(ca.Function("error", [x], [ca.erf(x)]))
    assert not vectors.compiled
    assert vectors(np.array([[[0.5, -0.5]]]))[0, 0].tolist() == pytest.approx([0.5204998778, -0.5204998778])
