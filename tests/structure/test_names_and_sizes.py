"""No class name stands twice in the program; files and functions stay small, or say in a line why not."""

import ast
import re
from collections import defaultdict

import pytest
from structure.imports import modules, tree

LONGEST_FILE = 300  # lines, all counted
LONGEST_FUNCTION = 60  # lines, all counted
MOST_PARAMETERS = 6
VAGUE_NAMES = {"own", "one", "found", "seen", "told", "given"}


@pytest.fixture(scope="module")
def trees() -> dict[str, ast.Module]:
    return {module: tree(module) for module in modules()}


def test_no_class_name_stands_twice(trees):
    places = defaultdict(list)
    for module, parsed in trees.items():
        for node in ast.walk(parsed):
            if isinstance(node, ast.ClassDef):
                places[node.name].append(module)
    assert {name: files for name, files in places.items() if len(files) > 1} == {}


def variables(parsed: ast.Module) -> set[tuple[str, int]]:
    """Names of variables and parameters, with the line they begin in."""
    stored = {(each.id, each.lineno) for each in ast.walk(parsed) if isinstance(each, ast.Name) and _is_stored(each)}
    return stored | {(each.arg, each.lineno) for each in ast.walk(parsed) if isinstance(each, ast.arg)}


def _is_stored(name: ast.Name) -> bool:
    return isinstance(name.ctx, ast.Store)


def test_variables_say_what_they_hold(trees):
    vague = [
        f"{module}:{line} {name}"
        for module, parsed in trees.items()
        for name, line in sorted(variables(parsed), key=lambda each: each[1])
        if name in VAGUE_NAMES
    ]
    assert vague == []


def functions(trees):
    for module, parsed in trees.items():
        for node in ast.walk(parsed):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                yield module, node


def test_files_are_small():
    sizes = {module: len(path.read_text(encoding="utf-8").splitlines()) for module, path in modules().items()}
    assert {module: size for module, size in sizes.items() if size > LONGEST_FILE} == {}


def test_functions_are_small(trees):
    sizes = {f"{module}.{node.name}": node.end_lineno - node.lineno + 1 for module, node in functions(trees)}
    assert {name: size for name, size in sizes.items() if size > LONGEST_FUNCTION} == {}


def test_more_than_six_parameters_have_a_reason(trees):
    """A comment in the signature or in the line above it."""
    without = []
    for module, node in functions(trees):
        given = [each.arg for each in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
        if len([name for name in given if name not in ("self", "cls")]) <= MOST_PARAMETERS:
            continue
        lines = modules()[module].read_text(encoding="utf-8").splitlines()
        first = node.lineno - 2 - len(node.decorator_list)
        if not any(re.search(r"# (?!fmt:|noqa)", line) for line in lines[first : node.body[0].lineno - 1]):
            without.append(f"{module}.{node.name}")
    assert without == []
