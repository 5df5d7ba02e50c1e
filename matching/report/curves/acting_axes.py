"""A Matplotlib figure's curves as figures that act in the browser: what a report shows on paper, to look into."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec
from typing import Any

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from matching.report.common.decimation import MOST_POINTS, decimated
from matching.report.curves.acting_bars import draw_bars, has_bars
from matching.report.curves.embedding import acting_figure, embedded_figures, place_legend

DASHES = {"-": "solid", "--": "dashed", "-.": "dashdot", ":": "dotted"}
MARKERS = {"o": "circle", "s": "square", "D": "diamond", "^": "triangle", "v": "inverted_triangle", "x": "x"}
SCALES = {"linear": "linear", "log": "log"}  # others have no counterpart: such axes stay pictures


def acting(figures: Mapping[str, Figure]) -> dict[str, str]:
    """Scripts and elements by the figures' names (:func:`matching.report.curves.embedding.embedded_figures`).

    Axes without curves or bars, or with scales that the browser's library does not have, are left out; so is
    everything where that library is not installed.
    """
    if find_spec("bokeh") is None:
        return {}
    panels = {name: [_panel(axes) for axes in fig.axes if _is_drawable(axes)] for name, fig in figures.items()}
    return embedded_figures({name: shown for name, shown in panels.items() if shown}, side_by_side=True)


def _is_drawable(axes: Any) -> bool:
    drawable = any(map(_is_curve, axes.lines)) or has_bars(axes)
    return bool(
        axes.get_visible() and axes.axison and drawable and {axes.get_xscale(), axes.get_yscale()} <= set(SCALES)
    )


def _is_curve(line: Any) -> bool:
    """Not a point, nor a line across the axes, such as a mark."""
    return len(line.get_xdata()) > 1 and line.get_transform() == line.axes.transData


def _panel(axes: Any) -> Any:
    options: dict[str, Any] = {
        "x_axis_type": SCALES[axes.get_xscale()], "y_axis_type": SCALES[axes.get_yscale()],
        "x_range": tuple(map(float, axes.get_xlim())), "y_range": tuple(map(float, axes.get_ylim())),
    }  # fmt: skip
    title = axes.get_title() or axes.get_title("left")
    fig = acting_figure(title, axes.get_xlabel(), axes.get_ylabel().replace("\n", ", "), **options)
    for area in axes.collections:
        if isinstance(area, PolyCollection):
            _area(fig, area)
    for line in axes.lines:
        _curve(fig, line)
    if has_bars(axes):
        draw_bars(fig, axes)
    place_legend(fig)
    return fig


def _curve(fig: Any, line: Any) -> None:
    if not _is_curve(line):
        return
    x, y = (np.asarray(values, float) for values in line.get_data())
    label = str(line.get_label())
    named = {} if label.startswith("_") else {"legend_label": label}
    x, y = (values.astype(np.float32) for values in decimated(x, y))
    looks = {"color": to_hex(line.get_color()), "alpha": 1.0 if line.get_alpha() is None else float(line.get_alpha())}
    name = "" if label.startswith("_") else label
    if line.get_linestyle() not in ("None", "none", ""):
        dash = DASHES.get(str(line.get_linestyle()), "dashed")
        fig.line(x, y, line_width=float(line.get_linewidth()), line_dash=dash, name=name, **looks, **named)
    else:
        marker = MARKERS.get(str(line.get_marker()), "circle")
        fig.scatter(x, y, size=float(line.get_markersize()), marker=marker, name=name, **looks, **named)


def _area(fig: Any, area: Any) -> None:
    label, colours = str(area.get_label()), area.get_facecolor()
    named = {} if label.startswith("_") else {"legend_label": label}
    if not len(colours):
        return
    for path in area.get_paths():
        x, y = np.asarray(path.vertices, float)[: 2 * MOST_POINTS].T
        fig.patch(x, y, color=to_hex(colours[0][:3]), alpha=float(colours[0][3]), line_width=0, name="", **named)
