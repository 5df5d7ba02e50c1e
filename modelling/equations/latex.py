"""How the equations are written: symbols in LaTeX, zeros left out."""

from __future__ import annotations

import sympy as sm

from modelling.equations.lagrange import Equations
from modelling.model.system import System

_LETTERS = {"J": "J", "drag": "b", "stiffness": "c", "damping": "d", "ratio": "i"}


def symbol_names(equations: Equations) -> dict[sm.Symbol, str]:
    """LaTeX of every symbol: J and b of inertias, c and d of shafts, i of ratios, φ of coordinates."""
    a = equations.assembly
    names: dict[sm.Symbol, str] = {}
    for symbols, mark in ((a.q, r"\varphi"), (a.qd, r"\dot{\varphi}"), (a.qdd, r"\ddot{\varphi}")):
        names |= {symbol: f"{mark}_{{{_text(name)}}}" for symbol, name in zip(symbols, a.coordinates, strict=True)}
    for name, symbol in a.parameters.items():
        parts = name.split(".")
        letter = (
            _LETTERS.get(parts[-1], rf"\mathrm{{{_plain(parts[-1])}}}")
            if len(parts) == 3
            else rf"\mathrm{{{_plain(parts[-1])}}}"
        )
        names[symbol] = f"{letter}_{{{_text(parts[1] if len(parts) > 2 else parts[-1])}}}"
    for name, (symbol, _) in a.states.items():
        names[symbol] = f"z_{{{_text(name)}}}"
    for name in a.inputs:
        names[sm.Symbol(f"u({name})", real=True)] = f"M_{{{_text(name)}}}"
    return names


def latex(equations: Equations, system: System | None = None) -> dict[str, list[str]]:
    """LaTeX of ``T``, ``V``, ``D`` and ``motion``; given a system, its drags and dampings of zero are left out."""
    a = equations.assembly
    zero = {
        a.parameters[name]: sm.Integer(0)
        for name, quantity in (system.parameters.items() if system else ())
        if quantity.value == 0 and not quantity.uncertain and name.rsplit(".", 1)[1] in ("drag", "damping")
    }
    names = symbol_names(equations)

    def write(expression: sm.Basic) -> str:
        return sm.latex(expression.xreplace(zero), symbol_names=names)

    return {
        "T": [write(equations.kinetic_energy)],
        "V": [write(equations.potential_energy)],
        "D": [write(equations.dissipation)],
        "motion": [f"{write(eq.lhs)} = {write(eq.rhs)}" for eq in equations.motion],
    }


def html(equations: Equations, system: System | None = None) -> str:
    """The equations as a block of LaTeX that notebooks render."""
    parts = latex(equations, system)
    rows = [f"{name} &= {parts[name][0]}" for name in ("T", "V", "D")]
    rows += [line.replace(" = ", " &= ", 1) for line in parts["motion"]]
    title = system.title if system else ""
    body = r" \\ ".join(rows)
    return (f"<h4>{title}</h4>" if title else "") + rf"$$\begin{{aligned}}{body}\end{{aligned}}$$"


def _plain(name: str) -> str:
    return name.replace("_", r"\_")


def _text(name: str) -> str:
    return rf"\mathrm{{{_plain(name)}}}"
