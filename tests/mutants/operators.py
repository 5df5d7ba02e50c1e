"""The faults that can be planted in a file: mutmut's operators and a few of this project, less what the rules say.

mutmut (3.x) supplies the operators; it runs whole projects by copying every function and dispatching at run time, which
leaves out decorated functions and constants of modules. Here each fault is written into the file itself.

Left out, because no test can or should notice them:

- texts: docstrings, strings with a blank, f-strings, help of the command line, and all in ``raise`` and ``warn``
- types: annotations, decorators, type aliases, ``cast``, ``TYPE_CHECKING``, abstract methods
- checks of the programmer: ``assert``, ``strict=``, ``encoding=``, ``stacklevel=``
- the look of figures: colours, widths, sizes and places of text (:data:`LOOK`); widths and heights in pixels of what
  stands on the explorer's page (:data:`PIXELS`)
- speed: lines whose comment says ``speed only``
- comparisons of real quantities at equality: ``<`` becomes ``>=`` there, and ``<=`` only against a count
- arguments swapped where their order means nothing (:data:`SYMMETRIC`)

Real numbers from 1e-6 on are doubled (mutmut adds 1, which is nothing to 1e6); smaller ones get mutmut's 1.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import libcst as cst
from libcst.metadata import MetadataWrapper, PositionProvider
from mutmut.mutation import mutators

_LOOK = """
    color colors c cmap facecolor edgecolor alpha linewidth linewidths lw linestyle ls marker markersize ms s
    zorder fontsize size weight style figsize dpi pad labelpad loc ncol ncols frameon bbox_to_anchor rotation ha
    va horizontalalignment verticalalignment width_ratios height_ratios hspace wspace layout capsize levels
    hatch handlelength columnspacing borderpad left right top bottom rasterized antialiased clip_on xytext
    textcoords linespacing
"""
_SYMMETRIC = """
    min max hypot maximum minimum fmin fmax isclose allclose array_equal union gcd dot inner convolve add
    multiply logical_and logical_or isinstance Add Mul Max Min zip product set_aspect
