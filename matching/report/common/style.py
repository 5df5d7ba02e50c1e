"""One look for every figure: fixed colours that colour-blind readers tell apart, figures without pyplot state."""

from __future__ import annotations

import io
from typing import Any

from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

VEHICLE = "#0072B2"
RIG = "#D55E00"
MATCHED = "#009E73"
LIMIT = "#666666"
NOISE = "#CC79A7"
BAND = "#E6E6E6"

# Many curves of one kind: colours of Okabe and Ito, and strokes, so that neighbours differ in grey too.
CURVES = (VEHICLE, RIG, MATCHED, NOISE, "#000000", "#E69F00", "#56B4E9", LIMIT)
STROKES = ("-", "--", ":", "-.")

DPI = 150  # of what is kept as pixels

SETTINGS: Any = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "axes.prop_cycle": f"cycler('color', {list(CURVES)})",
    "legend.frameon": False,
    "svg.hashsalt": "rigmatch",  # the same figure gives the same file
}


def curve(place: int) -> dict[str, Any]:
    """Colour and stroke of one of many curves, by its place."""
    turn = place // len(CURVES)
    return {"color": CURVES[place % len(CURVES)], "linestyle": STROKES[(place + turn) % len(STROKES)]}


def figure(width: float = 6.4, height: float = 4.0) -> Figure:
    """An empty figure (width and height in inches) that is laid out by itself; draw on it inside ``styled()``."""
    made = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(made)
    return made


def styled() -> Any:
    """A context in which axes take the house's look."""
    return rc_context(SETTINGS)


def image(drawn: Figure, kind: str = "svg") -> bytes:
    """The figure as file content of a kind (``svg``, ``png`` or ``pdf``), without a date in it."""
    buffer = io.BytesIO()
    with styled():
        if kind == "svg":
            _write_svg(drawn, buffer)
        else:
            drawn.savefig(buffer, format=kind, dpi=DPI)
    return buffer.getvalue()


def _write_svg(drawn: Figure, buffer: io.BytesIO) -> None:
    """What ``savefig`` writes too, without drawing all of it once before for the sake of the layout alone."""
    canvas, dpi, engine = drawn.canvas, drawn.dpi, drawn.get_layout_engine()
    own = FigureCanvasSVG(drawn)
    try:
        if engine is not None:
            engine.execute(drawn)
            drawn.set_layout_engine("none")
        drawn.dpi = DPI
        own.print_svg(buffer, metadata={"Date": None})
    finally:
        drawn.dpi = dpi
        drawn.set_layout_engine(engine)
        drawn.set_canvas(canvas)
