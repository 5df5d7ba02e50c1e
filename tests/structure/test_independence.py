"""The independent method shares no function with what the search and the rest of the verification compute with."""

import ast

from structure.imports import ROOT

ROOM = ROOT / "matching" / "frequency" / "independent"
DATA = {  # classes that hold a model or a case; none of them computes a matrix
    ("matching.match.case", "Case"),
    ("matching.match.case", "Box"),
    ("modelling.controller.law", "ControlLaw"),  # what is judged; its matrices are taken as they are
    ("modelling.system", "Effect"),
    ("modelling.system", "Shaft"),
    ("modelling.system", "System"),
}
LIBRARIES = ("__future__", "collections", "copy", "dataclasses", "functools", "typing", "numpy", "scipy")
COMPUTED = {
    "state_space",
    "equations",
    "controller",
    "commands",
    "sampled",
    "feed_forward",
    "residual_space",
    "space",
    "feedback",
}


def trees():
    return {path.name: ast.parse(path.read_text(encoding="utf-8")) for path in sorted(ROOM.glob("*.py"))}


def test_it_imports_libraries_and_data_classes_only():
    taken = set()
    for tree in trees().values():
        for node in ast.walk(tree):
            assert not isinstance(node, ast.Import) or all(
                alias.name.split(".")[0] in LIBRARIES for alias in node.names
            )
            if isinstance(node, ast.ImportFrom) and node.module.split(".")[0] not in LIBRARIES:
                taken |= {(node.module, alias.name) for alias in node.names}
    outside = {(module, name) for module, name in taken if not module.startswith("matching.frequency.independent")}
    assert outside == DATA


def test_it_asks_no_object_for_anything_computed():
    attributes = {node.attr for tree in trees().values() for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    assert attributes & COMPUTED == set()
