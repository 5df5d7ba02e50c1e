"""What every figure, page and text shares: colours, numbers and units in words, tables, page templates."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from typing import Any
from warnings import catch_warnings, simplefilter

import numpy as np
import sympy as sm
from matplotlib import rc_context, rcParamsDefault
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import (
    LogFormatterSciNotation,
    LogLocator,
    MaxNLocator,
    NullFormatter,
    NullLocator,
    StrMethodFormatter,
)  # fmt: skip
from sympy.printing.mathml import MathMLPresentationPrinter

from modelling.equations.lagrange import Sign, derive, known_zeros, signs
from modelling.system import System
from modelling.units import printed

# --- Tables that a page lets its reader save (CSV).

DIGITS = 7  # of every number


def csv_table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Rows below a head; numbers with seven digits, nothing where there is no value (None, NaN).

    The head is without commas: not every reader (``numpy.genfromtxt``) knows quotation marks.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([name.replace(",", "") for name in head])
    writer.writerows([_cell(value) for value in row] for row in rows)
    return text.getvalue()


def _cell(value: Any) -> str:
    if value is None or isinstance(value, str):
        return value or ""
    return "" if math.isnan(value) else f"{value:.{DIGITS}g}"


# --- Long curves by fewer points, for figures: more than the eye can tell apart only make files large.

MOST_POINTS = 2000  # of a curve; of longer ones the least and the largest value of every part are kept


def decimated(x: np.ndarray, y: np.ndarray, most: int = MOST_POINTS) -> tuple[np.ndarray, np.ndarray]:
    """A curve (t,) by at most so many points: of every part its least and its largest value, in their order."""
    if len(x) <= most:
        return x, y
    edges = np.linspace(0, len(x), most // 2 + 1).astype(int)
    begins, ends = edges[:-1, None], edges[1:, None]
    at = begins + np.arange((ends - begins).max())
    values = np.where(at < ends, y[np.minimum(at, len(y) - 1)], np.nan)
    missing = np.isnan(values)
    least, largest = np.where(missing, np.inf, values).argmin(axis=1), np.where(missing, -np.inf, values).argmax(axis=1)
    kept = np.unique(begins[:, 0] + np.stack([least, largest]))
    return x[kept], y[kept]


# --- Numbers, units and names as a reader expects them; every number can be copied into a calculator or a file.

ABSENT = "–"
_UNIT_SIGNS = {"kg*m^2": "kg·m²", "rad/s^2": "rad/s²", "1": ""}
_PRACTICAL_UNITS = {  # factor and unit by SI unit
    "s": (1e3, "ms"),
    "rad": (180 / math.pi, "°"),
    "rad/s": (30 / math.pi, "1/min"),
    "W": (1e-3, "kW"),
    "m": (1e3, "mm"),
    "Pa": (1e-6, "MPa"),
}
_PLAIN_POWERS = range(-4, 7)  # powers of ten that are written without exponent
UNCHANGED_PERCENT = 0.05  # a smaller change would be printed as 0.0 %


def number(value: float | None, digits: int = 4) -> str:
    """A number with so many significant digits; ``–`` where there is none."""
    if value is None or not math.isfinite(value):
        return ABSENT
    text = f"{value:.{digits}g}"
    if "e" not in text:
        return text
    mantissa, power = text.split("e")
    if int(power) not in _PLAIN_POWERS:
        return f"{mantissa}e{int(power)}"
    return f"{float(text):.0f}"  # the format g writes small numbers of these powers without exponent


UNCERTAIN_PLAIN_POWERS = range(-4, 6)  # powers of ten of a value that is written without exponent
MOST_DECIMALS = 8


def plus_minus(value: float, uncertainty: float | None) -> str:
    """A value ± its uncertainty, both to two digits of that (JCGM 100, 7.2.6); the value alone where there is none."""
    if not uncertainty or not math.isfinite(uncertainty):
        return number(value)
    u = float(f"{uncertainty:.1e}")  # 0.0996 is 0.10
    decimals = 1 - math.floor(math.log10(u))
    power = math.floor(math.log10(max(abs(value), u)))
    if power in UNCERTAIN_PLAIN_POWERS and decimals <= MOST_DECIMALS:
        places = max(decimals, 0)
        return f"{round(value, decimals):.{places}f} ± {round(u, decimals):.{places}f}"
    places = max(decimals + power, 0)
    return f"{value / 10.0**power:.{places}f}e{power} ± {u / 10.0**power:.{places}f}e{power}"


def enough_digits(values: Sequence[float | None], least: int = 3, most: int = 6) -> int:
    """Significant digits with which numbers that lie close together differ in two digits, as far as ``most`` allows."""
    known = [value for value in values if value is not None and math.isfinite(value)]
    width = max(known, default=0.0) - min(known, default=0.0)
    if width == 0.0:
        return least
    digits = 2 + math.floor(math.log10(max(abs(value) for value in known))) - math.floor(math.log10(width))
    return min(max(digits, least), most)


def hertz(value: float | None) -> str:
    """A frequency with four digits, zeros kept so that columns compare."""
    return ABSENT if value is None or not math.isfinite(value) else f"{value:#.4g}".rstrip(".")


def percent(share: float | None, digits: int = 2) -> str:
    """A share as a percentage with so many decimals; ``–`` where there is none."""
    return ABSENT if share is None else f"{100 * share:.{digits}f} %"


def unit(si: str) -> str:
    """A unit of the files as it is printed; nothing for a pure number."""
    return _UNIT_SIGNS.get(si, printed(si).replace("^2", "²").replace("^3", "³"))


def amount(value: float | None, si: str, digits: int = 4) -> str:
    """A number with its SI unit."""
    return f"{number(value, digits)} {unit(si)}".rstrip()


def practical(value: float | None, si: str, digits: int = 3) -> str:
    """The same in the unit that test benches use: ms, °, 1/min, kW, mm, MPa.

    Parameters
    ----------
    value : float or None
        SI.
    si : str
        Its unit.
    """
    factor, shown_unit = _PRACTICAL_UNITS.get(si, (1.0, unit(si)))
    return f"{number(None if value is None else factor * value, digits)} {shown_unit}".rstrip()


def change(before: float, after: float) -> str:
    """A relative change in %, as a factor where it is large, or ``unchanged``."""
    if before == 0 or after == 0 or not math.isfinite(after / before):
        return ""
    if not 1 / 3 < after / before < 3:
        return f"× {number(after / before, 3)}"
    relative = 100 * (after / before - 1)
    return "unchanged" if abs(relative) < UNCHANGED_PERCENT else f"{relative:+.3g} %"


def spaced(name: str) -> str:
    """A name of a file without underscores."""
    return name.replace("_", " ")


def component(name: str) -> str:
    """``shafts.side_left.stiffness`` in words: side left, stiffness."""
    name = name.replace("dynamometers.dynamometer", "dynamometer").replace("dynamometers.", "dynamometer ")
    left_out = ("inertias", "shafts", "gears", "rig", "residual_vehicle", "loop")
    return ", ".join(spaced(part) for part in name.split(".") if part not in left_out)


def sentence(parts: Sequence[str]) -> str:
    """Parts joined as in a sentence: a, b and c."""
    parts = list(parts)
    return parts[0] if len(parts) == 1 else f"{enumerated(parts[:-1])} and {parts[-1]}" if parts else ""


def enumerated(parts: Sequence[str]) -> str:
    """Parts one after another: a, b, c; with semicolons where one has a comma of its own."""
    return ("; " if any("," in part for part in parts) else ", ").join(parts)


# --- One look for every figure: fixed colours that colour-blind readers tell apart, figures without pyplot state.

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
    """A figure whose logarithmic axes have plain texts; a notebook shows it without a setting of its own."""

    def _repr_png_(self) -> bytes:
        return image(self, "png")

    def draw(self, renderer: Any) -> None:
        """As :meth:`matplotlib.figure.Figure.draw`."""
        plain_logarithms(self)
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


@cache
def _defaults() -> dict[str, Any]:
    """Matplotlib's own settings: a file matplotlibrc in the working folder does not count."""
    return {name: rcParamsDefault[name] for name in rcParamsDefault if not name.startswith(("backend", "interactive"))}


