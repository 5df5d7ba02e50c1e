"""Functions compiled by a C compiler: the same values, and really compiled."""

import casadi as ca
import numpy as np
import pytest
from needs import compiles

from modelling.simulation import compiled as c_library


@pytest.fixture
def smooth():
    x = ca.SX.sym("x", 3)
    return ca.Function("smooth", [x], [ca.fmax(ca.sin(x), x**2), ca.fmin(x[0], x[1])])


@compiles
def test_an_external_function_is_compiled_and_gives_the_same(smooth):
    compiled = c_library.external(smooth)
    assert compiled.class_name() == "External"
    for point in np.random.default_rng(0).normal(size=(5, 3)):
        for mine, theirs in zip(compiled(point), smooth(point), strict=True):
            np.testing.assert_allclose(mine.full(), theirs.full(), rtol=1e-14)


def test_without_a_compiler_it_is_the_function_itself(monkeypatch, smooth):
    monkeypatch.setattr(c_library, "compiler", lambda: None)
    assert c_library.external(smooth) is smooth
    assert c_library.driver() is None
