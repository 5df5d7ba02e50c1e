"""Public functions give shapes, units and errors; those of the public face give everything."""

import pytest
from structure import docstrings


def test_arrays_have_shapes():
    assert docstrings.without_shapes() == []
    assert docstrings.fields_without_shapes() == []


def test_errors_are_said():
    assert docstrings.without_raises() == []


def test_physical_quantities_have_units():
    assert docstrings.without_units() == []


@pytest.mark.parametrize(
    ("text", "holds"), [("x (n,)", True), ("H (f, y, u)", True), ("(b)", True), ("(GUM H.3)", False)]
)
def test_shapes_are_told_from_other_brackets(text, holds):
    assert docstrings.has_shape(text) == holds
