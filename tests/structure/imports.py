"""The imports of the program as a graph, read from its source."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("modelling", "matching")


@cache
def modules() -> dict[str, Path]:
    """Every module of the program by its dotted name."""
    files = [ROOT / "rigmatch.py", *(path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py")))]
    names = [".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__") for path in files]
    return dict(zip(names, files))


@cache
def arrows() -> dict[str, set[str]]:
    """By module the modules of the program that it imports, at the top of the file or in a function."""
    known = modules()
    return {
        source: {
            target
            for name in imported(path)
            if (target := name if name in known else name.rpartition(".")[0]) in known and target != source
        }
        for source, path in known.items()
    }


def imported(path: Path) -> Iterator[str]:
    """Dotted names that a file imports."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
