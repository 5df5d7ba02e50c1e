"""What is known of an effect stands in its file: no other file names a kind of effect."""

import ast
import re

from structure.imports import modules

from modelling.effects import EFFECTS

# text that is also the name of something else
# a quantity of the control loop, ``loop.dead_time``; any table, of a file or a result
ALSO_SOMETHING_ELSE = {"dead_time", "table"}
# laws of the second opinion, which cannot be the same ones
WRITTEN_AGAIN = ("matching.match.dynamic_stiffness", "matching.match.dynamic_stiffness")


def is_docstring(node: ast.AST, parent: ast.AST) -> bool:
    return isinstance(parent, ast.Expr)


def names_of_effects(tree: ast.AST) -> list[tuple[int, str]]:
    """Line and text of every string that is the name of a kind, or has it between dots, as parameters do."""
    found = []
    for parent in ast.walk(tree):
        for node in ast.iter_child_nodes(parent):
            if not isinstance(node, ast.Constant) or not isinstance(node.value, str) or is_docstring(node, parent):
                continue
            parts = re.split(r"[.\s]", node.value) if " " not in node.value.strip() else []
            found += [(node.lineno, part) for part in parts if part in EFFECTS and part not in ALSO_SOMETHING_ELSE]
    return found


def test_no_other_file_names_a_kind_of_effect():
    named = {
        f"{module}:{line}": name
        for module, path in modules().items()
        if not module.startswith(("modelling.effects", *WRITTEN_AGAIN))
        for line, name in names_of_effects(ast.parse(path.read_text(encoding="utf-8")))
    }
    assert named == {}


def test_the_search_notices_a_name():
    for text in ('kind == "backlash"', 'f"{name}.backlash.gap"', 'name.endswith(".lag")', '{"slip": 1}'):
        assert names_of_effects(ast.parse(text)), text
    assert not names_of_effects(ast.parse('"""about backlash"""\nx = "hess_lag"\ny = loop["dead_time"]'))
