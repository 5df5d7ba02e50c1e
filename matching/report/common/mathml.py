"""Equations as MathML, which browsers render without any script."""

from __future__ import annotations

from typing import Any

import sympy as sm
from sympy.printing.mathml import MathMLPresentationPrinter

from modelling.equations.lagrange import Equations, derive
from modelling.model.system import System

_LETTERS = {"J": "J", "drag": "b", "stiffness": "c", "damping": "d", "ratio": "i"}
LEGEND = (
    "J inertia, b drag, c stiffness, d damping, i ratio, φ angle of a shaft, M torque of an input; a dot is a rate."
)


def equations(system: System) -> dict[str, list[str]]:
    """MathML of ``T``, ``V``, ``D`` and ``motion``; drags and dampings of zero are left out."""
    derived = derive(system)
    a = derived.assembly
    zero = {
        a.parameters[name]: sm.Integer(0)
        for name, quantity in system.parameters.items()
        if quantity.value == 0 and not quantity.uncertain and name.rsplit(".", 1)[1] in ("drag", "damping")
    }
    printer = _Printer(_marks(derived))

    def terms(expression: sm.Expr) -> str:
        """Addends one by one, so that a long line may break between them."""
        shown = ""
        for addend in expression.xreplace(zero).as_ordered_terms():
            addend = sm.factor_terms(addend)
            minus = addend.could_extract_minus_sign()
            sign = "−" if minus else "+" if shown else ""
            shown += f" {sign}&nbsp;{_math(printer.doprint(-addend if minus else addend))}"
        return shown or _math("<mn>0</mn>")

    return {
        "T": [f"{_math('<mi>T</mi>')} = {terms(derived.kinetic_energy)}"],
        "V": [f"{_math('<mi>V</mi>')} = {terms(derived.potential_energy)}"],
        "D": [f"{_math('<mi>D</mi>')} = {terms(derived.dissipation)}"],
        "motion": [f"{terms(eq.lhs)} = {terms(eq.rhs)}" for eq in derived.motion],
    }


def _marks(derived: Equations) -> dict[sm.Symbol, tuple[str, str, str]]:
    """(letter, accent, subscript) of every symbol."""
    a = derived.assembly
    marks: dict[sm.Symbol, tuple[str, str, str]] = {}
    for symbols, accent in ((a.q, ""), (a.qd, "\u0307"), (a.qdd, "\u0308")):
        marks |= {symbol: ("φ", accent, _said(name)) for symbol, name in zip(symbols, a.coordinates, strict=True)}
    for name, symbol in a.parameters.items():
        parts = name.split(".")
        place, what = (_said(parts[1]) if len(parts) > 2 else ""), parts[-1]
        plain = len(parts) == 3 and what in _LETTERS
        marks[symbol] = (_LETTERS[what] if plain else _said(what), "", place)
    marks |= {symbol: ("z", "", _said(name)) for name, (symbol, _) in a.states.items()}
    marks |= {sm.Symbol(f"u({name})", real=True): ("M", "", _said(name)) for name in a.inputs}
    return marks


class _Printer(MathMLPresentationPrinter):
    """SymPy's printer with the symbols of a drivetrain."""

    def __init__(self, marks: dict[sm.Symbol, tuple[str, str, str]]):
        super().__init__()
        self._marks = marks

    def doprint(self, expr: Any) -> str:
        """MathML of an expression, without the enclosing element."""
        return self._print(expr).toxml().replace("<mo>-</mo>", "<mo>−</mo>")

    def _print_Symbol(self, sym: sm.Symbol, style: str = "plain") -> Any:
        if sym not in self._marks:
            return super()._print_Symbol(sym, style)
        letter, accent, below = self._marks[sym]
        drawn = self._leaf("mi", letter + accent)
        if accent:  # a letter with a combining mark is drawn upright unless told
            drawn.setAttribute("style", "font-style: italic")
        if not below:
            return drawn
        sub = self.dom.createElement("msub")
        sub.appendChild(drawn)
        sub.appendChild(self._leaf("mtext", below))
        return sub

    def _leaf(self, tag: str, text: str) -> Any:
        leaf = self.dom.createElement(tag)
        leaf.appendChild(self.dom.createTextNode(text))
        return leaf


def _math(content: str) -> str:
    return f'<math displaystyle="true"><mrow>{content}</mrow></math>'


def _said(name: str) -> str:
    return name.replace("_", "\u00a0")
