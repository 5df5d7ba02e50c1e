"""Figures of a report that act: hover, zoom, curves switched by the legend. Bokeh, inline; none where it is missing."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import numpy as np

from matching.frequency.search.result import MatchResult
from matching.report.common.line_styles import LINES
from matching.report.match.checks import signals
from matching.report.match.response_figure import curves_of, magnitude_label

HEIGHT_PX = 260
DASHES = {"vehicle": "solid", "rig": "dashed", "matched": "solid", "unmeasured": "dotted"}


def moving_figures(result: MatchResult) -> dict[str, str]:
    """Scripts and elements by the name of the figure that they stand for; ``library`` is Bokeh itself.

    Empty where Bokeh is not installed: then the report has its pictures alone.
    """
    if find_spec("bokeh") is None:
        return {}
    from bokeh.embed import components
    from bokeh.layouts import column
    from bokeh.resources import Resources

    drawn = {"responses": column(_responses(result), sizing_mode="stretch_width")}
    if figures := _manoeuvre(result):
        drawn["manoeuvre"] = column(figures, sizing_mode="stretch_width")
    script, elements = components(drawn)
    library = Resources(mode="inline", components=["bokeh"]).render()
    return {"library": library, "script": script, **elements}


def _responses(result: MatchResult) -> list[Any]:
    figures: list[Any] = []
    frequencies = result.curves.frequencies
    for index, pair in enumerate(result.case.compared):
        title = f"{pair.input} → {pair.sensor}".replace("_", " ")
        shared = {"x_range": figures[0].x_range} if figures else {}
        labels = ("Frequency in Hz", magnitude_label(result, pair))
        modulus = _figure(title, *labels, x_axis_type="log", y_axis_type="log", **shared)
        phase = _figure("", "Frequency in Hz", "Phase in °", x_axis_type="log", x_range=modulus.x_range)
        for who, values in curves_of(result, index).items():
            line = _line(modulus, frequencies, np.abs(values), who, "Hz")
            below = _line(phase, frequencies, np.degrees(np.angle(values)), who, "Hz")
            line.js_link("visible", below, "visible")
        _place_legend(modulus)
        phase.legend.visible = False
        figures += [modulus, phase]
    return figures


def _manoeuvre(result: MatchResult) -> list[Any]:
    figures: list[Any] = []
    for signal in signals(result):
        shared = {"x_range": figures[0].x_range} if figures else {}
        fig = _figure(signal.title, "Time in s", signal.label, **shared)
        for who, values in signal.curves.items():
            _line(fig, signal.time, values, who, "s")
        _place_legend(fig)
        figures.append(fig)
    return figures


def _figure(title: str, x: str, y: str, **options: Any) -> Any:
    from bokeh.plotting import figure

    fig = figure(
        title=title, x_axis_label=x, y_axis_label=y, height=HEIGHT_PX, sizing_mode="stretch_width",
        tools="pan,wheel_zoom,box_zoom,reset,save", toolbar_location="above", **options,
    )  # fmt: skip
    fig.toolbar.logo = None
    fig.toolbar.active_scroll = None
    return fig


def _line(fig: Any, x: np.ndarray, y: np.ndarray, who: str, unit: str) -> Any:
    from bokeh.models import HoverTool

    style = LINES[who]
    line = fig.line(
        x.astype(np.float32), y.astype(np.float32), color=style["color"], line_width=style["linewidth"],
        alpha=style.get("alpha", 1.0), line_dash=DASHES[who], legend_label=style["label"],
    )  # fmt: skip
    tips = [("", style["label"]), ("x", f"@x{{0.0000}} {unit}"), ("y", "@y{0.00000}")]
    fig.add_tools(HoverTool(renderers=[line], tooltips=tips, mode="vline", visible=who == "matched"))
    return line


def _place_legend(fig: Any) -> None:
    """Below the figure, where it hides no curve on a narrow screen; a click hides or shows a curve."""
    legend = fig.legend[0]
    legend.update(click_policy="hide", ncols=2, label_text_font_size="12px", border_line_color=None, margin=2)
    fig.add_layout(legend, "below")
