"""SymPy → CasADi: an iterative, memoised translation that raises on functions it does not know."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca
import sympy as sm

_UNARY = {
    sm.sin: ca.sin, sm.cos: ca.cos, sm.tan: ca.tan, sm.asin: ca.asin, sm.acos: ca.acos, sm.atan: ca.atan,
    sm.sinh: ca.sinh, sm.cosh: ca.cosh, sm.tanh: ca.tanh, sm.asinh: ca.asinh, sm.acosh: ca.acosh, sm.atanh: ca.atanh,
    sm.exp: ca.exp, sm.log: ca.log, sm.Abs: ca.fabs,
    sm.sign: ca.sign, sm.floor: ca.floor, sm.ceiling: ca.ceil,
}  # fmt: skip
_PAIRWISE = {sm.Max: ca.fmax, sm.Min: ca.fmin, sm.And: ca.logic_and, sm.Or: ca.logic_or}
_RELATION = {sm.StrictGreaterThan: ca.gt, sm.GreaterThan: ca.ge, sm.StrictLessThan: ca.lt, sm.LessThan: ca.le}


def to_casadi(expressions: Sequence[sm.Expr], known: Mapping[sm.Symbol, ca.SX]) -> list[ca.SX]:
    """Translate SymPy expressions, shared parts once.

    Parameters
    ----------
    expressions : sequence of Expr
    known : mapping
        The CasADi scalar of every symbol.

    Raises
    ------
    NotImplementedError
        If a function, relation or symbol is not known.
    """
    done: dict[sm.Basic, ca.SX] = dict(known)
    for expression in expressions:
        stack = [sm.sympify(expression)]
        while stack:
            node = stack[-1]
            if node in done:
                stack.pop()
                continue
            todo = [part for part in _parts(node) if part not in done]
            if todo:
                stack.extend(todo)
            else:
                done[stack.pop()] = _translated(node, done)
    return [done[sm.sympify(expression)] for expression in expressions]


def _parts(node: sm.Basic) -> Sequence[sm.Basic]:
    if isinstance(node, sm.Piecewise):
        return [part for value, condition in node.args for part in (value, condition)]
    return node.args


def _translated(node: sm.Basic, done: Mapping[sm.Basic, ca.SX]) -> ca.SX:
    if (node.is_Number and node.is_finite) or isinstance(node, sm.NumberSymbol):
        return ca.SX(float(node))
    if node is sm.true or node is sm.false:
        return ca.SX(float(node is sm.true))
    parts = [done[part] for part in _parts(node)]
    if node.is_Add:
        return sum(parts[1:], parts[0])
    if node.is_Mul:
        product = parts[0]
        for part in parts[1:]:
            product = product * part
        return product
    if node.is_Pow:
        return _power(node, parts)
    if isinstance(node, sm.Piecewise):
        return _piecewise(parts)
    if node.func in _PAIRWISE:
        pick = _PAIRWISE[node.func]
        out = parts[0]
        for part in parts[1:]:
            out = pick(out, part)
        return out
    if node.func in _UNARY:
        return _UNARY[node.func](*parts)
    if node.func in _RELATION:
        return _RELATION[node.func](*parts)
    if node.func is sm.Not:
        return ca.logic_not(*parts)
    if node.func is sm.atan2:
        return ca.atan2(*parts)
    raise NotImplementedError(f"no translation to CasADi for {node.func.__name__}: {node}")


def _power(node: sm.Pow, parts: list[ca.SX]) -> ca.SX:
    return 1 / parts[0] if node.exp == -1 else parts[0] ** parts[1]


def _piecewise(parts: list[ca.SX]) -> ca.SX:
    """Nested choices from the last piece inwards; without a piece that always holds it is NaN there, as in SymPy."""
    out = ca.SX(float("nan"))
    for value, condition in reversed(list(zip(parts[::2], parts[1::2], strict=True))):
        out = value if condition.is_constant() and float(condition) == 1 else ca.if_else(condition, value, out)
    return out
