"""A Matplotlib figure's curves, bars and fields as figures that act in the browser (Bokeh, inline): zoom and hover."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.collections import PolyCollection, QuadMesh
from matplotlib.colors import to_hex
from matplotlib.container import BarContainer
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle, StepPatch
from matplotlib.text import Annotation

from matching.report.common import (
    LABELLED_RATIO,
    MOST_POINTS,
    decimated,
)

# --- Bars and histograms of a Matplotlib axes in a figure that acts: each bar says its name and its value.

HATCHES = {"/": "right_diagonal_line", ".": "dot", "\\": "left_diagonal_line", "x": "diagonal_cross"}
ROW_PX, AROUND_PX = 20, 130  # height of a lying bar with its name; of what stands above and below all of them
CENTRED = 0.51  # of an axis' unit: how far from its tick a named bar may stand


@dataclass(frozen=True)
class _Bar:
    """Borders of a bar in data, whether it lies, and how it looks."""

    left: float
    right: float
    bottom: float
    top: float
    lies: bool
    colour: str
    alpha: float
    hatch: str
    label: str


def has_bars(axes: Any) -> bool:
    """Whether there are bars or a histogram to draw."""
    return any(True for _ in _bars(axes))


def draw_bars(fig: Any, axes: Any) -> None:
    """Bars as quads with the names of their ticks; lines across the axes as lines, for the legend."""
    from bokeh.models import HoverTool

    bars = list(_bars(axes))
    lies = any(bar.lies for bar in bars)
    ticks = _named_ticks(axes.yaxis if lies else axes.xaxis)
    if ticks:
        axis = fig.yaxis if lies else fig.xaxis
        if lies:
            fig.height = max(fig.height, AROUND_PX + ROW_PX * len(ticks))
        axis.ticker, axis.major_label_overrides = sorted(ticks), ticks
    for hover in fig.hover:
        hover.renderers = [line for line in fig.renderers if line.name]
    drawn = []
    for look in dict.fromkeys((bar.colour, bar.alpha, bar.hatch, bar.label) for bar in bars):
        members = [bar for bar in bars if (bar.colour, bar.alpha, bar.hatch, bar.label) == look]
        drawn.append(_quads(fig, axes, members, ticks))
    fig.add_tools(HoverTool(tooltips=[("", "@label"), ("", "@words")], renderers=drawn))


def _within(bar: _Bar, axes: Any) -> _Bar:
    """A bar that begins at 0 of a logarithmic axis begins at the end of the axis: 0 has no place there."""
    if bar.lies and axes.get_xscale() == "log" and bar.left <= 0:
        return replace(bar, left=float(min(axes.get_xlim())))
    if not bar.lies and axes.get_yscale() == "log" and bar.bottom <= 0:
        return replace(bar, bottom=float(min(axes.get_ylim())))
    return bar


def _quads(fig: Any, axes: Any, bars: list[_Bar], ticks: dict[float, str]) -> Any:
    from bokeh.models import ColumnDataSource

    first = bars[0]
    columns: dict[str, Any] = {
        side: [getattr(_within(bar, axes), side) for bar in bars] for side in ("left", "right", "bottom", "top")
    }
    columns |= {"label": [_name(bar, ticks) for bar in bars], "words": [_words(bar, bool(ticks)) for bar in bars]}
    named = {"legend_label": first.label} if first.label else {}
    hatch = {"hatch_pattern": HATCHES[first.hatch[0]], "hatch_color": "white"} if first.hatch[:1] in HATCHES else {}
    return fig.quad(
        "left", "right", "top", "bottom", source=ColumnDataSource(columns), color=first.colour, alpha=first.alpha,
        line_color="white", line_width=0.5, **named, **hatch,
    )  # fmt: skip


def _marks(fig: Any, axes: Any) -> None:
    """Lines from one side of the axes to the other, such as a limit."""
    for line in axes.lines:
        x, y = (np.asarray(values, float) for values in line.get_data())
        if len(x) != 2 or line.get_transform() == axes.transData:
            continue
        upright = x[0] == x[1]
        ends = axes.get_ylim() if upright else axes.get_xlim()
        label = str(line.get_label())
        named = {} if label.startswith("_") else {"legend_label": label}
        dash = "solid" if line.get_linestyle() == "-" else "dashed"
        points = (x, list(map(float, ends))) if upright else (list(map(float, ends)), y)
        fig.line(*points, color=to_hex(line.get_color()), line_width=1.4, line_dash=dash, **named)


def _bars(axes: Any) -> Iterator[_Bar]:
    for container in axes.containers:
        if isinstance(container, BarContainer):
            label = str(container.get_label())
            for patch in container:
                x, y, width, height = patch.get_x(), patch.get_y(), patch.get_width(), patch.get_height()
                if width and height:
                    yield _bar((x, x + width, y, y + height), container.orientation == "horizontal", patch, label)
    for patch in axes.patches:
        if isinstance(patch, StepPatch):
            values, edges, base = patch.get_data()
            for value, left, right in zip(values, edges[:-1], edges[1:], strict=True):
                if value:
                    yield _bar((left, right, float(base or 0.0), value), False, patch, "")


def _bar(borders: tuple[float, float, float, float], lies: bool, patch: Any, label: str) -> _Bar:
    face = patch.get_facecolor()
    label = "" if label.startswith("_") else label
    left, right, bottom, top = map(float, borders)
    return _Bar(left, right, bottom, top, lies, to_hex(face[:3]), float(face[3]), patch.get_hatch() or "", label)


def _named_ticks(axis: Any, numbers: bool = False) -> dict[float, str]:
    """Texts of ticks that are names; none where they are numbers, unless those are wanted too."""
    places = [float(place) for place in axis.get_majorticklocs()]
    texts = axis.get_major_formatter().format_ticks(places)
    named = {place: text for place, text in zip(places, texts, strict=True) if text}
    return named if numbers or any(not _is_number(text) for text in named.values()) else {}


def _is_number(text: str) -> bool:
    try:
        float(text.replace("\N{MINUS SIGN}", "-"))
    except ValueError:
        return False
    return True


def _name(bar: _Bar, ticks: dict[float, str]) -> str:
    centre = (bar.bottom + bar.top) / 2 if bar.lies else (bar.left + bar.right) / 2
    near = min(ticks, key=lambda place: abs(place - centre), default=None)
    named = ticks[near] if near is not None and abs(near - centre) < CENTRED else ""
    return ", ".join(filter(None, (named, bar.label)))


def _words(bar: _Bar, is_named: bool) -> str:
    if bar.lies:
        return f"{bar.right - bar.left:.4g}"
    height = f"{bar.top - bar.bottom:.4g}"
    return height if is_named else f"{bar.left:.4g} to {bar.right:.4g}: {height}"


# --- Scales and labels of Matplotlib axes for the browser's library, which lacks the scale that is linear near zero.

SCALES = {"linear": "linear", "log": "log", "symlog": "linear"}  # others have no counterpart: such axes stay pictures


# The library puts evenly spaced ticks on a short logarithmic axis, where they crowd at its end.
SHORT_LOG_TICKS = """
const low = Math.min(cb_data.start, cb_data.end), high = Math.max(cb_data.start, cb_data.end), ticks = []
if (!(low > 0)) return ticks
if (high > 4 * low) {
  for (let k = Math.floor(Math.log10(low)); k <= Math.log10(high); k++)
    for (const m of high < LABELLED * low ? [1, 2, 5] : [1])
      if (m * 10**k >= low && m * 10**k <= high) ticks.push(m * 10**k)
  return ticks
}
const least = (high - low) / 6, decade = 10**Math.floor(Math.log10(least))
const step = decade * [1, 2, 5, 10].find((m) => m * decade >= least)
for (let k = Math.ceil(low / step); k * step <= high; k++) ticks.push(k * step)
return ticks
""".replace("LABELLED", str(LABELLED_RATIO))


def label_short_logarithms(fig: Any, axes: Any) -> None:
    """At the logarithmic axes that are short: ticks at 1, 2 and 5 of a decade, with plain numbers."""
    from bokeh.models import CustomJSTicker, CustomJSTickFormatter

    for drawn, axis in ((fig.xaxis, axes.xaxis), (fig.yaxis, axes.yaxis)):
        low, high = sorted(axis.get_view_interval())
        if axis.get_scale() == "log" and high < LABELLED_RATIO * low:
            drawn.ticker = CustomJSTicker(major_code=SHORT_LOG_TICKS, minor_code="return []")
            drawn.formatter = CustomJSTickFormatter(code="return String(Number(tick.toPrecision(4)))")


def placed(axis: Any, values: Any) -> np.ndarray:
    """Where values (t,) stand on a figure that acts, also (t,): themselves, but on an axis that is linear near zero."""
    values = np.asarray(values, float)
    return np.asarray(axis.get_transform().transform(values)) if axis.get_scale() == "symlog" else values


def label_placed_ticks(fig: Any, axis: Any) -> None:
    """At an upright axis that is linear near zero: the ticks of the picture, and values themselves where pointed at."""
    if axis.get_scale() != "symlog":
        return
    ticks = axis.get_majorticklocs()
    places = placed(axis, ticks).tolist()
    fig.yaxis.ticker = places
    fig.yaxis.major_label_overrides = dict(zip(places, axis.get_major_formatter().format_ticks(ticks), strict=True))
    for hover in fig.hover:
        hover.tooltips = [(name, "@value{0.00000}" if name == "y" else shown) for name, shown in hover.tooltips]


def shared_label(axes: Any, which: str) -> str:
    """The label of an axis, or where axes share it, that of the axes that carry it (``which``: ``x`` or ``y``)."""
    label = str(getattr(axes, f"get_{which}label")())
    if label:
        return label
    shared = getattr(axes, f"get_shared_{which}_axes")().get_siblings(axes)
    here = axes.get_subplotspec()
    if here is None:
        return ""
    for other in shared:
        place = other.get_subplotspec()
        aligned = place is not None and (
            place.colspan == here.colspan if which == "x" else place.rowspan == here.rowspan
        )
        if aligned and getattr(other, f"get_{which}label")():
            return str(getattr(other, f"get_{which}label")())
    return ""


# --- Figures of Bokeh for a page: one look, and scripts and elements that need no network.

COLOUR_BAR = "<colorbar>"  # what Matplotlib calls the axes of one
HEIGHT_PX, FIELDS_PX = 260, 420  # of a figure with curves, of one with coloured fields
RANDOM = re.compile(
    r"[0-9a-f]{8}(?:-[0-9a-f]{4}){3}-[0-9a-f]{12}"
)  # names that Bokeh draws: the same page twice differs
WRAP = """\
const pen = document.createElement("canvas").getContext("2d")
const part = key === "text" ? "text" : "axis_label_text"
pen.font = ["style", "size", "font"].map(each => model[part + "_font" + (each === "font" ? "" : "_" + each)]).join(" ")
const width = words => pen.measureText(words).width
const lines = [""]
const tools = key === "text" ? 60 : 0  // px for the menu beside a title
for (const word of whole.split(" ")) {
  const longer = (lines[lines.length - 1] + " " + word).trim()
  if (width(longer) <= cb_obj[room] - tools || lines[lines.length - 1] === "") lines[lines.length - 1] = longer
  else lines.push(word)
}
setTimeout(() => {  // the layout that told the width is not over
  model[key] = lines.join("\\n")
  if (key === "text") cb_obj.min_border_top = 8 + 18 * lines.length  // px of the title: so many lines are laid out
})"""
NARROWEST_PX = 300  # of a panel: where less room is left for two, they stand below each other
MANY_PANELS, WIDER_PX = 4, 360  # of so many panels, with room for their legends; a narrow screen has 372


def acting_figure(title: str, x: str, y: str, **options: Any) -> Any:
    """An empty figure with pan, zoom, reading of values and saving; ``x`` and ``y`` are its labels."""
    from bokeh.models import HoverTool
    from bokeh.plotting import figure

    fig = figure(
        title=title, x_axis_label=x, y_axis_label=y, height=HEIGHT_PX, sizing_mode="stretch_width",
        tools="pan,wheel_zoom,box_zoom,reset,save", toolbar_location="above", **options,
    )  # fmt: skip
    fig.toolbar.logo = None
    fig.toolbar.active_scroll = None
    tips = [
        ("", "$name"),
        ("x", f"@x{{0.0000}} {x.rpartition(' in ')[2] if ' in ' in x else ''}"),
        ("y", "@y{0.00000}"),
    ]
    fig.add_tools(HoverTool(tooltips=tips, mode="vline"))
    wrap_texts(fig)
    return fig


def wrap_texts(fig: Any) -> None:
    """Break title and labels of a figure into lines wherever it gets narrower than they are long."""
    from bokeh.models import CustomJS

    texts = [(fig.title, "text", "inner_width"), (fig.xaxis[0], "axis_label", "inner_width")]
    texts.append((fig.yaxis[0], "axis_label", "inner_height"))
    for model, key, room in texts:
        if whole := getattr(model, key):
            args = {"model": model, "key": key, "whole": whole, "room": room}
            fig.js_on_change(room, CustomJS(args=args, code=WRAP))


def place_legend(fig: Any) -> None:
    """Below the figure, where it hides no curve on a narrow screen; a click hides or shows a curve."""
    if not fig.legend:
        return
    legend = fig.legend[0]
    legend.update(click_policy="hide", ncols=2, label_text_font_size="12px", border_line_color=None, margin=2)
    fig.add_layout(legend, "below")


def wrapping_row(panels: Sequence[Any]) -> Any:
    """Panels beside each other, below each other where the page is narrow."""
    from bokeh.layouts import row

    for panel in panels:
        panel.min_width = NARROWEST_PX if len(panels) < MANY_PANELS else WIDER_PX
    return row(list(panels), sizing_mode="stretch_width", styles={"flex-wrap": "wrap"})


def embedded_figures(panels: Mapping[str, Sequence[Any]], *, side_by_side: bool) -> dict[str, str]:
    """Scripts and elements by name; ``library`` is Bokeh itself, ``script`` what makes the elements act.

    Empty where there is no panel. Panels ``side_by_side`` stand below each other only where the page is narrow; those
    of an inner list always do.
    """
    from bokeh.embed import components
    from bokeh.layouts import column
    from bokeh.resources import Resources

    if not panels:
        return {}
    drawn = {}
    for name, figures in panels.items():
        if len(figures) == 1 or not side_by_side:
            drawn[name] = column(list(figures), sizing_mode="stretch_width")
            continue
        beside = [column(panel, sizing_mode="stretch_width") if isinstance(panel, list) else panel for panel in figures]
        drawn[name] = wrapping_row(beside)
    script, elements = components(drawn)
    numbers: dict[str, str] = {}

    def numbered(text: str) -> str:
        return RANDOM.sub(lambda random: numbers.setdefault(random[0], f"acting-{len(numbers) + 1}"), text)

    parts = Resources(mode="inline", components=["bokeh"]).js_raw  # render() adds addresses once Panel is loaded
    library = "\n".join(f"<script>\n{part}\n</script>" for part in parts)
    return {"library": library, "script": numbered(script), **{name: numbered(elements[name]) for name in drawn}}


# --- A Matplotlib figure's curves as figures that act in the browser: what a report shows on paper, to look into.

PIXELS_PER_POINT = 96 / 72
BASELINES = {"top": "top", "bottom": "bottom", "baseline": "alphabetic"}
MATPLOTLIB_DASHES = {"-": "solid", "--": "dashed", "-.": "dashdot", ":": "dotted"}
MARKERS = {"o": "circle", "s": "square", "D": "diamond", "^": "triangle", "v": "inverted_triangle", "x": "x"}


def acting(figures: Mapping[str, Figure]) -> dict[str, str]:
    """Scripts and elements by the figures' names (:func:`matching.report.curves.embedded_figures`).

    Axes without curves or bars, or with scales that the browser's library does not have, are left out, and figures
    that are linear near zero alone (pictures keep pages small).
    """
    panels = {name: _panels(fig) for name, fig in figures.items()}
    return embedded_figures({name: shown for name, shown in panels.items() if shown}, side_by_side=True)


def _panels(fig: Figure) -> list[Any]:
    """Panels of a figure; where its axes stand in a grid, one layout that keeps its rows together."""
    shown = [axes for axes in fig.axes if _is_drawable(axes) and axes.get_label() != COLOUR_BAR]
    if all(axes.get_yscale() == "symlog" for axes in shown):
        return []
    rows: dict[int, list[Any]] = {}
    for axes in shown:
        place = axes.get_subplotspec()
        rows.setdefault(-1 if place is None else place.rowspan.start, []).append(axes)
    if len(rows) < 2 or max(map(len, rows.values())) < 2:
        return _with_legends([_panel(axes) for axes in shown])
    from bokeh.layouts import column

    made = [[_panel(axes) for axes in row] for row in rows.values()]
    _with_legends([panel for row in made for panel in row])
    return [column([wrapping_row(row) for row in made], sizing_mode="stretch_width")]


def _with_legends(panels: list[Any]) -> list[Any]:
    """Panels with a legend each, but for one that says no more than an earlier one."""
    told: set[str] = set()
    for panel in panels:
        words = {item.label.value for legend in panel.legend for item in legend.items}
        if words <= told:
            for legend in panel.legend:
                legend.visible = False
        else:
            place_legend(panel)
        told |= words
    return panels


def _is_drawable(axes: Any) -> bool:
    with_bars = has_bars(axes)
    drawable = with_bars or _has_fields(axes) or any(map(_is_curve, axes.lines))
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
        _band_patch(fig, axes, patch)
    for area in axes.collections:
        if isinstance(area, QuadMesh):
            _fields(fig, axes, area)
        elif isinstance(area, PolyCollection):
            _area(fig, area)
    for line in axes.lines:
        _drawn_line(fig, line)
    if has_bars(axes):
        draw_bars(fig, axes)
    else:
        for drawn_axis, axis in ((fig.xaxis, axes.xaxis), (fig.yaxis, axes.yaxis)):
            if names := _named_ticks(axis, _has_fields(axes)):
                drawn_axis.ticker, drawn_axis.major_label_overrides = sorted(names), names
    _marks(fig, axes)
    _texts(fig, axes)
    return fig


def _drawn_line(fig: Any, line: Any) -> None:
    is_point = len(line.get_xdata()) == 1 and line.get_marker() in MARKERS
    if not is_point and not _is_curve(line):
        return
    x, y = (np.asarray(values, float) for values in line.get_data())
    label = str(line.get_label())
    named = {} if label.startswith("_") else {"legend_label": label}
    x, values = (shown.astype(np.float32) for shown in decimated(x, y))
    columns = {"x": x, "y": placed(axis := line.axes.yaxis, values).astype(np.float32)}
    columns |= {"value": values} if axis.get_scale() == "symlog" else {}
    looks = {"color": to_hex(line.get_color()), "alpha": 1.0 if line.get_alpha() is None else float(line.get_alpha())}
    name = "" if label.startswith("_") else label
    if line.get_linestyle() not in ("None", "none", "") and not is_point:
        dash = MATPLOTLIB_DASHES.get(str(line.get_linestyle()), "dashed")
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
    """Texts that stand beside a point or a bar, or on a coloured field."""
    ground: dict[str, Any] = {}
    if _has_fields(axes):
        ground = {"background_fill_color": "white", "background_fill_alpha": 0.75}
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
            angle_units="deg", **ground,
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


def _has_fields(axes: Any) -> bool:
    return any(isinstance(own, QuadMesh) for own in axes.collections)


def _fields(fig: Any, axes: Any, mesh: QuadMesh) -> None:
    """Coloured fields, each of which tells its borders and its value."""
    from bokeh.models import HoverTool

    corners = np.asarray(mesh.get_coordinates(), float)
    values: np.ndarray = np.ma.filled(
        np.ma.asarray(mesh.get_array(), float).reshape(np.array(corners.shape[:2]) - 1), np.nan
    )
    known = np.isfinite(values)
    left, bottom = (corners[:-1, :-1, k][known] for k in (0, 1))
    right, top = (corners[1:, 1:, k][known] for k in (0, 1))
    columns = {
        "left": left, "right": right, "bottom": bottom, "top": top,
        "value": [f"{value:.4g}" for value in values[known]],
        "colour": [to_hex(colour) for colour in mesh.to_rgba(values[known])],
    }  # fmt: skip
    drawn = fig.quad("left", "right", "top", "bottom", source=columns, color="colour", line_color="white", name="")
    where = [("x", "@left{0.000} to @right{0.000}"), ("y", "@bottom{0.000} to @top{0.000}")]
    for hover in fig.hover:
        hover.renderers = []
    fig.add_tools(HoverTool(tooltips=[(str(mesh.get_label()).lstrip("_"), "@value"), *where], renderers=[drawn]))
    limited = [own for own in axes.patches if isinstance(own, Rectangle) and own.get_hatch()]
    if limited:
        borders = np.array([own.get_bbox().extents for own in limited]).T
        fig.quad(borders[0], borders[2], borders[3], borders[1], fill_alpha=0, line_color=None, hatch_color="black",
                 hatch_pattern=HATCHES["/"], hatch_alpha=0.6, name="", legend_label="limited")  # fmt: skip
    fig.height = FIELDS_PX
    fig.grid.visible = False


def _band_patch(fig: Any, axes: Any, patch: Any) -> None:
    """A band across the axes, such as that of the noise."""
    if not isinstance(patch, Rectangle):
        return
    left, right = map(float, axes.get_xlim())
    bottom, top = map(float, axes.get_ylim())
    if patch.get_data_transform() == axes.get_yaxis_transform(which="grid"):
        bottom, top = patch.get_y(), patch.get_y() + patch.get_height()
    elif patch.get_data_transform() == axes.get_xaxis_transform(which="grid"):
        left, right = patch.get_x(), patch.get_x() + patch.get_width()
    else:
        return
    bottom, top = placed(axes.yaxis, [bottom, top]).tolist()
    label = str(patch.get_label())
    named = {} if label.startswith("_") else {"legend_label": label}
    fig.quad(left, right, top, bottom, color=to_hex(patch.get_facecolor()[:3]), level="underlay", name="", **named)
