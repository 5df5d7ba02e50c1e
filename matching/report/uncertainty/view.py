"""A budget: contributions of the first measurand, and the table."""

from __future__ import annotations

from matplotlib.figure import Figure

from matching.report.common.table import lines
from matching.report.uncertainty.figures import contributions
from matching.report.uncertainty.text import summary
from matching.validity.answers import Uncertainty
from modelling.common import display


@display.plot.register
def plot(found: Uncertainty) -> Figure:
    """What contributes how much to the first measurand."""
    return contributions(found.content["measurands"][0])


@display.text.register
def said(found: Uncertainty) -> str:
    """The budget table and what follows from it."""
    return summary(found.content)


@display.html.register
def html(found: Uncertainty) -> str:
    """The same for a notebook."""
    return lines(said(found))