"""
LOOK, SYMMETRIC = set(_LOOK.split()), set(_SYMMETRIC.split())  # names of keyword arguments, of functions
PAGE, PIXELS = "matching/explore/page/", {"width", "height"}  # elsewhere these may be quantities
PROGRAMMER = {"strict", "encoding", "stacklevel", "errors", "repr"}
TEXTS = {"help", "metavar", "description", "epilog"}  # of the command line
PAIRS = (
    ("min", "max"),
    ("minimum", "maximum"),
    ("fmin", "fmax"),
    ("argmin", "argmax"),
    ("nanmin", "nanmax"),
    ("any", "all"),
    ("sin", "cos"),
    ("sinh", "cosh"),
    ("floor", "ceil"),
    ("real", "imag"),
    ("upper", "lower"),
)
SWAPPED_NAMES = {a: b for pair in PAIRS for a, b in (pair, pair[::-1])}
INVERTED: dict[type, type] = {
    cst.LessThan: cst.GreaterThanEqual,
    cst.LessThanEqual: cst.GreaterThan,
    cst.GreaterThan: cst.LessThanEqual,
    cst.GreaterThanEqual: cst.LessThan,
}
SMALL_NUMBER = 1e-6  # real numbers below are guards against rounding: changed in earnest, not by a factor of two

Change = cst.CSTNode


@dataclass(frozen=True)
class Fault:
    """One planted fault: where it stands, what kind it is, and the nodes before and after.

    ``lines`` are those of its statement (of the whole function for a default value), first and last;
    ``constant`` is the name it gives a value to outside of functions, which no test runs but all may use.
    """

    file: str
    lines: tuple[int, int]
    constant: str | None
    line: int
    column: int
    kind: str
    before: cst.CSTNode
    after: cst.CSTNode
    module: cst.Module

    @property
    def change(self) -> str:
        """Before → after, on one line."""
        texts = [" ".join(self.module.code_for_node(node).split()) for node in (self.before, self.after)]
        return " → ".join(text if len(text) <= 90 else f"{text[:87]}..." for text in texts)

    @property
    def source(self) -> str:
        """The whole file with the fault in it."""
        return self.module.deep_replace(self.before, self.after).code


def number(node: cst.BaseNumber) -> Iterator[Change]:
    value = node.evaluated_value
    if isinstance(node, cst.Float) and abs(value) >= SMALL_NUMBER:
        yield node.with_changes(value=repr(2 * value))
    elif isinstance(node, cst.Integer) and abs(value) >= 100:
        yield node.with_changes(value=str(2 * value))
    else:
        yield from mutators.operator_number(node)


def string(node: cst.SimpleString) -> Iterator[Change]:
    if " " not in node.value and node.evaluated_value:
        yield from list(mutators.operator_string(node))[:1]


def comparison(node: cst.ComparisonTarget) -> Iterator[Change]:
    if type(node.operator) not in INVERTED or isinstance(node.comparator, cst.Integer):
        yield from mutators.operator_swap_op(node)
    else:
        yield node.with_changes(operator=INVERTED[type(node.operator)]())


def arithmetic(node: cst.CSTNode) -> Iterator[Change]:
    yield from mutators.operator_swap_op(node)


def condition(node: cst.If | cst.While | cst.IfExp | cst.CompIf) -> Iterator[Change]:
    inverted = cst.UnaryOperation(cst.Not(), node.test.with_changes(lpar=[cst.LeftParen()], rpar=[cst.RightParen()]))
    if isinstance(node, cst.IfExp | cst.CompIf):
        inverted = inverted.with_changes(lpar=[cst.LeftParen()], rpar=[cst.RightParen()])
    yield node.with_changes(test=inverted)


def name(node: cst.Name) -> Iterator[Change]:
    if node.value in ("True", "False"):
        yield from mutators.operator_name(node)


def function_name(node: cst.Call) -> Iterator[Change]:
    function = node.func
    bare = function.attr if isinstance(function, cst.Attribute) else function
    if isinstance(bare, cst.Name) and bare.value in SWAPPED_NAMES:
        yield node.with_deep_changes(bare, value=SWAPPED_NAMES[bare.value])


def argument(node: cst.Call) -> Iterator[Change]:
    """Lose an argument or its value, but none whose keyword makes no difference to what is worked out."""
    free = [i for i, one in enumerate(node.args) if one.keyword and one.keyword.value in LOOK | PROGRAMMER | TEXTS]
    for changed in mutators.operator_arg_removal(node):
        if all(any(one.deep_equals(node.args[i]) for one in changed.args) for i in free):
            yield changed


def swapped_arguments(node: cst.Call) -> Iterator[Change]:
    function = node.func.attr if isinstance(node.func, cst.Attribute) else node.func
    plain = [i for i, one in enumerate(node.args) if one.star == "" and one.keyword is None]
    if len(plain) < 2 or (isinstance(function, cst.Name) and function.value in SYMMETRIC):
        return
    i, j = plain[:2]
    args = list(node.args)
    if args[i].value.deep_equals(args[j].value):
        return
    args[i], args[j] = args[i].with_changes(value=args[j].value), args[j].with_changes(value=args[i].value)
    yield node.with_changes(args=args)


def element(node: cst.Tuple | cst.List | cst.Set) -> Iterator[Change]:
    """Drop an element of a list of words or numbers."""
    literal = (cst.SimpleString, cst.BaseNumber)
    if len(node.elements) > 2 and all(isinstance(one.value, literal) for one in node.elements):
        for i in range(len(node.elements)):
            yield node.with_changes(elements=[*node.elements[:i], *node.elements[i + 1 :]])


def call_statement(node: cst.Expr) -> Iterator[Change]:
    """Leave out a call that is made for what it does."""
    if isinstance(node.value, cst.Call):
        yield node.with_changes(value=cst.Name("None"))


def assignment(node: cst.Assign | cst.AnnAssign) -> Iterator[Change]:
    """Lose a value, but not a False, which is as untrue when it is lost."""
    if not (isinstance(node.value, cst.Name) and node.value.value == "False"):
        yield from mutators.operator_assignment(node)


OPERATORS: list[tuple[str, tuple[type, ...], Callable]] = [
    ("number", (cst.BaseNumber,), number),
    ("string", (cst.SimpleString,), string),
    ("comparison", (cst.ComparisonTarget,), comparison),
    ("arithmetic", (cst.BinaryOperation, cst.UnaryOperation, cst.BooleanOperation, cst.AugAssign), arithmetic),
    ("arithmetic", (cst.AugAssign,), mutators.operator_augmented_assignment),
    ("negation", (cst.UnaryOperation,), mutators.operator_remove_unary_ops),
    ("condition", (cst.If, cst.While, cst.IfExp, cst.CompIf), condition),
    ("keyword", (cst.Break, cst.Continue), mutators.operator_keywords),
    ("constant", (cst.Name,), name),
    ("function", (cst.Call,), function_name),
    ("argument", (cst.Call,), argument),
    ("swapped", (cst.Call,), swapped_arguments),
    ("element", (cst.Tuple, cst.List, cst.Set), element),
    ("statement", (cst.Expr,), call_statement),
    ("assignment", (cst.Assign, cst.AnnAssign), assignment),
    ("lambda", (cst.Lambda,), mutators.operator_lambda),
    ("case", (cst.Match,), mutators.operator_match),
]


def faults(path: Path, root: Path) -> list[Fault]:
    """Every fault that can be planted in a file."""
    wrapper = MetadataWrapper(cst.parse_module(path.read_text(encoding="utf-8")))
    visitor = _Visitor(str(path.relative_to(root)), wrapper.module)
    wrapper.visit(visitor)
    return visitor.faults


class _Visitor(cst.CSTVisitor):
    METADATA_DEPENDENCIES = (PositionProvider,)

    def __init__(self, file: str, module: cst.Module):
        super().__init__()
        self.file, self.module, self.depth = file, module, 0
        self.lines = module.code.splitlines()
        self.statement: tuple[int, int] = (1, 1)
        self.constant: str | None = None
        self.faults: list[Fault] = []

    def on_visit(self, node: cst.CSTNode) -> bool:
        if isinstance(node, cst.FunctionDef):
            self.depth += 1
        if self._left_out(node):
            return False
        self._enter(node)
        position = self.get_metadata(PositionProvider, node, None)
        if position and not self._for_speed(position.start.line):
            start = position.start
            for kind, types, operator in OPERATORS:
                if isinstance(node, types):
                    for after in operator(node):
                        where = (self.file, self.statement, self.constant, start.line, start.column)
                        self.faults.append(Fault(*where, kind, node, after, self.module))
        return True

    def on_leave(self, original_node: cst.CSTNode) -> None:
        if isinstance(original_node, cst.FunctionDef):
            self.depth -= 1

    def _enter(self, node: cst.CSTNode) -> None:
        """Note the lines of the statement that begins here, and the name it gives a value to."""
        if not isinstance(node, cst.SimpleStatementLine | cst.BaseCompoundStatement):
            return
        position = self.get_metadata(PositionProvider, node)
        first, last = position.start.line, position.end.line
        if isinstance(node, cst.BaseCompoundStatement) and not isinstance(node, cst.FunctionDef | cst.Match):
            last = max(first, self.get_metadata(PositionProvider, node.body).start.line - 1)
        self.statement, self.constant = (first, last), None
        if self.depth == 0:
            assignment = node.body[0] if isinstance(node, cst.SimpleStatementLine) else node
            target = assignment.targets[0] if isinstance(assignment, cst.Assign) else assignment
            name = getattr(target, "target", None)
            self.constant = name.value if isinstance(name, cst.Name) else ""

    def _for_speed(self, line: int) -> bool:
        return "speed only" in "".join(self.lines[line - 1 : line]).partition("#")[2]

    def _left_out(self, node: cst.CSTNode) -> bool:
        if isinstance(node, cst.Annotation | cst.Decorator | cst.Raise | cst.Assert | cst.FormattedString):
            return True
        if isinstance(node, cst.Import | cst.ImportFrom | cst.ConcatenatedString):
            return True
        if isinstance(node, cst.Arg) and node.keyword and node.keyword.value in LOOK | PROGRAMMER | TEXTS:
            return True
        if isinstance(node, cst.Arg) and node.keyword and self.file.startswith(PAGE):
            return node.keyword.value in PIXELS and isinstance(node.value, cst.Integer)
        if isinstance(node, cst.DictElement) and isinstance(node.key, cst.SimpleString):
            return node.key.evaluated_value in LOOK  # keyword arguments that are kept in a dict
        if isinstance(node, cst.Call):
            function = node.func.attr if isinstance(node.func, cst.Attribute) else node.func
            return isinstance(function, cst.Name) and function.value in {"warn", "cast", "TypeVar", "NewType"}
        if isinstance(node, cst.If):
            return "TYPE_CHECKING" in self.module.code_for_node(node.test)
        if isinstance(node, cst.Expr):
            return isinstance(node.value, cst.BaseString | cst.Ellipsis)  # docstrings
        if isinstance(node, cst.FunctionDef):
            marks = "".join(self.module.code_for_node(one.decorator) for one in node.decorators)
            return "abstractmethod" in marks or "overload" in marks
        if isinstance(node, cst.Assign) and self.depth == 0:
            target = self.module.code_for_node(node.targets[0].target)
            alias = target[:1].isupper() and not target.isupper()  # CamelCase: a name for a type
            return target == "__all__" or alias
        return False
