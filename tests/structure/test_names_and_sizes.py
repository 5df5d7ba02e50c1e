"""No class name stands twice in the program; files and functions stay small, or say in a line why not."""

import ast
from collections import defaultdict

import pytest
from structure.imports import modules

LONGEST_FILE = 300  # lines


@pytest.fixture(scope="module")
def trees() -> dict[str, ast.Module]:
    return {module: ast.parse(path.read_text(encoding="utf-8")) for module, path in modules().items()}


def test_no_class_name_stands_twice(trees):
    places = defaultdict(list)
    for module, tree in trees.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                places[node.name].append(module)
    assert {name: files for name, files in places.items() if len(files) > 1} == {}
