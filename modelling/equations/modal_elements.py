"""Masses and springs of small oscillations as a CasADi function: each element a coefficient and a row."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import casadi as ca

from modelling.equations.lagrange import Equations
from modelling.equations.sparse import abbreviations, sparse
from modelling.equations.sympy_to_casadi import to_casadi


def modal_elements(equations: Equations) -> ca.Function:
    """(x, p) → J (k,), turns (k, n), stiffness (s,), twists (s, n), deflections (s, x), whether each p is in a row."""
    a = equations.assembly
    n = len(a.q)
    x, p = ca.SX.sym("x", 2 * n + len(a.states)), ca.SX.sym("p", len(a.parameters))
    known = {symbol: x[i] for i, symbol in enumerate([*a.q, *a.qd, *(z for z, _ in a.states.values())])}
    known |= {symbol: p[i] for i, symbol in enumerate(a.parameters.values())}
    known |= abbreviations(equations, known)
    turns = _rows([_free(motion.coefficients, a.imposed) for _, motion in a.masses.values()], n, known)
    twists = _rows([_held(spring.twist.coefficients, a.imposed) for spring in a.springs.values()], n, known)
    masses = ca.vertcat(*to_casadi([J for J, _ in a.masses.values()], known))
    springs = list(a.springs.values())
    stiffness = ca.vertcat(*to_casadi([spring.stiffness for spring in springs], known)) if springs else ca.SX(0, 1)
    deflection = ca.vertcat(*to_casadi([spring.deflection for spring in springs], known)) if springs else ca.SX(0, 1)
    nonzeros: list[Any] = [*turns.nonzeros(), *twists.nonzeros()]
    coefficients = ca.vertcat(*nonzeros)
    in_rows = ca.DM(ca.which_depends(coefficients, p, 1, False)) if p.numel() else ca.DM()
    outputs: list[Any] = [masses, turns, stiffness, twists, ca.jacobian(deflection, x), in_rows]
    return ca.Function("elements", [x, p], outputs)


def _held(coefficients: dict[int, Any], imposed: Collection[int]) -> dict[int, Any]:
    """A motion while imposed ones stand still."""
    return {i: coefficient for i, coefficient in coefficients.items() if i not in imposed}


def _free(coefficients: dict[int, Any], imposed: Collection[int]) -> dict[int, Any]:
    """The same; what only an imposed motion moves is a mode of its own, at 0 Hz."""
    return _held(coefficients, imposed) or coefficients


def _rows(motions: list[dict[int, Any]], n: int, known: dict) -> ca.SX:
    """Coefficients of motions as a sparse matrix (r, n)."""
    places = [(i, j) for i, motion in enumerate(motions) for j in motion]
    entries = to_casadi([entry for motion in motions for entry in motion.values()], known)
    return sparse(places, entries, len(motions), n)
