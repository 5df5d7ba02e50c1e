"""A match: the overview figure, the answer in words, the summary for a notebook."""

from __future__ import annotations

from matplotlib.figure import Figure

from matching.frequency.search.result import MatchResult
from matching.report.match.figures import overview
from matching.report.match.page import summary_html
from matching.report.match.text import content, summary
from modelling.common import display


@display.plot.register
def plot(result: MatchResult) -> Figure:
    """The overview figure of the report."""
    return overview(result)


@display.text.register
def said(result: MatchResult) -> str:
    """One sentence, then the most important figures."""
    return summary(content(result))


@display.html.register
def html(result: MatchResult) -> str:
    """The result as HTML for a notebook."""
    return summary_html(result)
