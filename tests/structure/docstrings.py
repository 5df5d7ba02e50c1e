"""What the docstrings of the public functions leave out, read from the source."""

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

from structure.imports import modules, tree

ARRAY = re.compile(r"\b(?:ndarray|NDArray|csr_array|csc_array)\b")
SHAPE = re.compile(r"\((?:…|\.\.\.|[a-z0-9][\w +−·*/-]*)(?:, ?[\w… .+−·*/-]+)*,?\)")
ONE_LETTER = re.compile(r"\(\w\)")
PHYSICAL = re.compile(
    r"(?:^|_)(?:frequency|frequencies|omega|time|times|delay|delays|dead_time|stiffness|torque|torques|speed|speeds|angle|"
    r"angles|lag|step|duration|period|cutoff|inertia|inertias|hertz)$"
)
UNIT = re.compile(
    r"\bSI\b|\bHz\b|\bs\b|\bms\b|\bN·m|\brad\b|kg·m²|1/min|1/s|\bdB\b|\b°|°C|\bsamples?\b|dimensionless|unit of"
)
NUMBERS = re.compile(r"\b(?:float|complex|ndarray|NDArray)\b")
SILENT = {"NotImplementedError", "AssertionError", "AttributeError", "StopIteration", "KeyboardInterrupt"}


@dataclass(frozen=True)
class Documented:
    """A public function or method with what its docstring may refer to."""

    module: str
    name: str
    line: int
    node: ast.FunctionDef
    text: str

    def __str__(self) -> str:
        return f"{self.module.replace('.', '/')}.py:{self.line} {self.name}"


@cache
def public_functions() -> list[Documented]:
    """Every public function, and every public method of a public class; laws of effects follow their base class."""
    return [
        found
        for module in modules()
        if not module.startswith("modelling.effects.") or module.endswith("interface")
        for found in _public(module, tree(module))
    ]


def _public(module: str, parsed: ast.Module) -> Iterator[Documented]:
    for node in parsed.body:
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            yield Documented(module, node.name, node.lineno, node, ast.get_docstring(node) or "")
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            above = ast.get_docstring(node) or ""
            for part in node.body:
                if isinstance(part, ast.FunctionDef) and not part.name.startswith("_"):
                    text = f"{above}\n{ast.get_docstring(part) or ''}"
                    yield Documented(module, f"{node.name}.{part.name}", part.lineno, part, text)


def without_shapes() -> list[str]:
    """Functions that take or return arrays and give no shape."""
    return [str(found) for found in public_functions() if _arrays(found.node) and not has_shape(found.text)]


def has_shape(text: str) -> bool:
    """Whether a text holds a shape such as (n,), (f, y, u)."""
    return any("," in shape or ONE_LETTER.fullmatch(shape) for shape in SHAPE.findall(text))


@cache
def _arrays(node: ast.FunctionDef) -> bool:
    return bool(ARRAY.search(" ".join(_annotations(node))))


def _annotations(node: ast.FunctionDef) -> list[str]:
    arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs, node.args.vararg, node.args.kwarg]
    notes = [argument.annotation for argument in arguments if argument] + [node.returns]
    return [ast.unparse(note) for note in notes if note]


def without_raises() -> list[str]:
    """Functions that raise, or call a private function of their file that does, and do not say so."""
    silent = [found for found in public_functions() if not re.search("[Rr]aise", found.text)]
    return [str(found) for found in silent if _errors(found.node).raises(_raising(found.module))]


@dataclass(frozen=True)
class Errors:
    """What a function raises and calls; nothing that a function it calls raises leaves one that catches."""

    raised: bool
    catches: bool
    calls: frozenset[str]

    def raises(self, helpers: frozenset[str]) -> bool:
        """Whether an error leaves the function, if these functions raise."""
        return self.raised or (not self.catches and bool(self.calls & helpers))


@cache
def _raising(module: str) -> frozenset[str]:
    """Private functions and methods of a file that raise, by name, through one another as well."""
    if "raise " not in modules()[module].read_text(encoding="utf-8"):
        return frozenset()
    functions = [node for node in ast.walk(tree(module)) if isinstance(node, ast.FunctionDef)]
    private = {node.name: _errors(node) for node in functions if node.name[0] == "_" and node.name[:2] != "__"}
    known: frozenset[str] = frozenset()
    while more := {name for name, errors in private.items() if name not in known and errors.raises(known)}:
        known |= more
    return known


@cache
def _errors(node: ast.FunctionDef) -> Errors:
    raised, caught, calls = set(), set(), set()
    for part in ast.walk(node):
        if isinstance(part, ast.Raise) and part.exc is not None:
            error = part.exc.func if isinstance(part.exc, ast.Call) else part.exc
            raised.add(ast.unparse(error).rpartition(".")[2])
        elif isinstance(part, ast.Call) and isinstance(part.func, ast.Name | ast.Attribute):
            called = part.func.id if isinstance(part.func, ast.Name) else part.func.attr
            calls.add(called)
            if called == "suppress":
                caught |= {name.id for error in part.args for name in ast.walk(error) if isinstance(name, ast.Name)}
        elif isinstance(part, ast.ExceptHandler) and part.type is not None:
            caught |= {name.id for name in ast.walk(part.type) if isinstance(name, ast.Name)}
    leaving = {name for name in raised - caught - SILENT if name[0].isupper()}
    return Errors(bool(leaving), bool(caught), frozenset(calls))


def without_units() -> list[str]:
    """Functions with a physical quantity among their arguments and no unit in their docstring."""
    return [
        f"{found} ({', '.join(names)})"
        for found in public_functions()
        if (names := _physical(found.node)) and not UNIT.search(found.text)
    ]


def _physical(node: ast.FunctionDef) -> list[str]:
    arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    return [
        argument.arg
        for argument in arguments
        if argument.annotation and NUMBERS.search(ast.unparse(argument.annotation)) and PHYSICAL.search(argument.arg)
    ]


def fields_without_shapes() -> list[str]:
    """Arrays among the fields of public classes without a shape, in the class's docstring or beside the field."""
    found = []
    for module, path in modules().items():
        source = path.read_text(encoding="utf-8")
        lines = source.splitlines()
        for node in tree(module).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                above = ast.get_docstring(node) or ""
                for field in node.body:
                    if not (isinstance(field, ast.AnnAssign) and ARRAY.search(ast.unparse(field.annotation))):
                        continue
                    beside = " ".join(lines[field.lineno - 1 : field.end_lineno])
                    comment = beside.partition("#")[2] + _text_after(node, field)
                    if not has_shape(above) and not has_shape(comment):
                        found.append(f"{module.replace('.', '/')}.py:{field.lineno} {ast.unparse(field)}")
    return found


def _text_after(node: ast.ClassDef, field: ast.AnnAssign) -> str:
    place = node.body.index(field) + 1
    after = node.body[place] if place < len(node.body) else None
    text = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
    return str(after.value.value) if text else ""


if __name__ == "__main__":
    for check in (without_shapes, without_raises, without_units, fields_without_shapes):
        names = check()
        print(f"\n== {check.__name__}: {len(names)} of {len(public_functions())}", *names, sep="\n")
