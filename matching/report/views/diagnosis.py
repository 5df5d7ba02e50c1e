"""A diagnosis: measured and simulated on unseen data, and the answer in words."""

from __future__ import annotations

from matplotlib.figure import Figure

from matching.diagnosis.result import Diagnosis
from matching.report.diagnosis_axes import views
from matching.report.diagnosis_page import content
from matching.report.diagnosis_unseen_figure import unseen_figure
from matching.report.diagnosis_words import summary
from matching.report.style import styled
from matching.report.views.table import lines


def plot(found: Diagnosis) -> Figure:
    """What was measured and what the model answers before and after, on data the fit never saw."""
    with styled():
        return unseen_figure(found, views(found.extended, found.pictures))


def said(found: Diagnosis) -> str:
    """The answer in a sentence, then errors and causes."""
    return summary(content(found))


def html(found: Diagnosis) -> str:
    """The same for a notebook."""
    return lines(said(found))
