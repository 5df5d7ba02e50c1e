"""A Matplotlib figure's curves as figures that act in the browser: what a report shows on paper, to look into."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec
from typing import Any

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.text import Annotation

from matching.report.common.decimation import MOST_POINTS, decimated
from matching.report.curves.acting_bars import draw_bars, has_bars
from matching.report.curves.acting_scales import (
    SCALES,
    label_placed_ticks,
    label_short_logarithms,
    placed,
    shared_label,
)
from matching.report.curves.embedding import acting_figure, embedded_figures, place_legend, wrapping_row

PIXELS_PER_POINT = 96 / 72
BASELINES = {"top": "top", "bottom": "bottom", "baseline": "alphabetic"}
DASHES = {"-": "solid", "--": "dashed", "-.": "dashdot", ":": "dotted"}
MARKERS = {"o": "circle", "s": "square", "D": "diamond", "^": "triangle", "v": "inverted_triangle", "x": "x"}


def acting(figures: Mapping[str, Figure]) -> dict[str, str]:
    """Scripts and elements by the figures' names (:func:`matching.report.curves.embedding.embedded_figures`).

    Axes without curves or bars, or with scales that the browser's library does not have, are left out, and figures
    that are linear near zero alone (pictures keep pages small); so is everything where that library is not installed.
    """
    if find_spec("bokeh") is None:
        return {}
    panels = {name: _panels(fig) for name, fig in figures.items()}
    return embedded_figures({name: shown for name, shown in panels.items() if shown}, side_by_side=True)


def _panels(fig: Figure) -> list[Any]:
    """Panels of a figure; where its axes stand in a grid, one layout that keeps its rows together."""
    shown = [axes for axes in fig.axes if _is_drawable(axes)]
    if all(axes.get_yscale() == "symlog" for axes in shown):
        return []
    rows: dict[int, list[Any]] = {}
    for axes in shown:
        place = axes.get_subplotspec()
        rows.setdefault(-1 if place is None else place.rowspan.start, []).append(axes)
    if len(rows) < 2 or max(map(len, rows.values())) < 2:
        return [_panel(axes) for axes in shown]
    from bokeh.layouts import column

    lines = [wrapping_row([_panel(axes) for axes in row]) for row in rows.values()]
    return [column(lines, sizing_mode="stretch_width")]


def _is_drawable(axes: Any) -> bool:
    with_bars = has_bars(axes)
    drawable = any(map(_is_curve, axes.lines)) or with_bars
    scales = ("linear", "log") if with_bars else SCALES
    return bool(
        axes.get_visible()
        and axes.axison
        and drawable
        and axes.get_xscale() in ("linear", "log")
        and axes.get_yscale() in scales
    )


def _is_curve(line: Any) -> bool:
    """Not a point, nor a line across the axes, such as a mark."""
    return len(line.get_xdata()) > 1 and line.get_transform() == line.axes.transData


def _panel(axes: Any) -> Any:
    options: dict[str, Any] = {
        "x_axis_type": SCALES[axes.get_xscale()], "y_axis_type": SCALES[axes.get_yscale()],
        "x_range": tuple(map(float, axes.get_xlim())), "y_range": tuple(placed(axes.yaxis, axes.get_ylim()).tolist()),
    }  # fmt: skip
    title = axes.get_title() or axes.get_title("left")
    labels = (shared_label(axes, which).replace("\n", " ") for which in "xy")
    fig = acting_figure(title, *labels, **options)
    label_placed_ticks(fig, axes.yaxis)
    label_short_logarithms(fig, axes)
    for patch in axes.patches:
        _band(fig, axes, patch)
    for area in axes.collections:
        if isinstance(area, PolyCollection):
            _area(fig, area)
    for line in axes.lines:
        _curve(fig, line)
    if has_bars(axes):
        draw_bars(fig, axes)
    _texts(fig, axes)
    place_legend(fig)
    return fig


def _curve(fig: Any, line: Any) -> None:
    if not _is_curve(line):
        return
    x, y = (np.asarray(values, float) for values in line.get_data())
    label = str(line.get_label())
    named = {} if label.startswith("_") else {"legend_label": label}
    x, values = (shown.astype(np.float32) for shown in decimated(x, y))
    columns = {"x": x, "y": placed(axis := line.axes.yaxis, values).astype(np.float32)}
    columns |= {"value": values} if axis.get_scale() == "symlog" else {}
    looks = {"color": to_hex(line.get_color()), "alpha": 1.0 if line.get_alpha() is None else float(line.get_alpha())}
    name = "" if label.startswith("_") else label
    if line.get_linestyle() not in ("None", "none", ""):
        dash = DASHES.get(str(line.get_linestyle()), "dashed")
        fig.line(
            "x",
            "y",
            source=columns,
            line_width=float(line.get_linewidth()),
            line_dash=dash,
            name=name,
            **looks,
            **named,
        )
    else:
        marker = MARKERS.get(str(line.get_marker()), "circle")
        fig.scatter(
            "x", "y", source=columns, size=float(line.get_markersize()), marker=marker, name=name, **looks, **named
        )


def _texts(fig: Any, axes: Any) -> None:
    """Texts that stand beside a point or a bar."""
    for text in axes.texts:
        if not isinstance(text, Annotation) or text.xycoords != "data" or not text.get_text().strip():
            continue
        x, y = text.xy
        right, up = text.xyann if text.anncoords == "offset points" else (0.0, 0.0)
        fig.text(
            [float(x)], placed(axes.yaxis, [float(y)]), [text.get_text()], x_offset=right * PIXELS_PER_POINT,
            y_offset=-up * PIXELS_PER_POINT, text_font_size="11px", text_color=to_hex(text.get_color()), name="",
            text_align=text.get_horizontalalignment(),
            text_baseline=BASELINES.get(text.get_verticalalignment(), "middle"), angle=text.get_rotation(),
            angle_units="deg",
        )  # fmt: skip


def _area(fig: Any, area: Any) -> None:
    label, colours = str(area.get_label()), area.get_facecolor()
    named = {} if label.startswith("_") else {"legend_label": label}
    if not len(colours):
        return
    for path in area.get_paths():
        x, y = np.asarray(path.vertices, float)[: 2 * MOST_POINTS].T
        y = placed(area.axes.yaxis, y)
        fig.patch(x, y, color=to_hex(colours[0][:3]), alpha=float(colours[0][3]), line_width=0, name="", **named)


def _band(fig: Any, axes: Any, patch: Any) -> None:
    """A band across the axes, such as that of the noise."""
    if not isinstance(patch, Rectangle) or patch.get_data_transform() != axes.get_yaxis_transform(which="grid"):
        return
    bottom, top = placed(axes.yaxis, [patch.get_y(), patch.get_y() + patch.get_height()]).tolist()
    left, right = map(float, axes.get_xlim())
    label = str(patch.get_label())
    named = {} if label.startswith("_") else {"legend_label": label}
    fig.quad(left, right, top, bottom, color=to_hex(patch.get_facecolor()[:3]), level="underlay", name="", **named)
