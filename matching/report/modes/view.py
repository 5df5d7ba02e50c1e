"""Modes: energy shares as a picture, the mode table."""

from __future__ import annotations

from matplotlib.figure import Figure

from matching.report.common.table import aligned, table
from matching.report.modes.figures import mode_table, shares_figure
from modelling.modal.modes import Modes


def plot(modes: Modes) -> Figure:
    """Energy shares of all modes, %."""
    return shares_figure(modes)


def said(modes: Modes) -> str:
    """The mode table."""
    return aligned(mode_table(modes.to_dict()["modes"]))


def html(modes: Modes) -> str:
    """The mode table for a notebook."""
    return table(mode_table(modes.to_dict()["modes"]))
