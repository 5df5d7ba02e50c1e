"""Views of a planned excitation."""

from __future__ import annotations

from matplotlib.figure import Figure

from matching.excitation.result import ExcitationPlan
from matching.report.common.environment import environment
from matching.report.excitation.figures import excitation
from matching.report.excitation.text import summary
from modelling.common import display


@display.plot.register
def _(plan: ExcitationPlan) -> Figure:
    return excitation(plan)


@display.text.register
def _(plan: ExcitationPlan) -> str:
    return summary(plan.to_dict())


@display.html.register
def _(plan: ExcitationPlan) -> str:
    lines = summary(plan.to_dict()).splitlines()
    return environment().from_string("{% for line in lines %}<p>{{ line }}</p>{% endfor %}").render(lines=lines)
