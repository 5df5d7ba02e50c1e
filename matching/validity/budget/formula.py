"""From the text of a formula to a SymPy expression, without evaluating any of the text.

The text goes through Python's own grammar (``ast``); only numbers, named inputs, + − · / powers and the mathematical
functions listed here become SymPy nodes. Everything else is an ``InputError``.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable
from functools import cache
from typing import Any

import sympy

from modelling.common.errors import InputError

LONGEST = 10_000
LARGEST_POWER = 100
DEEPEST = 60  # functions and powers within one another: no formula of a measurement has so many


@cache
def functions() -> dict[str, Any]:
    """The functions a formula may call, by name."""
    names = [
        "sin",
        "cos",
        "tan",
        "asin",
        "acos",
        "atan",
        "atan2",
        "sinh",
        "cosh",
        "tanh",
        "asinh",
        "acosh",
        "atanh",
        "exp",
        "log",
        "sqrt",
    ]
    table = {name: getattr(sympy, name) for name in names}
    return table | {"abs": sympy.Abs, "log10": lambda x: sympy.log(x) / sympy.log(10)}


def parse_formula(text: str, names: Iterable[str], where: str) -> Any:
    """The formula as SymPy expression over real symbols of the given names.

    Raises
    ------
    InputError
        No formula, an unknown name, or anything that is not plain mathematics.
    """
    symbols = {name: sympy.Symbol(name, real=True) for name in names}
    if len(text) > LONGEST:
        raise InputError(where, f"the formula has {len(text)} characters", f"at most {LONGEST} are read")
    try:
        tree = ast.parse(text.replace("^", "**").strip(), mode="eval")
        return _Walker(symbols, where).visit(tree.body)
    except (RecursionError, MemoryError) as error:
        wrong = f"'{text[:60]}' has too many operations one after the other, or in one another"
        raise InputError(where, wrong, "write a shorter formula, or several measurands") from error
    except (SyntaxError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(where, f"'{text[:60]}' is no formula", "write it like a*x + sqrt(b)") from error


class _Walker(ast.NodeVisitor):
    """Builds the SymPy expression node by node; a node without a visitor here is refused."""

    def __init__(self, symbols: dict[str, Any], where: str):
        self.symbols, self.where = symbols, where
        self.depth = 0  # of functions and powers around what is visited

    def refuse(
        self, what: str, right: str = "use numbers, inputs, + - * / ** and mathematical functions only"
    ) -> InputError:
        return InputError(self.where, what, right)

    def generic_visit(self, node: Any) -> Any:
        raise self.refuse(f"'{ast.unparse(node)[:60]}' is not mathematics")

    def visit(self, node: Any) -> Any:
        nested = isinstance(node, ast.Call) or (isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow))
        self.depth += nested
        if self.depth > DEEPEST:
            raise self.refuse(f"functions are nested more than {DEEPEST} deep", "write a simpler formula")
        value = super().visit(node)
        self.depth -= nested
        return value

    def visit_Constant(self, node: Any) -> Any:
        if type(node.value) not in (int, float):
            raise self.refuse(f"{node.value!r} is no number")
        if not abs(node.value) < 1e300:
            raise self.refuse("a number is too large", "stay below 1e300")
        exact = isinstance(node.value, int) and abs(node.value) < 10**15
        return sympy.Integer(node.value) if exact else sympy.Float(float(node.value))

    def visit_Name(self, node: Any) -> Any:
        if node.id in self.symbols:
            return self.symbols[node.id]
        if node.id == "pi":
            return sympy.pi
        raise self.refuse(f"'{node.id}' is not among the inputs", f"known are {', '.join(self.symbols)} and pi")

    def visit_UnaryOp(self, node: Any) -> Any:
        value = self.visit(node.operand)
        if isinstance(node.op, ast.USub):
            return -value
        if isinstance(node.op, ast.UAdd):
            return value
        return self.generic_visit(node)

    def visit_BinOp(self, node: Any) -> Any:
        left, right = self.visit(node.left), self.visit(node.right)
        match node.op:
            case ast.Add():
                return left + right
            case ast.Sub():
                return left - right
            case ast.Mult():
                return left * right
            case ast.Div():
                if right.is_zero:
                    raise self.refuse("the formula divides by zero", "correct the formula")
                return left / right
            case ast.Pow():
                return self.power(left, right)
        return self.generic_visit(node)

    def power(self, base: Any, exponent: Any) -> Any:
        # Exact integer towers such as 9**9**9 would run for ever, so the size is looked at first.
        if exponent.is_number and not abs(float(exponent)) <= LARGEST_POWER:
            raise self.refuse("a power is too large", f"exponents reach to {LARGEST_POWER}")
        if base.is_number and base.is_zero and exponent.is_number and float(exponent) <= 0:
            raise self.refuse("the formula divides by zero", "correct the formula")
        result = base**exponent
        if result.is_number and not abs(complex(result)) < 1e300:
            raise self.refuse("a number is too large", "stay below 1e300")
        return result

    def visit_Call(self, node: Any) -> Any:
        name = node.func.id if isinstance(node.func, ast.Name) else None
        if name not in functions():
            called = ast.unparse(node.func)[:40]
            raise self.refuse(f"'{called}' is no function of mathematics", f"known are {', '.join(functions())}")
        wanted = 2 if name == "atan2" else 1
        if node.keywords or len(node.args) != wanted:
            raise self.refuse(
                f"{name} takes {wanted} argument{'s' * (wanted > 1)}", f"write {name}(x{', y' * (wanted > 1)})"
            )
        value = functions()[name](*(self.visit(argument) for argument in node.args))
        if value.has(sympy.zoo, sympy.nan, sympy.oo, sympy.I) or (value.is_number and complex(value).imag != 0):
            raise self.refuse(f"'{ast.unparse(node)[:60]}' has no finite real value", "correct the formula")
        return value
