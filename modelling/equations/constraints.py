"""Rigid gears and differentials, eliminated: every inertia's angle in terms of independent coordinates."""

from __future__ import annotations

import sympy as sm

from modelling.common.errors import InputError
from modelling.effects.interface import EquationBuilder, Motion
from modelling.model.system import System


def eliminate(system: System, assembly: EquationBuilder) -> dict[str, Motion]:
    """A motion for every inertia by name; creates the independent coordinates in ``assembly``.

    Raises
    ------
    InputError
        If gears and differentials lock the system or say the same thing twice.
    """
    rows: list[tuple[str, dict[str, sm.Expr]]] = []
    for gear in system.gears:
        first, second = gear.between
        rows.append(
            (f"gears.{gear.name}", {first: sm.Integer(1), second: -assembly.symbol(f"gears.{gear.name}.ratio")})
        )
    for part in system.differentials:
        half = -sm.Rational(1, 2)
        rows.append((f"differentials.{part.name}", {part.cage: sm.Integer(1), part.left: half, part.right: half}))
    values = {
        symbol: system.parameters[name].value
        for name, symbol in assembly.parameters.items()
        if name in system.parameters
    }
    solved: dict[str, dict[str, sm.Expr]] = {}
    for place, row in rows:
        row = _combined(row, solved)
        pivot = next((name for name, c in row.items() if abs(float(c.subs(values))) > 1e-9), None)
        if pivot is None:
            raise InputError(
                place, "says again what other gears and differentials already say, or locks them", "remove it"
            )
        rest = {name: sm.cancel(-c / row[pivot]) for name, c in row.items() if name != pivot}
        if not rest:
            raise InputError(place, "locks the drivetrain: nothing can turn", "check the ratios round the loop")
        solved = {name: _combined(own, {pivot: rest}) for name, own in solved.items()}
        solved[pivot] = rest
    free = {part.name: assembly.add_coordinate(part.name) for part in system.inertias if part.name not in solved}
    motions: dict[str, Motion] = {}
    for inertia in system.inertias:
        share: dict[int, sm.Expr] = {}
        for name, c in solved.get(inertia.name, {inertia.name: sm.Integer(1)}).items():
            share[next(iter(free[name].coefficients))] = c
        motions[inertia.name] = Motion(share, assembly)
    return motions


def _combined(row: dict[str, sm.Expr], solved: dict[str, dict[str, sm.Expr]]) -> dict[str, sm.Expr]:
    """A row with the solved inertias replaced; terms that cancel are dropped."""
    out: dict[str, sm.Expr] = {}
    for name, c in row.items():
        for inner, factor in solved.get(name, {name: sm.Integer(1)}).items():
            out[inner] = out.get(inner, sm.Integer(0)) + c * factor
    return {name: c for name, c in out.items() if sm.cancel(c) != 0}
