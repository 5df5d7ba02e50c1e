"""Views of an uncertainty budget: contributions of the first measurand, and the table."""

from __future__ import annotations

from matplotlib.figure import Figure

from matching.report.common.table import preformatted
from matching.report.uncertainty.figures import contributions
from matching.report.uncertainty.text import summary
from matching.validity.uncertainty.result import Uncertainty
from modelling.common import display


@display.plot.register
def plot(uncertainty: Uncertainty) -> Figure:
    """Contributions of the inputs to the first measurand."""
    return contributions(uncertainty.measurands[0])


@display.text.register
def as_text(uncertainty: Uncertainty) -> str:
    """Statement, budget table and checks."""
    return summary(uncertainty.to_dict())


@display.html.register
def as_html(uncertainty: Uncertainty) -> str:
    """The text of the result as HTML for a notebook."""
    return preformatted(as_text(uncertainty))
