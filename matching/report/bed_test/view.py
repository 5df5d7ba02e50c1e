"""Views of a bed's verification."""

from __future__ import annotations

from matplotlib.figure import Figure

from matching.bed_test.result import BedVerification
from matching.report.bed_test.figures import responses
from matching.report.bed_test.text import summary
from matching.report.common.environment import environment
from modelling.common import display


@display.plot.register
def _(verification: BedVerification) -> Figure:
    return responses(verification)


@display.text.register
def _(verification: BedVerification) -> str:
    return summary(verification.to_dict())


@display.html.register
def _(verification: BedVerification) -> str:
    lines = summary(verification.to_dict()).splitlines()
    return environment().from_string("{% for line in lines %}<p>{{ line }}</p>{% endfor %}").render(lines=lines)
