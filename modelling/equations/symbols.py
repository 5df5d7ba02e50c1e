"""The symbols of an equation as a reader knows them: letter, number of time derivatives, and what it belongs to."""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sm

from modelling.equations.lagrange import Equations
from modelling.model.system import System

LETTERS = {"J": "J", "drag": "b", "stiffness": "c", "damping": "d", "ratio": "i"}
ANGLE, TORQUE, STATE = "φ", "M", "z"


@dataclass(frozen=True)
class Sign:
    """How a symbol is written.

    Attributes
    ----------
    letter : str
        One letter, or the name of a quantity that has none.
    component : str
        Name in the model file of what it belongs to, written as subscript; may be empty.
    derivatives : int
        Dots above the letter.
    """

    letter: str
    component: str
    derivatives: int = 0


def signs(equations: Equations) -> dict[sm.Symbol, Sign]:
    """The sign of every symbol: J and b of inertias, c and d of shafts, i of ratios, φ of coordinates, M of inputs."""
    assembly = equations.assembly
    signs_by_symbol: dict[sm.Symbol, Sign] = {}
    for derivatives, symbols in enumerate((assembly.q, assembly.qd, assembly.qdd)):
        named = zip(symbols, assembly.coordinates, strict=True)
        signs_by_symbol |= {symbol: Sign(ANGLE, name, derivatives) for symbol, name in named}
    for name, symbol in assembly.parameters.items():
        parts = name.split(".")
        quantity, component = parts[-1], parts[1] if len(parts) > 2 else ""
        signs_by_symbol[symbol] = Sign(LETTERS.get(quantity, quantity) if len(parts) == 3 else quantity, component)
    signs_by_symbol |= {symbol: Sign("k", str(number)) for number, symbol in enumerate(assembly.abbreviations, 1)}
    signs_by_symbol |= {symbol: Sign(STATE, _state_of(name)) for name, (symbol, _) in assembly.states.items()}
    signs_by_symbol |= {sm.Symbol(f"u({name})", real=True): Sign(TORQUE, name) for name in assembly.inputs}
    return signs_by_symbol


def _state_of(name: str) -> str:
    """``shafts.tyre.slip`` as a reader reads it: the component, then the effect whose state it is."""
    parts = name.split(".")
    return ", ".join(parts[1:]) if len(parts) > 1 else name


def known_zeros(equations: Equations, system: System) -> dict[sm.Symbol, sm.Expr]:
    """Drags and dampings that are exactly zero in the model, as a substitution that leaves them out."""
    return {
        equations.assembly.parameters[name]: sm.Integer(0)
        for name, quantity in system.parameters.items()
        if quantity.value == 0 and not quantity.uncertain and name.rsplit(".", 1)[1] in ("drag", "damping")
    }
