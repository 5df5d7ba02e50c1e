"""Views of modes: energy shares as a figure, the mode table."""

from __future__ import annotations

from matplotlib.figure import Figure

from matching.report.common.table import aligned, table
from matching.report.modes.figures import shares_figure
from matching.report.modes.mode_table import mode_table
from modelling.common import display
from modelling.modal.result import Modes


@display.plot.register
def plot(modes: Modes) -> Figure:
    """Energy shares of all modes, %."""
    return shares_figure(modes)


@display.text.register
def as_text(modes: Modes) -> str:
    """The mode table."""
    return aligned(mode_table(modes.to_dict()["modes"]))


@display.html.register
def as_html(modes: Modes) -> str:
    """The mode table for a notebook."""
    return table(mode_table(modes.to_dict()["modes"]))