def styled() -> Any:
    """A context in which axes are made with the settings of this module."""
    return rc_context(_defaults() | SETTINGS)


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
        plain_logarithms(fig)
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


OUTSIDE = re.compile(r'<\?xml.*?\?>|<!DOCTYPE.*?>|<metadata>.*?</metadata>| xmlns(:\w+)?="[^"]*"', re.DOTALL)


def without_head(svg: bytes) -> str:
    """An SVG file as an element of a page."""
    return OUTSIDE.sub("", svg.decode()).strip()


# --- Line styles of vehicle, rig without control and matched rig: a colour and a stroke each, told apart in grey too.

# The vehicle is a broad pale line underneath: a matched rig runs inside it.
LINES: dict[str, dict[str, Any]] = {
    "vehicle": {"color": VEHICLE, "linewidth": 4.6, "linestyle": "-", "label": "vehicle", "zorder": 2.0, "alpha": 0.4},
    "rig": {"color": RIG, "linewidth": 1.2, "linestyle": (0, (6, 2)), "label": "rig without control", "zorder": 2.1},
    "matched": {"color": MATCHED, "linewidth": 1.4, "linestyle": "-", "label": "matched rig", "zorder": 2.3},
    "unmeasured": {
        "color": MATCHED,
        "linewidth": 1.0,
        "linestyle": (0, (2, 2)),
        "label": "matched rig, torque not measured",
        "zorder": 2.2,
    },
}


