"""One look for every figure: fixed colours that colour-blind readers tell apart, figures without pyplot state."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any
from warnings import catch_warnings, simplefilter

from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from matching.report.common.powers import write_powers_plainly
from matching.report.common.ticks import ticks_kept

# Colours of Okabe and Ito (2008), which colour-blind readers tell apart.
VEHICLE = "#0072B2"
RIG = "#D55E00"
MATCHED = "#009E73"
EXTENDED = "#006B4E"  # the same green darker: noise beside noise has no stroke, so in grey its lightness has to differ
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
    "svg.fonttype": "none",  # texts as texts: a third smaller than outlines of letters, and they can be searched
    "svg.hashsalt": "rigmatch",  # the same figure gives the same file
    "axes.titley": 1.0,  # above the axes: no search for ticks that a title might touch
    "text.parse_math": False,  # no $ in a user's title or name begins a formula
}


class PlainFigure(Figure):
    """A figure whose logarithmic axes have plain texts."""

    def draw(self, renderer: Any) -> None:
        """As :meth:`matplotlib.figure.Figure.draw`."""
        write_powers_plainly(self)
        super().draw(renderer)


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
    empty = PlainFigure(figsize=(width, height), layout="constrained")
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
    with styled(), catch_warnings(), ticks_kept(fig):
        simplefilter("ignore", UserWarning)  # a letter that the font lacks, a title longer than the figure
        write_powers_plainly(fig)
        if kind == "svg":
            _write_svg(fig, buffer, {"Date": None, **(metadata or {})})
        else:
            fig.savefig(buffer, format=kind, dpi=DOTS_PER_INCH, metadata=dict(metadata) if metadata else None)
    return buffer.getvalue()


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
