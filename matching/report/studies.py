"""The page of a tolerance study: yield, what to order more tightly, how far results spread; histograms to download."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from importlib.util import find_spec
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.collections import LineCollection
from matplotlib.colors import BoundaryNorm, LinearSegmentedColormap, LogNorm, to_hex
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import FixedLocator, MaxNLocator, NullLocator

from matching.match.map import Axis, Map, Point
from matching.match.tolerance import Spread, Tolerance, required_range
from matching.report.common import (
    ABSENT,
    INK,
    LIMIT,
    MATCHED,
    RIG,
    VEHICLE,
    PageFigures,
    PageTable,
    Provenance,
    ScreenPoint,
    StudyPage,
    aligned,
    amount,
    counted,
    csv_table,
    enough_digits,
    figure,
    number,
    percent,
    practical,
    preformatted,
    spaced,
    study_page,
    styled,
    table,
    unit,
)
from matching.report.curves import HATCHES as PATTERNS
from matching.report.curves import acting, acting_figure, embedded_figures, place_legend
from modelling import display, escape

# --- Hatching of a map's points by what limits the match there: readable in grey and by colour-blind readers.

HATCHES = {
    "impossible": ("**", "no match possible"),
    "stability": ("xx", "no stable loop found"),
    "targets": ("\\\\", "target mode not met"),
    "twist": ("//", "shaft twist above its limit"),
    "torque": ("||", "shaft torque above its limit"),
    "dynamometer_torque": ("--", "dynamometer torque above its limit"),
    "dynamometer_speed": ("++", "dynamometer speed above its limit"),
    "dynamometer_power": ("oo", "dynamometer power above its limit"),
    "modulus_margin": ("..", "modulus margin below its limit"),
    "response_error": ("/-", "response error above its tolerance"),
    "beds": ("\\|", "drawn beds not stable or damped too little"),
    "damping_ratio": ("OO", "damping ratio below its limit"),
}


def kinds(point: Point) -> tuple[str, ...]:
    """Keys of :data:`HATCHES` for what limits the match at a point."""
    if point.status == "impossible":
        return ("impossible",)
    return tuple(dict.fromkeys(name.rpartition(".")[2] for name in point.limited_by))


def hatch(axes: Any, result: Map, columns: np.ndarray, rows: np.ndarray) -> list[str]:
    """Hatch the field of every limited point and draw the border to the others.

    Parameters
    ----------
    axes : Axes
    result : Map
    columns, rows : ndarray (x + 1,), (y + 1,)
        Borders of the fields in x and in y.

    Returns
    -------
    list of str
        The keys of :data:`HATCHES` that occur.
    """
    limited = np.array([[bool(kinds(point)) for point in row] for row in result.points])
    occurring: set[str] = set()
    for i, row in enumerate(result.points):
        for j, point in enumerate(row):
            for kind in kinds(point):
                occurring.add(kind)
                size = columns[j + 1] - columns[j], rows[i + 1] - rows[i]
                look: Any = {"hatch": HATCHES[kind][0], "linewidth": 0, "facecolor": "none", "edgecolor": INK}
                axes.add_patch(Rectangle((columns[j], rows[i]), *size, zorder=2, **look))
    vertical = [((columns[j + 1], rows[i]), (columns[j + 1], rows[i + 1])) for i, j in _changes(limited)]
    horizontal = [((columns[j], rows[i + 1]), (columns[j + 1], rows[i + 1])) for j, i in _changes(limited.T)]
    axes.add_collection(LineCollection(vertical + horizontal, colors=INK, linewidths=1.6, zorder=3), autolim=False)
    return [kind for kind in HATCHES if kind in occurring]


def handles(occurring: list[str]) -> list[Patch]:
    """Entries of a legend."""
    patterns = [HATCHES[kind] for kind in occurring]
    return [Patch(facecolor="white", edgecolor=INK, hatch=pattern, label=words) for pattern, words in patterns]


def _changes(limited: np.ndarray) -> list[tuple[int, int]]:
    """Places at which a field differs from the next of its row."""
    return list(zip(*np.nonzero(limited[:, 1:] != limited[:, :-1]), strict=True))


# --- Panel of a map that shows the share of drawn beds that are stable.

TITLE = "Share of drawn beds that are stable"
MOST_WRITTEN = 6  # values per axis up to which every field has its share in numbers
RING_CLEARANCE = 17  # points from the middle of the ring to that of a number below it


def stable_shares(result: Map) -> np.ndarray | None:
    """Shares (y, x) in percent, NaN where no beds judge the match; None where they judge none."""
    shares = 100 * result.errors("stable_beds")
    return shares if np.isfinite(shares).any() else None


def draw_stable_beds(axes: Any, result: Map, columns: np.ndarray, rows: np.ndarray) -> None:
    """Fields with the share of stable beds; borders (x + 1,), (y + 1,) of the fields."""
    shares = 100 * result.errors("stable_beds")
    colours = LinearSegmentedColormap.from_list(
        "shares", colormaps["viridis"](np.linspace(1 - SHADES[1], 1 - SHADES[0], 64))
    )
    fields = axes.pcolormesh(columns, rows, np.ma.masked_invalid(shares), cmap=colours, vmin=0, vmax=100)
    axes.figure.colorbar(fields, ax=axes, format="%g", label="stable beds in %")
    axes.set(title=TITLE, xlim=columns[[0, -1]], ylim=rows[[0, -1]])
    if max(shares.shape) > MOST_WRITTEN:
        return
    for y, line in zip(result.y.values, shares, strict=True):
        for x, share in zip(result.x.values, line, strict=True):
            if np.isfinite(share):
                look: Any = {"ha": "center", "va": "center", "fontsize": 8, **beside_ring(result, x, y)}
                axes.annotate(f"{number(float(share), 4)} %", (x, y), **look)


def beside_ring(result: Map, x: float, y: float) -> dict[str, Any]:
    """Where the number of a field stands: below the ring where the case is, in the middle elsewhere."""
    ring = (x, y) == (result.x.here, result.y.here)
    return {"xytext": (0, -RING_CLEARANCE if ring else 0), "textcoords": "offset points"}


# --- Figure of a map: the response error that a match reaches over two quantities, and what limits it where.

MOST_FIELDS = 6  # values per axis up to which coloured fields with their errors are clearer than contours
LEAST_VALUES = 4  # per axis that contours need
LOGARITHMIC_RATIO = 8.0  # largest over least error from which contour levels rise by 1, 2, 5, 10
EQUAL_RELATIVE = 1e-9  # errors that differ by no more count as equal
LABEL_CLEARANCE = 0.05  # share of an axis that a contour's label keeps from the frame and from the case's mark
SHADES = (0.04, 0.66)  # part of the colour map: light enough for black lines and hatching everywhere
MOST_TICKS = 10  # labels per axis


def map_figure(result: Map) -> Figure:
    """Contours of the response error, fields hatched by what limits the match, the case's point marked.

    Where measured and unmeasured torques have different errors, each has a panel; where drawn beds judge the matches,
    the share of those that are stable has one as well. Small maps show fields with the errors in numbers instead of
    contours.
    """
    drawn, with_beds = panels(result), stable_shares(result) is not None
    count, columns, rows = len(drawn) + with_beds, edges(result.x), edges(result.y)
    with styled():
        fig = figure(1.2 + 5.4 * count, 5.6)
        limiting: list[str] = []
        for place, (title, errors) in enumerate(drawn):
            axes = fig.add_subplot(1, count, place + 1)
            _label(axes, result)
            _errors(fig, axes, result, errors, columns, rows)
            limiting = hatch(axes, result, columns, rows)
            mark = _mark(axes, result)
            axes.set_title(title, fontsize=10)
            axes.grid(False)
        if with_beds:
            axes = fig.add_subplot(1, count, count)
            _label(axes, result)
            draw_stable_beds(axes, result, columns, rows)
            _mark(axes, result)
            axes.grid(False)
        entries = [*handles(limiting), *mark]
        if entries:
            fig.legend(handles=entries, loc="outside lower center", ncols=4, handleheight=1.6, handlelength=2.6)
        if result.title:
            fig.suptitle(escape.figure(result.title), fontsize=11)
    return fig


def panels(result: Map) -> list[tuple[str, np.ndarray]]:
    """Titles and errors (y, x): one panel where measured and unmeasured torques have the same errors."""
    measured, unmeasured = result.errors(), result.errors("unmeasured")
    known = np.isfinite(measured) & np.isfinite(unmeasured)
    if np.allclose(measured[known], unmeasured[known], rtol=EQUAL_RELATIVE, atol=0):
        return [("Response error that a match reaches", measured)]
    return [
        ("Response error to measured torques", measured),
        ("Response error to unmeasured torques", unmeasured),
    ]


def _errors(fig: Any, axes: Any, result: Map, errors: np.ndarray, columns: np.ndarray, rows: np.ndarray) -> None:
    """Contours labelled with their errors, or coloured fields; and the scale."""
    known = errors[np.isfinite(errors)]
    if not known.size:
        axes.set(xlim=columns[[0, -1]], ylim=rows[[0, -1]])
        return
    colours = LinearSegmentedColormap.from_list("errors", colormaps["viridis_r"](np.linspace(*SHADES, 64)))
    masked = np.ma.masked_invalid(errors)
    if min(errors.shape) < LEAST_VALUES or max(errors.shape) <= MOST_FIELDS:
        fields = axes.pcolormesh(
            columns, rows, masked, cmap=colours, norm=LogNorm(known.min() / 1.02, known.max() * 1.02)
        )
        if max(errors.shape) <= MOST_FIELDS:
            _write(axes, result, errors)
        fig.colorbar(fields, ax=axes, format="%g", label=scale_words(result))
        return
    levels = _levels(float(known.min()), float(known.max()))
    norm = BoundaryNorm([known.min() / 2, *levels, known.max() * 2], colours.N)
    x, y = np.array(result.x.values), np.array(result.y.values)
    filled = axes.contourf(x, y, masked, levels=levels, extend="both", cmap=colours, norm=norm)
    axes.set(xlim=x[[0, -1]], ylim=y[[0, -1]])
    lines = axes.contour(x, y, masked, levels=levels, colors=INK, linewidths=0.9, zorder=3.5)
    box: Any = {"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1.2}
    for text in axes.clabel(lines, fmt="%g", fontsize=9, inline=False, colors="black", zorder=4):
        text.set(rotation=0, bbox=box)
        if _hidden(axes, result, text):
            text.remove()
    axes.plot(*(values.ravel() for values in np.meshgrid(x, y)), ".", color=INK, markersize=2.5, zorder=3.2)
    fig.colorbar(filled, ax=axes, format="%g", label=scale_words(result), spacing="uniform")


def _hidden(axes: Any, result: Map, text: Any) -> bool:
    """Whether a contour's label is cut by the frame or covered by the case's mark."""
    place, here = (
        axes.transAxes.inverted().transform(axes.transData.transform(at))
        for at in (text.get_position(), (result.x.here, result.y.here))
    )
    cut = np.any((place < LABEL_CLEARANCE) | (place > 1 - LABEL_CLEARANCE))
    return bool(cut or np.all(np.abs(place - here) < LABEL_CLEARANCE))


def _levels(low: float, high: float) -> list[float]:
    """Round levels between the least and the largest error: 1, 2, 5 times powers of ten, or even steps."""
    if high >= LOGARITHMIC_RATIO * low:
        powers = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
        inner = [round(step * 10.0**power, 12) for power in powers for step in (1, 2, 5)]
    else:
        inner = [round(float(level), 12) for level in MaxNLocator(12, steps=[1, 2, 5, 10]).tick_values(low, high)]
    inner = [level for level in inner if low < level < high]
    return inner if len(inner) > 1 else [low, high] if low < high else [low * 0.99, low * 1.01]


def _write(axes: Any, result: Map, errors: np.ndarray) -> None:
    box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 1.5}
    for y, row in zip(result.y.values, errors, strict=True):
        for x, error in zip(result.x.values, row, strict=True):
            if np.isfinite(error):
                look: Any = {"ha": "center", "va": "center", "fontsize": 8, "bbox": box, "zorder": 4}
                axes.annotate(number(float(error), 2), (x, y), **beside_ring(result, x, y), **look)


def _mark(axes: Any, result: Map) -> list[Any]:
    """A ring at the case's own values, if they lie on the map."""
    if not case_lies_on(result):
        return []
    ring: Any = {"markerfacecolor": "none", "linestyle": "none", "clip_on": False}
    axes.plot(
        result.x.here, result.y.here, "o", markersize=15, markeredgecolor="white", markeredgewidth=5, zorder=5, **ring
    )
    return list(
        axes.plot(
            result.x.here, result.y.here, "o", markersize=15, markeredgecolor=RIG, markeredgewidth=2.4, zorder=6,
            label="the case as it is", **ring,
        )
    )  # fmt: skip


