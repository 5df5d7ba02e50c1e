"""Views of an XiL fidelity: what is lost and to what, and the table."""

from __future__ import annotations

from matplotlib.figure import Figure

from matching.report.common.table import preformatted
from matching.report.fidelity.figures import attribution_figure, delay_curve
from matching.report.fidelity.text import summary
from matching.validity.fidelity.result import XilFidelity
from modelling.common import display


@display.plot.register
def plot(fidelity: XilFidelity) -> Figure:
    """What is lost to what, ranked; the delay curve where the case names values instead of signals."""
    return delay_curve(fidelity) if fidelity.attribution is None else attribution_figure(fidelity)


@display.text.register
def as_text(fidelity: XilFidelity) -> str:
    """Total and partial fidelities with their uncertainty."""
    return summary(fidelity.to_dict())


@display.html.register
def as_html(fidelity: XilFidelity) -> str:
    """The text of the result as HTML for a notebook."""
    return preformatted(as_text(fidelity))
