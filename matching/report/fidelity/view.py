"""A fidelity: what is lost where, and the table."""

from __future__ import annotations

from matplotlib.figure import Figure

from matching.report.common.table import lines
from matching.report.fidelity.figures import attribution, delay_curve
from matching.report.fidelity.text import summary
from matching.validity.answers import XilFidelity
from modelling.common import display


@display.plot.register
def plot(found: XilFidelity) -> Figure:
    """What is lost to what, ranked; the delay curve where nothing can be attributed."""
    return attribution(found.content) if "attribution" in found.content else delay_curve(found.content)


@display.text.register
def said(found: XilFidelity) -> str:
    """The partial fidelities and what follows from them."""
    return summary(found.content)


@display.html.register
def html(found: XilFidelity) -> str:
    """The same for a notebook."""
    return lines(said(found))
