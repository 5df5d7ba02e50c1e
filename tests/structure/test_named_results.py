"""What goes from room to room has names: no tuple of three or more, no dict of results.

The content of a result file, which ``to_dict`` gives, is the one dict of results that other rooms read.
"""

import ast

import pytest
from structure.imports import modules, tree
from structure.test_rooms import room

CONTENT = "the content of a result file, or a part of it"
TABLE = "the tables of an input file"
TEMPLATE = "what a page's template is filled with"
# Each with its reason; a name of its own class is what a result needs instead.
ALLOWED = {
    "modelling.toml.check_keys": TABLE,
    "modelling.toml.read_toml": TABLE,
    "modelling.effects.effect.Drivetrain.parameters": "quantities by name, whose class effects do not know",
    "modelling.writing.write_results": CONTENT,
    "matching.bed.commission.Commissioning.vehicle": CONTENT,
    "matching.bed.commission.Round.against_last_vehicle": CONTENT,
    "matching.bed.commission.Round.identification": CONTENT,
    "matching.bed.commission.Round.match": CONTENT,
    "matching.bed.commission.Round.verification": CONTENT,
    "matching.bed.commission.Stages.done": CONTENT,
    "matching.bed.commission.Stages.run": CONTENT,
    "matching.explore.files.case_tables": TABLE,
    "matching.explore.files.Document.content": TABLE,
    "matching.explore.files.Document.saved_content": TABLE,
    "matching.explore.common.Ended.result": CONTENT,
    "matching.explore.common.nearest_point": CONTENT,
    "matching.match.objectives.FidelityObjective.signals": "CasADi expressions by sensor",
    "matching.studies.rows": "rows of a record on disk",
    "matching.report.common.curve": "options of a library's plot call",
    "matching.report.diagnosis.content": CONTENT,
    "matching.report.match.in_time_table": TEMPLATE,
    "matching.report.match.content": CONTENT,
}
COMMANDS = "matching.commands."  # their ``run`` gives the content that --json prints


def large_tuples(annotation: ast.expr | None) -> bool:
    """Whether an annotation holds a tuple of three entries or more that have no names."""
    return annotation is not None and any(
        isinstance(node, ast.Subscript)
        and ast.unparse(node.value) == "tuple"
        and isinstance(node.slice, ast.Tuple)
        and len(node.slice.elts) >= 3
        for node in ast.walk(annotation)
    )


def dicts_of_anything(annotation: ast.expr | None) -> bool:
    """Whether an annotation holds a dict or mapping of names to values of any class."""
    return annotation is not None and any(
        isinstance(node, ast.Subscript)
        and ast.unparse(node.value) in ("dict", "Mapping", "MutableMapping")
        and isinstance(node.slice, ast.Tuple)
        and [ast.unparse(each) for each in node.slice.elts] == ["str", "Any"]
        for node in ast.walk(annotation)
    )


@pytest.fixture(scope="module")
def taken() -> set[tuple[str, str]]:
    """Module and name of what another room imports."""
    return {
        (part.module, name.name)
        for module in modules()
        for part in ast.walk(tree(module))
        if isinstance(part, ast.ImportFrom) and part.module in modules() and room(part.module) != room(module)
        for name in part.names
    }


def returned() -> dict[tuple[str, str], ast.expr | None]:
    """What each function of a module returns."""
    return {
        (module, node.name): node.returns
        for module in modules()
        for node in tree(module).body
        if isinstance(node, ast.FunctionDef)
    }


def members(parsed: ast.Module) -> dict[str, ast.expr | None]:
    """Annotations of the public fields, and of what the public methods return, of the public classes of a file."""
    annotations = {}
    for kind in parsed.body:
        if not isinstance(kind, ast.ClassDef) or kind.name.startswith("_"):
            continue
        for part in kind.body:
            if isinstance(part, ast.FunctionDef):
                annotations[f"{kind.name}.{part.name}"] = part.returns
            elif isinstance(part, ast.AnnAssign):
                annotations[f"{kind.name}.{ast.unparse(part.target)}"] = part.annotation
    return {name: kind for name, kind in annotations.items() if not name.partition(".")[2].startswith("_")}


def test_no_anonymous_tuple_of_three_goes_from_room_to_room(taken):
    """What a function gives to another room has names."""
    returns = returned()
    assert [place for place in sorted(taken & set(returns)) if large_tuples(returns[place])] == []


def test_no_dict_of_results_goes_from_room_to_room(taken):
    """Neither from a function, nor as a field or from a method of a public class; and no reason is left over."""
    returns = returned()
    dicts = {f"{module}.{name}" for module, name in returns if dicts_of_anything(returns[module, name])}
    dicts = {name for name in dicts if tuple(name.rsplit(".", 1)) in taken}
    for module in modules():
        dicts |= {f"{module}.{name}" for name, kind in members(tree(module)).items() if dicts_of_anything(kind)}
    assert {name for name in dicts if not name.endswith(".to_dict") and not name.startswith(COMMANDS)} == set(ALLOWED)


def test_a_tuple_of_three_is_noticed():
    for text, large in (
        ("list[tuple[str, str, float]]", True),
        ("tuple[A, B, tuple[str, ...]]", True),
        ("tuple[tuple[A, B], ...]", False),
    ):
        assert large_tuples(ast.parse(text, mode="eval").body) == large, text


def test_a_dict_of_anything_is_noticed():
    for text, anything in (
        ("dict[str, Any]", True),
        ("tuple[Mapping[str, Any], ...] | None", True),
        ("dict[str, float]", False),
    ):
        assert dicts_of_anything(ast.parse(text, mode="eval").body) == anything, text
    parsed = ast.parse("class A:\n    x: dict[str, Any]\n    _y: int\n    def z(self): ...\nclass _B:\n    x: int")
    assert sorted(members(parsed)) == ["A.x", "A.z"]
