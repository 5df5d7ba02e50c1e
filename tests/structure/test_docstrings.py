"""Public functions give shapes, units and errors; those of the public face give everything."""

import re

import pytest
from structure import docstrings

import rigmatch as rm


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


def test_the_public_face_is_documented_wholly():
    """Every parameter, what comes back, errors and an example."""
    lacking = []
    face = [
        found
        for found in docstrings.public_functions()
        if found.module.startswith("matching.api.") and found.name in rm.__all__
    ]
    assert sorted(found.name for found in face) == sorted(rm.__all__)
    for found in face:
        described = found.text.partition("Parameters\n---")[2].partition("Returns\n---")[0]
        names = {argument.arg for argument in [*found.node.args.args, *found.node.args.kwonlyargs]}
        lacking += [
            f"{found.name}: {name}"
            for name in names
            if not re.search(rf"(?m)^[\w, ]*\b{name}\b[\w, ]*( :|$)", described)
        ]
        lacking += [
            f"{found.name}: {part}" for part in ("Returns", "Raises", "Examples") if f"\n{part}\n---" not in found.text
        ]
    assert lacking == []
