"""Bars and histograms of a Matplotlib axes in a figure that acts: each bar says its name and its value."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.colors import to_hex
from matplotlib.container import BarContainer
from matplotlib.patches import StepPatch

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
    _marks(fig, axes)


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


def _named_ticks(axis: Any) -> dict[float, str]:
    """Texts of ticks that are names; none where they are numbers."""
    places = [float(place) for place in axis.get_majorticklocs()]
    texts = axis.get_major_formatter().format_ticks(places)
    named = {place: text for place, text in zip(places, texts, strict=True) if text}
    return named if any(not _is_number(text) for text in named.values()) else {}


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
