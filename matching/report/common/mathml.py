"""Equations as MathML, which browsers render without any script."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import sympy as sm
from sympy.printing.mathml import MathMLPresentationPrinter

from modelling.equations.lagrange import derive
from modelling.equations.symbols import Sign, known_zeros, signs
from modelling.model.system import System

DOTS = ("", "\u0307", "\u0308")  # combining marks above a letter, by number of derivatives
TIMES = '<mo lspace="0" rspace="0.17em">&InvisibleTimes;</mo>'  # apart: a subscript ran into the next factor
LEGEND = (
    "J inertia, b drag, c stiffness, d damping, i ratio, φ angle of an inertia, M torque of an input; a dot is a "
    "derivative with respect to time."
)


def equations(system: System) -> dict[str, list[str]]:
    """MathML of ``T``, ``V``, ``D`` and ``motion``; drags and dampings of zero are left out."""
    derived = derive(system)
    zeros = known_zeros(derived, system)
    printer = _Printer(signs(derived))

    def terms(expression: sm.Expr) -> str:
        """Addends one by one, so that a long line may break between them."""
        written = ""
        for addend in expression.xreplace(zeros).as_ordered_terms():
            addend = sm.factor_terms(addend)
            negative = addend.could_extract_minus_sign()
            sign = "−" if negative else "+" if written else ""
            written += f" {sign}&nbsp;{_math(printer.doprint(-addend if negative else addend))}"
        return written

    return {
        "T": [f"{_math('<mi>T</mi>')} = {terms(derived.kinetic_energy)}"],
        "V": [f"{_math('<mi>V</mi>')} = {terms(derived.potential_energy)}"],
        "D": [f"{_math('<mi>D</mi>')} = {terms(derived.dissipation)}"],
        "motion": [f"{terms(equation.lhs)} = {terms(equation.rhs)}" for equation in derived.motion],
    }


class _Printer(MathMLPresentationPrinter):
    """SymPy's printer with the symbols of a drivetrain."""

    def __init__(self, known: Mapping[sm.Symbol, Sign]):
        super().__init__()
        self._signs = known

    def doprint(self, expr: Any) -> str:
        """MathML of an expression, without the enclosing element."""
        written = self._print(expr).toxml().replace("<mo>-</mo>", "<mo>−</mo>")
        return written.replace("<mo>&InvisibleTimes;</mo>", TIMES)

    def _print_Symbol(self, sym: sm.Symbol, style: str = "plain") -> Any:
        if sym not in self._signs:
            return super()._print_Symbol(sym, style)
        sign = self._signs[sym]
        letter = self._leaf("mi", _spaced(sign.letter) + DOTS[sign.derivatives])
        if sign.derivatives:  # browsers set a letter with a combining mark upright by default
            letter.setAttribute("style", "font-style: italic")
        if not sign.component:
            return letter
        subscripted = self.dom.createElement("msub")
        subscripted.appendChild(letter)
        subscripted.appendChild(self._leaf("mtext", _spaced(sign.component)))
        return subscripted

    def _leaf(self, tag: str, text: str) -> Any:
        leaf = self.dom.createElement(tag)
        leaf.appendChild(self.dom.createTextNode(text))
        return leaf


def _math(content: str) -> str:
    return f'<math displaystyle="true"><mrow>{content}</mrow></math>'


def _spaced(name: str) -> str:
    return name.replace("_", "\u00a0")
