"""Views of a diagnosis: measured and simulated on held-out data, and the answer in words."""

from __future__ import annotations

from matplotlib.figure import Figure

from matching.diagnosis.verdict.result import Diagnosis
from matching.report.common.style import styled
from matching.report.common.table import preformatted
from matching.report.diagnosis.axes import views
from matching.report.diagnosis.holdout_figure import holdout_figure
from matching.report.diagnosis.page import content
from matching.report.diagnosis.sentences import summary
from modelling.common import display


@display.plot.register
def plot(diagnosis: Diagnosis) -> Figure:
    """Measurement, base model and extended model on data that no fit used."""
    with styled():
        return holdout_figure(diagnosis.plot_data.holdout, views(diagnosis.extended, diagnosis.plot_data))


@display.text.register
def as_text(diagnosis: Diagnosis) -> str:
    """The answer in a sentence, what to do, causes and errors."""
    return summary(content(diagnosis))


@display.html.register
def as_html(diagnosis: Diagnosis) -> str:
    """The text of the result as HTML for a notebook."""
    return preformatted(as_text(diagnosis))
