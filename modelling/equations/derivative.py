"""Derivatives of many alike expressions, each shape differentiated once."""

from __future__ import annotations

import functools

import sympy as sm


def differentiate(expression: sm.Expr, symbol: sm.Symbol) -> sm.Expr:
    """∂expression/∂symbol, found once for all expressions that differ in their symbols' names only."""
    if symbol not in expression.free_symbols:
        return sm.Integer(0)
    names = sorted(expression.free_symbols, key=str)
    plain = {name: _placeholder(i) for i, name in enumerate(names)}
    back = {stand_in: name for name, stand_in in plain.items()}
    return _plain_diff(expression.xreplace(plain), plain[symbol]).xreplace(back)


@functools.cache
def _placeholder(number: int) -> sm.Symbol:
    return sm.Symbol(f"_{number:04d}", real=True)


@functools.lru_cache(maxsize=4096)
def _plain_diff(expression: sm.Expr, symbol: sm.Symbol) -> sm.Expr:
    return sm.diff(expression, symbol)