def legend_above(fig: Any, axes: Any, columns: int = 4, **options: Any) -> None:
    """One legend for the whole figure, above the axes."""
    handles, labels = axes.get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside upper center", ncols=columns, **options)


# --- Ticks of logarithmic axes: few, and with plain numbers; Matplotlib's are formulas, which are slow to set.

LABELLED_RATIO = 200  # high to low end of an axis up to which ticks between decades are labelled
EVEN_RATIO = 3  # up to which ticks are evenly spaced: between 1, 2 and 5 there may be none


def plain_logarithms(fig: Figure) -> None:
    """Ticks of logarithmic axes at 1, 2 and 5 of a decade, all labelled on a short axis; locators that are set stay."""
    for axes in fig.axes:
        for axis in (axes.xaxis, axes.yaxis):
            tickers = axis.major, axis.minor
            if not any(type(ticker.formatter) is LogFormatterSciNotation for ticker in tickers):
                continue
            low, high = sorted(axis.get_view_interval())
            if isinstance(axis.major.locator, LogLocator) and high < EVEN_RATIO * low:
                axis.set_major_locator(MaxNLocator(5))
                axis.set_minor_locator(NullLocator())
            elif not isinstance(axis.minor.locator, NullLocator):
                axis.set_minor_locator(LogLocator(subs=(2, 5)))
            axis.set_major_formatter(StrMethodFormatter("{x:g}"))
            short = high < LABELLED_RATIO * low
            axis.set_minor_formatter(StrMethodFormatter("{x:g}") if short else NullFormatter())


# --- Equations as MathML, which browsers render without any script.

DOTS = ("", "\u0307", "\u0308")  # combining marks above a letter, by number of derivatives
TIMES = '<mo lspace="0" rspace="0.17em">&InvisibleTimes;</mo>'  # apart: a subscript ran into the next factor
LEGEND = (
    "J inertia, b drag, c stiffness, d damping, i ratio, φ angle of an inertia, M torque of an input, "
    "p pedal of a torque map M; a dot is a derivative with respect to time."
)


def equations(system: System) -> dict[str, list[str]]:
    """MathML of ``T``, ``V``, ``D`` and ``motion``; drags and dampings of zero are left out."""
    derived = derive(system)
    zeros = known_zeros(derived, system)
    printer = _Printer(signs(derived))

    def terms(expression: sm.Expr) -> str:
        """Addends one by one, so that a long line may break between them."""
        written = ""
        for addend in expression.xreplace(zeros).as_ordered_terms():
            addend = sm.factor_terms(addend)
            negative = addend.could_extract_minus_sign()
            sign = "−" if negative else "+" if written else ""
            written += f" {sign}&nbsp;{_math(printer.doprint(-addend if negative else addend))}"
        return written

    return {
        "T": [f"{_math('<mi>T</mi>')} = {terms(derived.kinetic_energy)}"],
        "V": [f"{_math('<mi>V</mi>')} = {terms(derived.potential_energy)}"],
        "D": [f"{_math('<mi>D</mi>')} = {terms(derived.dissipation)}"],
        "motion": [f"{terms(equation.lhs)} = {terms(equation.rhs)}" for equation in derived.motion],
    }


class _Printer(MathMLPresentationPrinter):
    """SymPy's printer with the symbols of a drivetrain."""

    def __init__(self, known: Mapping[sm.Symbol, Sign]):
        super().__init__()
        self._signs = known

    def doprint(self, expr: Any) -> str:
        """MathML of an expression, without the enclosing element."""
        written = self._print(expr).toxml().replace("<mo>-</mo>", "<mo>−</mo>")
        return written.replace("<mo>&InvisibleTimes;</mo>", TIMES)

    def _print_MapTorque(self, expr: sm.Expr) -> Any:
        written = self._print_Function(sm.Function("M")(*expr.args[:2]))
        written.replaceChild(self._leaf("mi", "M"), written.firstChild)
        return written

    def _print_Symbol(self, sym: sm.Symbol, style: str = "plain") -> Any:
        if sym not in self._signs:
            return super()._print_Symbol(sym, style)
        sign = self._signs[sym]
        letter = self._leaf("mi", _spaced(sign.letter) + DOTS[sign.derivatives])
        if sign.derivatives:  # browsers set a letter with a combining mark upright by default
            letter.setAttribute("style", "font-style: italic")
        if not sign.component:
            return letter
        subscripted = self.dom.createElement("msub")
        subscripted.appendChild(letter)
        subscripted.appendChild(self._leaf("mtext", _spaced(sign.component)))
        return subscripted

    def _leaf(self, tag: str, text: str) -> Any:
        leaf = self.dom.createElement(tag)
        leaf.appendChild(self.dom.createTextNode(text))
        return leaf


def _math(content: str) -> str:
    return f'<math displaystyle="true"><mrow>{content}</mrow></math>'


def _spaced(name: str) -> str:
    return name.replace("_", "\u00a0")
