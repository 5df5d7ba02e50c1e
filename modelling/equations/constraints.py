"""Rigid gears and differentials, eliminated: every inertia's angle in terms of independent coordinates.

Every inertia that a constraint eliminates points at those it is expressed in; paths are shortened as they are followed,
and a long product of ratios gets a symbol of its own. So the work grows with the number of constraints, not its square.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import sympy as sm

from modelling.common.errors import InputError
from modelling.effects.interface import EquationBuilder, Motion
from modelling.model.system import System

LONGEST_COEFFICIENT = 24  # factors or operations; a longer one gets a symbol of its own
MOST_SHARES = 20_000  # of all inertias together: differentials in a row couple every inertia with every other
VANISHES = 1e-9  # a smaller coefficient is no pivot
CANCELS = 1e-12  # of the summands: what remains of a sum that may be zero

Row = dict[str, "_Coefficient"]


@dataclass(frozen=True)
class _Coefficient:
    """A coefficient of a constraint: its expression, value, and number of factors or operations."""

    expression: sm.Expr
    value: float
    length: int = 1

    def __mul__(self, other: _Coefficient) -> _Coefficient:
        product = self.expression * other.expression
        length = self.length + other.length
        if product.has(sm.Add):
            product = sm.cancel(product)
            length = 1 + int(product.count_ops())
        return _Coefficient(product, self.value * other.value, length)

    def inverse(self) -> _Coefficient:
        return _Coefficient(1 / self.expression, 1 / self.value, self.length)


_ONE, _MINUS = _Coefficient(sm.Integer(1), 1.0, 0), _Coefficient(sm.Integer(-1), -1.0, 0)


def eliminate(system: System, assembly: EquationBuilder) -> dict[str, Motion]:
    """A motion for every inertia by name; creates the independent coordinates in ``assembly``.

    Raises
    ------
    InputError
        If gears and differentials lock the system or say the same thing twice, or couple too many inertias.
    """
    elimination = _Elimination(assembly.abbreviate)
    for place, row in _constraints(system, assembly):
        elimination.add(place, row)
    eliminated = elimination.by_inertia
    free = {part.name: assembly.add_coordinate(part.name) for part in system.inertias if part.name not in eliminated}
    motions: dict[str, Motion] = {}
    shares = 0
    for inertia in system.inertias:
        row = elimination.resolved(inertia.name)
        shares += len(row) if len(row) > 1 else 0
        if shares > MOST_SHARES:
            raise InputError("differentials", f"couple more than {MOST_SHARES} pairs of inertias", "use fewer in a row")
        motions[inertia.name] = Motion(
            {next(iter(free[name].coefficients)): c.expression for name, c in row.items()}, assembly
        )
    return motions


def _constraints(system: System, assembly: EquationBuilder) -> list[tuple[str, Row]]:
    """Σ coefficient·angle = 0 of every gear and differential, with its place in the file."""
    rows: list[tuple[str, Row]] = []
    values = {
        symbol: system.parameters[name].value
        for name, symbol in assembly.parameters.items()
        if name in system.parameters
    }
    for gear in system.gears:
        first, second = gear.between
        ratio = assembly.symbol(f"gears.{gear.name}.ratio")
        rows.append((f"gears.{gear.name}", {first: _ONE, second: _Coefficient(-ratio, -values[ratio])}))
    for part in system.differentials:
        half = _Coefficient(-sm.Rational(1, 2), -0.5, 0)
        rows.append((f"differentials.{part.name}", {part.cage: _ONE, part.left: half, part.right: half}))
    return rows


class _Elimination:
    """Inertias eliminated so far, each by the row of those that it is expressed in."""

    def __init__(self, abbreviate: Callable[[sm.Expr], sm.Expr]):
        self.by_inertia: dict[str, Row] = {}
        self._abbreviate = abbreviate
        self._meaning: dict[sm.Expr, sm.Expr] = {}

    def add(self, place: str, row: Row) -> None:
        """Eliminate one inertia by a constraint."""
        row = self._combined(row)
        pivot = next((name for name, c in row.items() if abs(c.value) > VANISHES), None)
        if pivot is None:
            raise InputError(
                place, "says again what other gears and differentials already say, or locks them", "remove it"
            )
        factor = _MINUS * row[pivot].inverse()
        rest = {name: self._short(c * factor) for name, c in row.items() if name != pivot}
        if not rest:
            raise InputError(place, "locks the drivetrain: nothing can turn", "check the ratios round the loop")
        self.by_inertia[pivot] = rest

    def resolved(self, name: str) -> Row:
        """An inertia in terms of those not eliminated; shortens the path to them."""
        waiting = [name]
        while waiting:
            row = self.by_inertia.get(waiting[-1])
            todo = [] if row is None else [other for other in row if self._is_eliminated(other)]
            if todo:
                waiting.extend(todo)
                continue
            done = waiting.pop()
            if row is not None and any(other in self.by_inertia for other in row):
                self.by_inertia[done] = self._replaced(row)
        return self.by_inertia.get(name, {name: _ONE})

    def _is_eliminated(self, name: str) -> bool:
        """Whether an inertia is eliminated by others that are eliminated in turn."""
        return name in self.by_inertia and any(other in self.by_inertia for other in self.by_inertia[name])

    def _combined(self, row: Row) -> Row:
        for name in row:
            self.resolved(name)
        return self._replaced(row)

    def _replaced(self, row: Mapping[str, _Coefficient]) -> Row:
        """A row with the eliminated inertias replaced; terms that cancel are dropped."""
        out: Row = {}
        for name, c in row.items():
            for inner, factor in self.by_inertia.get(name, {name: _ONE}).items():
                product = c * factor
                out[inner] = self._sum(out[inner], product) if inner in out else product
        return {name: self._short(c) for name, c in out.items() if c.expression != 0}

    def _sum(self, a: _Coefficient, b: _Coefficient) -> _Coefficient:
        value = a.value + b.value
        if abs(value) <= CANCELS * abs(a.value) and self._opposite(a.expression, b.expression):
            return _Coefficient(sm.Integer(0), 0.0, 0)
        total = sm.cancel(a.expression + b.expression)
        return _Coefficient(total, value, 1 + int(total.count_ops()))

    def _opposite(self, a: sm.Expr, b: sm.Expr) -> bool:
        """Whether two products are each other's negative, abbreviations written out."""
        ratio = a / b
        while ratio != -1 and (known := ratio.free_symbols & self._meaning.keys()):
            ratio = ratio.xreplace({symbol: self._meaning[symbol] for symbol in known})
        return ratio == -1

    def _short(self, c: _Coefficient) -> _Coefficient:
        if c.length <= LONGEST_COEFFICIENT:
            return c
        symbol = self._abbreviate(c.expression)
        self._meaning[symbol] = c.expression
        return _Coefficient(symbol, c.value)
