"""Views of a commissioning."""

from __future__ import annotations

from matching.commissioning.rounds import Commissioning
from matching.report.commissioning.text import summary
from matching.report.common.environment import environment
from modelling.common import display


@display.text.register
def _(result: Commissioning) -> str:
    return summary(result.to_dict())


@display.html.register
def _(result: Commissioning) -> str:
    lines = summary(result.to_dict()).splitlines()
    return environment().from_string("{% for line in lines %}<p>{{ line }}</p>{% endfor %}").render(lines=lines)
