"""The imports of the program as a graph, read from its source."""

import ast
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("modelling", "matching")


@dataclass(frozen=True)
class Arrow:
    """One import: ``source`` and ``target`` are dotted modules, ``inside`` whether it stands in a function."""

    source: str
    target: str
    line: int
    inside: bool
    for_types: bool

    def __str__(self) -> str:
        return f"{self.source}:{self.line} -> {self.target}"


@cache
def modules() -> dict[str, Path]:
    """Every module of the program by its dotted name."""
    files = [ROOT / "rigmatch.py"] if (ROOT / "rigmatch.py").exists() else []
    files += [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]
    return {dotted(path): path for path in files}


def dotted(path: Path) -> str:
    """``modelling/model/system.py`` → ``modelling.model.system``."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def tree(module: str) -> ast.Module:
    """The syntax tree of a module."""
    return ast.parse(modules()[module].read_text(encoding="utf-8"))


@cache
def arrows() -> list[Arrow]:
    """Every import of one module of the program by another."""
    known = modules()
    found = []
    for source in known:
        for node, inside, for_types in _imports(tree(source), False, False):
            for name in _names(node):
                target = name if name in known else name.rpartition(".")[0]
                if target in known and target != source:
                    found.append(Arrow(source, target, node.lineno, inside, for_types))
    return found


def _imports(node: ast.AST, inside: bool, for_types: bool):
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.Import | ast.ImportFrom):
            yield child, inside, for_types
        else:
            function = isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
            types = isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test)
            yield from _imports(child, inside or function, for_types or types)


def _names(node: ast.Import | ast.ImportFrom) -> list[str]:
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if node.level or not node.module:
        return []
    return [f"{node.module}.{alias.name}" for alias in node.names]
