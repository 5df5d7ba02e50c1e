"""Equations in LaTeX, as notebooks render them."""

from __future__ import annotations

import sympy as sm

from modelling.common import escape
from modelling.equations.lagrange import Equations
from modelling.equations.symbols import ANGLE, Sign, known_zeros, signs
from modelling.model.system import System

_DOTS = (r"\varphi", r"\dot{\varphi}", r"\ddot{\varphi}")


def symbol_names(equations: Equations) -> dict[sm.Symbol, str]:
    """LaTeX of every symbol, see :func:`modelling.equations.symbols.signs`."""
    return {symbol: _written(sign) for symbol, sign in signs(equations).items()}


def latex(equations: Equations, system: System | None = None) -> dict[str, list[str]]:
    """LaTeX of ``T``, ``V``, ``D`` and ``motion``; given a system, its drags and dampings of zero are left out."""
    zeros = known_zeros(equations, system) if system else {}
    names = symbol_names(equations)

    def write(expression: sm.Basic) -> str:
        return sm.latex(expression.xreplace(zeros), symbol_names=names)

    return {
        "T": [write(equations.kinetic_energy)],
        "V": [write(equations.potential_energy)],
        "D": [write(equations.dissipation)],
        "motion": [f"{write(equation.lhs)} = {write(equation.rhs)}" for equation in equations.motion],
    }


def html(equations: Equations, system: System | None = None) -> str:
    """The equations as a block of LaTeX that notebooks render."""
    parts = latex(equations, system)
    rows = [f"{name} &= {parts[name][0]}" for name in ("T", "V", "D")]
    rows += [line.replace(" = ", " &= ", 1) for line in parts["motion"]]
    title = system.title if system else ""
    body = r" \\ ".join(rows)
    return (f"<h4>{escape.html(title)}</h4>" if title else "") + rf"$$\begin{{aligned}}{body}\end{{aligned}}$$"


def _written(sign: Sign) -> str:
    if sign.letter == ANGLE:
        letter = _DOTS[sign.derivatives]
    else:
        letter = sign.letter if len(sign.letter) == 1 else _upright(sign.letter)
    return f"{letter}_{{{_upright(sign.component)}}}" if sign.component else letter


def _upright(name: str) -> str:
    return rf"\mathrm{{{escape.latex(name)}}}"
