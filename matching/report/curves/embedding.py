"""Figures of Bokeh for a page: one look, and scripts and elements that need no network."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

HEIGHT_PX = 260
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
