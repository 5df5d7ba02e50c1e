"""A map that acts in the browser: each point a field that says its error, margin and what limits it."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_hex

from matching.frequency.studies.map import Map
from matching.frequency.studies.map_axis import Axis
from matching.frequency.studies.map_point import Point
from matching.report.common.style import INK, RIG
from matching.report.common.wording import number, unit
from matching.report.curves.acting_bars import HATCHES as PATTERNS
from matching.report.curves.embedding import acting_figure, embedded_figures, place_legend
from matching.report.map.figure import SHADES, case_lies_on, edges, panels, scale_words
from matching.report.map.marks import HATCHES, kinds

MOST_TICKS = 8  # of an axis that has one at each of its values
EDGE = 1.02  # by which the scale of colours reaches beyond the least and the largest error
BAR: dict[str, Any] = {
    "orientation": "horizontal", "width": "auto", "height": 14, "title_text_font_size": "12px", "padding": 4,
}  # fmt: skip


def acting_map(result: Map) -> dict[str, str]:
    """Scripts and elements of the figure ``map``; empty where Bokeh is not installed."""
    if find_spec("bokeh") is None:
        return {}
    drawn = [_panel(result, title, errors) for title, errors in panels(result)]
    return embedded_figures({"map": drawn}, side_by_side=True)


def axis_words(axis: Axis) -> str:
    """A quantity with the unit in which the map shows it."""
    shown = "ms" if axis.unit == "s" else unit(axis.unit)
    return f"{axis.name} in {shown}" if shown else axis.name


def limiting_words(point: Point) -> str:
    """What limits the match at a point; ``matched`` where nothing does."""
    return ", ".join(HATCHES[kind][1] for kind in kinds(point)) or point.status


def shown_scale(axis: Axis) -> float:
    """Factor from SI to the unit in which the map shows a quantity."""
    return 1e3 if axis.unit == "s" else 1.0


def _panel(result: Map, title: str, errors: np.ndarray) -> Any:
    from bokeh.models import ColorBar, HoverTool

    options: dict[str, Any] = {
        f"{key}_axis_type": "log" if axis.by_ratio else "linear" for key, axis in (("x", result.x), ("y", result.y))
    }
    fig = acting_figure(title, axis_words(result.x), axis_words(result.y), **options)
    fig.height = 420
    for drawn, axis in ((fig.xaxis, result.x), (fig.yaxis, result.y)):
        if axis.by_ratio and len(axis.values) <= MOST_TICKS:  # the library leaves a short logarithmic axis almost bare
            ticks = [float(value) * shown_scale(axis) for value in axis.values]
            drawn.ticker, drawn.major_label_overrides = ticks, {tick: number(tick, 3) for tick in ticks}
    fig.grid.visible = False
    fields, colours = _fields(result, errors), _colours(errors)
    quads = [
        _draw(fig, [field for field in fields if field["limited"] is limited], colours, limited)
        for limited in (False, True)
    ]
    tips = [("error", "@error"), ("margin", "@margin"), ("", "@what"), ("x", "@at_x"), ("y", "@at_y")]
    fig.hover[0].renderers = []
    fig.add_tools(HoverTool(tooltips=tips, renderers=[each for each in quads if each is not None]))
    here = (result.x.here * shown_scale(result.x), result.y.here * shown_scale(result.y))
    if case_lies_on(result):
        look: dict[str, Any] = {"size": 16, "fill_color": None}
        fig.scatter([here[0]], [here[1]], line_color="white", line_width=8, **look)  # so that it is seen in grey, too
        fig.scatter([here[0]], [here[1]], legend_label="the case as it is", line_color=RIG, line_width=3, **look)
    place_legend(fig)
    if np.isfinite(errors).any():
        fig.add_layout(ColorBar(color_mapper=colours, title=scale_words(result), **BAR), "below")
    return fig


def _colours(errors: np.ndarray) -> Any:
    """Colours of errors (y, x) by their logarithm, as in the picture; white where there is no error."""
    from bokeh.models import LogColorMapper

    known = errors[np.isfinite(errors)]
    low, high = (float(known.min()), float(known.max())) if known.size else (1.0, 1.0)
    palette = [to_hex(colour) for colour in colormaps["viridis_r"](np.linspace(*SHADES, 64))]
    return LogColorMapper(palette, low=low / EDGE, high=high * EDGE, nan_color="#FFFFFF")


def _fields(result: Map, errors: np.ndarray) -> list[dict[str, Any]]:
    """Borders, error and words of every point."""
    columns, rows = edges(result.x) * shown_scale(result.x), edges(result.y) * shown_scale(result.y)
    fields = []
    for (i, j), error in np.ndenumerate(errors):
        point = result.points[i][j]
        fields.append({
            "left": columns[j], "right": columns[j + 1], "bottom": rows[i], "top": rows[i + 1],
            "fill": float(error),
            "error": number(float(error), 3), "margin": number(point.modulus_margin, 3), "what": limiting_words(point),
            "at_x": f"{number(point.x * shown_scale(result.x), 4)} ({axis_words(result.x)})",
            "at_y": f"{number(point.y * shown_scale(result.y), 4)} ({axis_words(result.y)})",
            "limited": bool(kinds(point)),
        })  # fmt: skip
    return fields


def _draw(fig: Any, fields: list[dict[str, Any]], colours: Any, limited: bool) -> Any:
    from bokeh.models import ColumnDataSource

    if not fields:
        return None
    columns = {key: [field[key] for field in fields] for key in fields[0] if key != "limited"}
    look = {"hatch_pattern": PATTERNS["/"], "hatch_color": INK} if limited else {}
    return fig.quad(
        "left", "right", "top", "bottom", source=ColumnDataSource(columns), line_color="white",
        fill_color={"field": "fill", "transform": colours}, legend_label="limited" if limited else "matched", **look,
    )  # fmt: skip
