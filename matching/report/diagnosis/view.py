"""A diagnosis: measured and simulated on unseen data, and the answer in words."""

from __future__ import annotations

from matplotlib.figure import Figure

from matching.diagnosis.verdict.result import Diagnosis
from matching.report.common.style import styled
from matching.report.common.table import lines
from matching.report.diagnosis.axes import views
from matching.report.diagnosis.holdout_figure import unseen_figure
from matching.report.diagnosis.page import content
from matching.report.diagnosis.sentences import summary
from modelling.common import display


@display.plot.register
def plot(found: Diagnosis) -> Figure:
    """What was measured and what the model answers before and after, on data the fit never saw."""
    with styled():
        return unseen_figure(found, views(found.extended, found.plot_data))


@display.text.register
def said(found: Diagnosis) -> str:
    """The answer in a sentence, then errors and causes."""
    return summary(content(found))


@display.html.register
def html(found: Diagnosis) -> str:
    """The same for a notebook."""
    return lines(said(found))
