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
from matching.report.map.figure import SHADES, edges, panels
from matching.report.map.marks import HATCHES, kinds


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
    from bokeh.models import HoverTool

    options: dict[str, Any] = {
        f"{key}_axis_type": "log" if axis.by_ratio else "linear" for key, axis in (("x", result.x), ("y", result.y))
    }
    fig = acting_figure(title, axis_words(result.x), axis_words(result.y), **options)
    fig.height = 420
    fig.grid.visible = False
    fields = _fields(result, errors)
    drawn = [
        _draw(fig, [field for field in fields if field["limited"] is limited], limited) for limited in (False, True)
    ]
    tips = [("error", "@error"), ("margin", "@margin"), ("", "@what"), ("x", "@at_x"), ("y", "@at_y")]
    fig.hover[0].renderers = []
    fig.add_tools(HoverTool(tooltips=tips, renderers=[fields for fields in drawn if fields is not None]))
    here = (result.x.here * shown_scale(result.x), result.y.here * shown_scale(result.y))
    if all(axis.values[0] <= axis.here <= axis.values[-1] for axis in (result.x, result.y)):
        look: dict[str, Any] = {"size": 16, "fill_color": None, "line_color": RIG, "line_width": 3}
        fig.scatter([here[0]], [here[1]], legend_label="the case as it is", **look)
    place_legend(fig)
    return fig


def _fields(result: Map, errors: np.ndarray) -> list[dict[str, Any]]:
    """Borders, colour and words of every point."""
    columns, rows = edges(result.x) * shown_scale(result.x), edges(result.y) * shown_scale(result.y)
    known = np.log(errors[np.isfinite(errors)])
    low, width = (float(known.min()), float(np.ptp(known)) or 1.0) if known.size else (0.0, 1.0)
    fields = []
    for (i, j), error in np.ndenumerate(errors):
        point = result.points[i][j]
        place = SHADES[0] + (SHADES[1] - SHADES[0]) * (np.log(error) - low) / width if np.isfinite(error) else None
        fields.append({
            "left": columns[j], "right": columns[j + 1], "bottom": rows[i], "top": rows[i + 1],
            "fill": "#FFFFFF" if place is None else to_hex(colormaps["viridis_r"](place)),
            "error": number(float(error), 3), "margin": number(point.modulus_margin, 3), "what": limiting_words(point),
            "at_x": f"{number(point.x * shown_scale(result.x), 4)} ({axis_words(result.x)})",
            "at_y": f"{number(point.y * shown_scale(result.y), 4)} ({axis_words(result.y)})",
            "limited": bool(kinds(point)),
        })  # fmt: skip
    return fields


def _draw(fig: Any, fields: list[dict[str, Any]], limited: bool) -> Any:
    from bokeh.models import ColumnDataSource

    if not fields:
        return None
    columns = {key: [field[key] for field in fields] for key in fields[0] if key != "limited"}
    look = {"hatch_pattern": PATTERNS["/"], "hatch_color": INK, "fill_alpha": 0.6} if limited else {}
    return fig.quad(
        "left", "right", "top", "bottom", source=ColumnDataSource(columns), fill_color="fill", line_color="white",
        legend_label="limited" if limited else "matched", **look,
    )  # fmt: skip
