"""Views of a model and of its equations in a notebook: energies and equations of motion."""

from __future__ import annotations

from modelling.common import display
from modelling.equations import latex
from modelling.equations.lagrange import Equations


@display.html.register
def equations_html(equations: Equations) -> str:
    """Energies and equations of motion."""
    return latex.html(equations)