def case_lies_on(result: Map) -> bool:
    """Whether the case's values of both quantities lie within the map."""
    return all(axis.values[0] <= axis.here <= axis.values[-1] for axis in (result.x, result.y))


def scale_words(result: Map) -> str:
    """What the colours of a map mean: quantity and band."""
    return f"rms of |log(H_rig/H_vehicle)|, {number(result.band[0])}–{number(result.band[1])} Hz"


def edges(axis: Axis) -> np.ndarray:
    """Borders (n + 1,) of the fields around the n values of an axis."""
    values = np.log(axis.values) if axis.by_ratio else np.asarray(axis.values)
    if len(values) == 1:
        return np.array([0.9, 1.1]) * axis.values[0] if axis.values[0] else np.array([-1.0, 1.0])
    middles = (values[1:] + values[:-1]) / 2
    ends = [values[0] - (middles[0] - values[0]), *middles, values[-1] + (values[-1] - middles[-1])]
    return np.exp(ends) if axis.by_ratio else np.array(ends)


def _label(axes: Any, result: Map) -> None:
    for drawn_axis, axis, scale in ((axes.xaxis, result.x, axes.set_xscale), (axes.yaxis, result.y, axes.set_yscale)):
        if axis.by_ratio:
            scale("log")
        in_ms = axis.unit == "s"
        every = -(-len(axis.values) // MOST_TICKS)
        ticks = axis.values[::every]
        drawn_axis.set_major_locator(FixedLocator(list(ticks)))
        drawn_axis.set_minor_locator(NullLocator())
        drawn_axis.set_ticklabels([number(1e3 * value if in_ms else value, 3) for value in ticks])
        shown_unit = "ms" if in_ms else unit(axis.unit)
        drawn_axis.set_label_text(f"{axis.name} in {shown_unit}" if shown_unit else axis.name)


# --- A map that acts in the browser: each point a field that says its error, margin and what limits it.

MOST_TICKS_ACTING = 8  # of an axis that has one at each of its values
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
        if (
            axis.by_ratio and len(axis.values) <= MOST_TICKS_ACTING
        ):  # the library leaves a short logarithmic axis almost bare
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


# --- The page of a map: the best point, how far a match reaches, what limits it elsewhere; every point to download.

MAP_CAPTION = "Response error that a match reaches at every pair of values; hatched where a limit stands in the way."
CAPTION_OF_RING = "The ring is the case as it is."
NO_MATCH = "no point is matched: widen the limits, the bounds under [move] or the range of the map"


def map_page(result: Map, image: bytes, made: Provenance | None = None) -> str:
    """The page as HTML, from a map and its picture."""
    points = [point for row in result.points for point in row]
    matched = [point for point in points if point.status == "matched" and point.error is not None]
    content = StudyPage(
        title=f"Map: {result.title}" if result.title else "Map of the response error",
        status=f"{len(matched)} of {len(points)} matched",
        answer=_answer(result, points, matched),
        good=bool(matched),
        first_screen={
            "What to choose": _to_choose(result, matched),
            "How far a match reaches": [
                _reach(axis, name, matched) for name, axis in (("x", result.x), ("y", result.y))
            ],
            "What stands in the way": _in_the_way(points),
        },
        captions={"map": f"{MAP_CAPTION} {CAPTION_OF_RING}" if case_lies_on(result) else MAP_CAPTION},
    )
    return study_page(content, PageFigures({"map": image}, acting_map(result), {"map": point_data(result)}), made)


def point_data(result: Map) -> str:
    """Every point with its tuned values (CSV, SI)."""
    points = [point for row in result.points for point in row]
    names = list(dict.fromkeys(name for point in points for name in point.values))
    head = [f"{axis.name} [{axis.unit}]" for axis in (result.x, result.y)]
    head += [
        "status",
        "error",
        "error, unmeasured torques",
        "bound",
        "modulus margin",
        "share of stable beds",
        "limited by",
        *names,
    ]
    rows = [
        [point.x, point.y, point.status, point.error, point.unmeasured, point.bound, point.modulus_margin,
         point.stable_beds, " ".join(point.limited_by), *(point.values.get(name) for name in names)]
        for point in points
    ]  # fmt: skip
    return csv_table(head, rows)


def _answer(result: Map, points: list[Point], matched: list[Point]) -> str:
    known = matched or [point for point in points if point.error is not None]
    if not known:
        return "No point has a response error: no match could be tried."
    best = min(known, key=_error)
    limited = "" if matched else ", though limited,"
    return f"The least response error{limited} is {number(best.error, 3)}, at {_place(result, best)}."


def _to_choose(result: Map, matched: list[Point]) -> list[ScreenPoint]:
    if not matched:
        return [ScreenPoint("nothing on this map", NO_MATCH)]
    best = min(matched, key=_error)
    chosen = [
        ScreenPoint(_place(result, best), f"least error of all matched points, margin {number(best.modulus_margin, 3)}")
    ]
    safest = max(matched, key=lambda point: point.modulus_margin or 0.0)
    if safest is not best:
        reason = f"largest modulus margin, {number(safest.modulus_margin, 3)}; error {number(safest.error, 3)}"
        chosen.append(ScreenPoint(_place(result, safest), reason))
    return chosen


def _reach(axis: Axis, key: str, matched: list[Point]) -> ScreenPoint:
    values = sorted({getattr(point, key) for point in matched})
    if not values:
        return ScreenPoint(f"{axis.name}: nowhere")
    ends = " to ".join(dict.fromkeys(practical(value, axis.unit) for value in (values[0], values[-1])))
    whole = values[0] == axis.values[0] and values[-1] == axis.values[-1]
    return ScreenPoint(
        f"{axis.name}: {ends}", "the whole range of the map" if whole else "with some value of the other"
    )


def _in_the_way(points: list[Point]) -> list[ScreenPoint]:
    counted = Counter(limiting_words(point) for point in points if point.status != "matched")
    if not counted:
        return [ScreenPoint("nothing on this map", "every point is matched")]
    return [ScreenPoint(words, f"at {count} of {len(points)} points") for words, count in counted.most_common(4)]


def _place(result: Map, point: Point) -> str:
    return ", ".join(
        f"{axis.name} {practical(value, axis.unit) if axis.unit == 's' else amount(value, axis.unit)}"
        for axis, value in ((result.x, point.x), (result.y, point.y))
    )


def _error(point: Point) -> float:
    return float("inf") if point.error is None else point.error


# --- Views of a map: the response error that a match reaches over two quantities.


@display.plot.register
def plot_map(result: Map) -> Figure:
    """Response error over both quantities."""
    return map_figure(result)


@display.text.register
def map_text(result: Map) -> str:
    """Response errors, one row for each value of y."""
    return aligned(_rows(result), result.title)


@display.html.register
def map_html(result: Map) -> str:
    """The text of the result as HTML for a notebook."""
    return table(_rows(result), result.title)


def _rows(result: Map) -> list[dict[str, str]]:
    rows = []
    for y, errors in zip(result.y.values, result.errors(), strict=True):
        cells = zip(result.x.values, errors, strict=True)
        rows.append({f"{result.y.name} \\ {result.x.name}": f"{y:.4g} {result.y.unit}"})
        rows[-1] |= {f"{x:.4g} {result.x.unit}": f"{error:.3g}" for x, error in cells}
    return rows


# --- Views of a tolerance study: distributions with nominal value and limit, and the drivers of each.

DRIVERS_DRAWN, DRIVERS_PRINTED = 5, 3  # quantities with the largest shares of the variance
LEAST_SHARE_PRINTED = 0.02


@display.plot.register
def plot_tolerance(study: Tolerance) -> Figure:
    """One row a result: its distribution, and the quantities that it comes from."""
    with styled():
        fig = figure(8.0, 0.8 + 1.75 * len(study.spreads))
        rows = fig.subplots(len(study.spreads), 2, squeeze=False, width_ratios=[3, 2])
        for (left, right), spread in zip(rows, study.spreads, strict=True):
            left.stairs(100 * spread.counts / spread.draws, spread.edges, fill=True, color=MATCHED, alpha=0.6)
            left.axvline(spread.nominal, color="black", linewidth=1.2, label="nominal")
            for place, label in zip(_required_values(study, spread), ("required", "_"), strict=False):
                left.axvline(place, color=LIMIT, linestyle="--", linewidth=1.2, label=label)
            left.set_xlabel(result_words(spread.name) + (f" in {spread.unit}" if spread.unit else ""))
            left.set_ylabel("share of draws\nin %")
            left.locator_params(axis="x", nbins=6)
            left.legend(fontsize=7, loc="lower right", bbox_to_anchor=(1, 1), ncols=2, borderaxespad=0)
            drivers = spread.drivers[:DRIVERS_DRAWN][::-1]
            right.barh(range(len(drivers)), [100 * share for _, share in drivers], color=VEHICLE)
            right.set_yticks(range(len(drivers)), [short_name(name) for name, _ in drivers], fontsize=7)
            right.set_xlim(0, 100)
            right.set_xlabel("share of the variance in %", fontsize=8)
        fig.align_ylabels(rows[:, 0])
    return fig


def _required_values(study: Tolerance, spread: Spread) -> list[float]:
    """Ends of what is required of a result: the margin, and those of a target mode that a draw comes near."""
    if spread.name == "modulus_margin":
        return [study.asked]
    low, high = spread.edges[0], spread.edges[-1]
    return [end for end in required_range(spread.name, spread.nominal, study.asked) if low <= end <= high]


@display.text.register
def tolerance_text(study: Tolerance) -> str:
    """Yield, spread and drivers."""
    return summary(study.to_dict())


@display.html.register
def tolerance_html(study: Tolerance) -> str:
    """The text of the result as HTML for a notebook."""
    return preformatted(tolerance_text(study))


def summary(result: Mapping[str, Any]) -> str:
    """Yield, spread and drivers in a few lines, from the content of ``tolerance.json``."""
    shares = result["yield"]
    lines = [
        f"{result['title'] or 'Tolerances of the bed'}: {result['draws']} draws of "
        f"{counted(len(result['varied']), 'quantity', 'quantities')}",
        f"yield {shares['all']:.1%}: stable {shares['stable']:.1%}, modulus margin of at least "
        f"{result['modulus_margin_asked']:g} from {result['modulus_margin_from']:.3g} Hz on "
        f"{shares['modulus_margin']:.1%}"
        + "".join(f", {result_words(name)} {share:.1%}" for name, share in shares.items() if name.startswith("target")),
        f"{'':46} {'nominal':>9} {'5 %':>9} {'(interval)':23} {'95 %':>9} {'(interval)':23} {'draws':>8}   driven by",
    ]
    for spread in result["quantities"]:
        drivers = [
            f"{short_name(driver['name'])} {driver['share']:.0%}"
            for driver in spread["drivers"][:DRIVERS_PRINTED]
            if driver["share"] > LEAST_SHARE_PRINTED
        ]
        low, high = (_quantile_at(spread, level) for level in ("0.05", "0.95"))
        name = result_words(spread["name"]) + (f" [{spread['unit']}]" if spread["unit"] else "")
        lines.append(
            f"{name:46} {spread['nominal']:9.4g} {low} {high} {spread['draws']:8}   {', '.join(drivers) or ABSENT}"
        )
    lines.append("interval: where the quantile of all such beds lies with 95 % confidence, by the number of draws")
    return "\n".join(lines)


def _quantile_at(spread: Mapping[str, Any], level: str) -> str:
    """A quantile and its confidence interval; an open end where the draws do not bound it."""
    ends = spread["quantile_intervals"][level]
    digits = max(enough_digits(ends, 4), enough_digits(list(spread["quantiles"].values())))
    low, high = (number(end, digits) if end is not None else "…" for end in ends)
    return f"{number(spread['quantiles'][level], digits):>9} {f'({low} to {high})':23}"


def result_words(name: str) -> str:
    """A result of the study in words."""
    words = name.replace("target_mode", "target mode", 1).replace("feedback_mode", "feedback mode near vehicle mode", 1)
    return spaced(words.replace("error_unmeasured", "error to unmeasured torques"))


def short_name(name: str) -> str:
    """A quantity as figures name it."""
    return name.removeprefix("rig.")


# --- Page

TOLERANCE_CAPTION = (
    "Left: how often a drawn bed has such a result; line: the bed as planned, dashed: what is required. "
    "Right: the quantities whose tolerances cause the spread."
)
WORST_DRIVERS = 4  # on the first screen
LEAST_SHARE = 0.05  # of a variance, from which a tighter tolerance pays
LOW, HIGH = 0.05, 0.95


def tolerance_page(study: Tolerance, figure: Figure, image: bytes, made: Provenance | None = None) -> str:
    """The page as HTML, from a study, its figure and the figure's picture."""
    good = study.shares["all"]
    content = StudyPage(
        title=f"Tolerances: {study.title}" if study.title else "Tolerances of the bed",
        status=percent(good, 1),
        answer=f"{percent(good, 1)} of {study.draws} drawn beds are stable, keep the required margin and every target "
        f"mode with the controller as it is.",
        good=good == 1.0,
        first_screen={
            "What to order more tightly": _to_tighten(study),
            "What to expect": [_expected(spread) for spread in study.spreads],
            "What to watch": _to_watch(study),
        },
        captions={"tolerance": TOLERANCE_CAPTION},
        tables=[PageTable("Spread of every result", [_row(spread) for spread in study.spreads], _HOW_TO_READ)],
    )
    figures = PageFigures({"tolerance": image}, acting({"tolerance": figure}), {"tolerance": histogram_data(study)})
    return study_page(content, figures, made)


_HOW_TO_READ = (
    "In brackets: where the quantile of all such beds lies with 95 % confidence, by the number of draws; … where the "
    "draws do not bound it."
)


def histogram_data(study: Tolerance) -> str:
    """Histograms of all results (CSV): counts of draws between edges."""
    rows = [
        (spread.name, spread.unit, low, high, int(count))
        for spread in study.spreads
        for low, high, count in zip(spread.edges[:-1], spread.edges[1:], spread.counts, strict=True)
    ]
    return csv_table(["result", "unit", "from", "to", "draws"], rows)


def _to_tighten(study: Tolerance) -> list[ScreenPoint]:
    largest: dict[str, tuple[float, Spread]] = {}
    for spread in study.spreads:
        for name, share in spread.drivers:
            if share > max(LEAST_SHARE, largest.get(name, (0.0, spread))[0]):
                largest[name] = share, spread
    ranked = sorted(largest.items(), key=lambda item: -item[1][0])[:WORST_DRIVERS]
    points = [
        ScreenPoint(short_name(name), f"causes {100 * share:.0f} % of the variance of {result_words(spread.name)}")
        for name, (share, spread) in ranked
    ]
    return points or [ScreenPoint("nothing", f"no quantity causes {percent(LEAST_SHARE, 0)} of a variance")]


def _expected(spread: Spread) -> ScreenPoint:
    digits = _digits(spread)
    low, high = (number(spread.quantiles[level], digits) for level in (LOW, HIGH))
    ends = " and ".join(_interval(spread, level) for level in (LOW, HIGH))
    planned = number(spread.nominal, digits)
    note = f"9 of 10 beds; by {spread.draws} draws the ends lie within {ends}; as planned {planned}"
    return ScreenPoint(f"{_named(spread)}: {low} to {high}", note)


def _digits(spread: Spread) -> int:
    return enough_digits([spread.quantiles[LOW], spread.quantiles[HIGH]])


def _to_watch(study: Tolerance) -> list[ScreenPoint]:
    points = [
        ScreenPoint(f"{percent(1 - share, 1)} of the beds {_failure(name)}", _required(study, name))
        for name, share in study.shares.items()
        if name != "all" and share < 1.0
    ]
    return points or [ScreenPoint("no drawn bed fails")]


def _failure(name: str) -> str:
    if name == "stable":
        return "are not stable"
    return "fall below the required modulus margin" if name == "modulus_margin" else f"lose {result_words(name)}"


def _required(study: Tolerance, name: str) -> str:
    if name == "modulus_margin":
        return f"required: {number(study.asked)} from {number(study.asked_from, 3)} Hz on"
    for spread in study.spreads:
        if spread.name == name:
            ends = required_range(name, spread.nominal, study.asked)
            low, high = (number(end, enough_digits(ends)) for end in ends)
            return f"required: {low} to {high}{f' {spread.unit}' if spread.unit else ''}, about the bed as planned"
    return ""


def _row(spread: Spread) -> dict[str, str]:
    digits = max(_digits(spread), 4)
    return {
        "result": _named(spread), "as planned": number(spread.nominal, digits), "mean": number(spread.mean, digits),
        "5 %": _quantile(spread, LOW), "95 %": _quantile(spread, HIGH), "draws": str(spread.draws),
    }  # fmt: skip


def _quantile(spread: Spread, level: float) -> str:
    digits = max(_digits(spread), enough_digits(spread.intervals[level], 4))
    return f"{number(spread.quantiles[level], digits)} ({_interval(spread, level)})"


def _interval(spread: Spread, level: float) -> str:
    """Confidence interval of a quantile."""
    ends = spread.intervals[level]
    return " to ".join("…" if end is None else number(end, enough_digits(ends)) for end in ends)


def _named(spread: Spread) -> str:
    return result_words(spread.name) + (f" in {spread.unit}" if spread.unit else "")
