"""Ticks of a logarithmic axis: few, and with plain numbers."""

from __future__ import annotations

from typing import Any

from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

LABELLED_RATIO = 200  # high to low end of an axis up to which ticks between decades are labelled


def plain_ticks(axis: Any) -> None:
    """Ticks at 1, 2 and 5 of a decade (more are slow to draw and crowd), all labelled on a short axis.

    Parameters
    ----------
    axis : matplotlib.axis.Axis
        A logarithmic axis whose limits are set.
    """
    low, high = sorted(axis.get_view_interval())
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_locator(LogLocator(subs=(2, 5)))
    axis.set_minor_formatter(StrMethodFormatter("{x:g}") if high < LABELLED_RATIO * low else NullFormatter())
