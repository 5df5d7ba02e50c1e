"""One look for every figure: fixed colours that colour-blind readers tell apart, figures without pyplot state."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any
from warnings import catch_warnings, simplefilter

from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.category import StrCategoryFormatter
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.ticker import FixedFormatter

# Colours of Okabe and Ito (2008), which colour-blind readers tell apart.
VEHICLE = "#0072B2"
RIG = "#D55E00"
MATCHED = "#009E73"
NOISE = "#CC79A7"
LIMIT = "#666666"
BAND = "#E6E6E6"
INK = "#222222"  # outlines and marks

# Many curves of one kind: colour and stroke, so that neighbours differ in grey too.
CURVE_COLOURS = (VEHICLE, RIG, MATCHED, NOISE, "#000000", "#E69F00", "#56B4E9", LIMIT)
CURVE_STROKES = ("-", "--", ":", "-.")

DOTS_PER_INCH = 150  # of PNG files and of what SVG files hold as pixels

SETTINGS: Any = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "axes.prop_cycle": f"cycler('color', {list(CURVE_COLOURS)})",
    "legend.frameon": False,
    "svg.hashsalt": "rigmatch",  # the same figure gives the same file
}


def curve(place: int) -> dict[str, Any]:
    """Colour and stroke of one of many curves, by its place."""
    lap = place // len(CURVE_COLOURS)
    return {
        "color": CURVE_COLOURS[place % len(CURVE_COLOURS)],
        "linestyle": CURVE_STROKES[(place + lap) % len(CURVE_STROKES)],
    }


def figure(width: float = 6.4, height: float = 4.0) -> Figure:
    """An empty figure with automatic layout; draw on it inside ``styled()``.

    Parameters
    ----------
    width, height : float
        Inches.
    """
    empty = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(empty)
    return empty


def styled() -> Any:
    """A context in which axes are made with the settings of this module."""
    return rc_context(SETTINGS)


def image(fig: Figure, kind: str = "svg", metadata: Mapping[str, str] | None = None) -> bytes:
    """The content of an image file, without a date in it.

    Parameters
    ----------
    fig : Figure
    kind : {"svg", "png", "pdf"}
    metadata : mapping of str to str, optional
        Entries by Matplotlib's names for the kind of file (``Title``, ``Source``, … for SVG; any for PNG).
    """
    buffer = io.BytesIO()
    with styled(), catch_warnings():
        simplefilter("ignore", UserWarning)  # a letter that the font lacks, a title longer than the figure
        _take_texts_as_written(fig)
        if kind == "svg":
            _write_svg(fig, buffer, {"Date": None, **(metadata or {})})
        else:
            fig.savefig(buffer, format=kind, dpi=DOTS_PER_INCH, metadata=dict(metadata) if metadata else None)
    return buffer.getvalue()


def _take_texts_as_written(fig: Figure) -> None:
    """No ``$`` in a user's title or name begins a formula; the numbers at logarithmic axes are the only formulas."""
    for axes in fig.axes:
        for axis in (axes.xaxis, axes.yaxis):
            if isinstance(axis.get_major_formatter(), StrCategoryFormatter | FixedFormatter):
                axis.get_ticklabels()  # places the names at the axis, so that they are found below
    for text in fig.findobj(Text):
        if "$" in text.get_text() and "\\mathdefault" not in text.get_text():
            text.set_parse_math(False)


def _write_svg(fig: Figure, buffer: io.BytesIO, metadata: Mapping[str, str | None]) -> None:
    """The same as ``savefig`` but draws once: ``savefig`` draws the whole figure a first time for the layout alone."""
    canvas, dpi, engine = fig.canvas, fig.dpi, fig.get_layout_engine()
    svg_canvas = FigureCanvasSVG(fig)
    try:
        if engine is not None:
            engine.execute(fig)
            fig.set_layout_engine("none")
        fig.dpi = DOTS_PER_INCH
        svg_canvas.print_svg(buffer, metadata=dict(metadata))
    finally:
        fig.dpi = dpi
        fig.set_layout_engine(engine)
        fig.set_canvas(canvas)
