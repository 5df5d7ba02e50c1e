"""Models and cases in a notebook: their drawing; of a model its equations below."""

from __future__ import annotations

from matplotlib.figure import Figure

from matching.frequency.case.case import Case
from matching.report.common.environment import embedded, environment
from matching.report.common.style import image
from matching.report.drawing.figures import case_figure, model_figure
from matching.report.drawing.layout import MOST_INERTIAS
from modelling.common import display
from modelling.equations import latex
from modelling.equations.lagrange import derive
from modelling.model.system import System

_DRAWING = "<p><img alt='{{ title }}' src='{{ picture }}' style='max-width:100%'></p>"


@display.plot.register
def plot_system(system: System) -> Figure:
    """The drivetrain."""
    return model_figure(system)


@display.plot.register
def plot_case(case: Case) -> Figure:
    """Vehicle above rig with the cut."""
    return case_figure(case)


@display.html.register
def system_html(system: System) -> str:
    """Title, drivetrain and equations; without the drawing where there are too many inertias."""
    equations = latex.html(derive(system), system)
    if len(system.inertias) > MOST_INERTIAS:
        return equations
    heading, end, rest = equations.rpartition("</h4>")
    return heading + end + _drawn(model_figure(system), system.title or "drivetrain") + rest


@display.html.register
def case_html(case: Case) -> str:
    """Vehicle above rig; the title where one of them is too long to be drawn."""
    title = case.title or "case"
    if max(len(system.inertias) for system in (case.vehicle, case.rig)) > MOST_INERTIAS:
        return environment().from_string("<p>{{ title }}</p>").render(title=title)
    return _drawn(case_figure(case), title)


def _drawn(figure: Figure, title: str) -> str:
    """Everything of the user's stands in a picture or is escaped."""
    return environment().from_string(_DRAWING).render(title=title, picture=embedded(image(figure)))
