"""Sparse symbolic matrices, and long products of ratios translated once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca
import sympy as sm

from modelling.equations.lagrange import Equations
from modelling.equations.sympy_to_casadi import to_casadi


def sparse(places: Sequence[tuple[int, int]], entries: Sequence[ca.SX], rows: int, columns: int) -> ca.SX:
    """A matrix (rows, columns) of its entries that are not zero."""
    if not entries:
        return ca.SX(rows, columns)
    i, j = zip(*places, strict=True)
    pattern = ca.Sparsity.triplet(rows, columns, i, j)
    order = {place: number for number, place in enumerate(zip(pattern.row(), pattern.get_col(), strict=True))}
    by_column: list[ca.SX] = [ca.SX(0)] * len(entries)
    for place, entry in zip(places, entries, strict=True):
        by_column[order[place]] = entry
    return ca.SX(pattern, ca.vertcat(*by_column))


def abbreviations(equations: Equations, known: Mapping[sm.Symbol, ca.SX]) -> dict[sm.Symbol, ca.SX]:
    """The CasADi scalar of every abbreviation; ``known`` has those of the parameters."""
    translated: dict[sm.Symbol, ca.SX] = {}
    for symbol, expression in equations.assembly.abbreviations.items():
        within = {part: translated[part] if part in translated else known[part] for part in expression.free_symbols}
        (translated[symbol],) = to_casadi([expression], within)
    return translated
