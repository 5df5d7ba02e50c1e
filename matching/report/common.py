"""What every figure, page and text shares: colours, numbers and units in words, tables, page templates."""

from __future__ import annotations

import base64
import csv
import functools
import hashlib
import io
import itertools
import math
import os
import re
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import quote
from warnings import catch_warnings, simplefilter

import numpy as np
import sympy as sm
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape
from matplotlib import rc_context, rcParamsDefault
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatterSciNotation, LogLocator, NullFormatter, StrMethodFormatter
from sympy.printing.mathml import MathMLPresentationPrinter

from matching.match.case import Case
from modelling import display
from modelling.equations.lagrange import Sign, derive, known_zeros, signs
from modelling.errors import VERSION
from modelling.linear.state_space import Response
from modelling.recordings.read import csv_text
from modelling.simulation.stepping import Simulation
from modelling.system import System
from modelling.toml import read_toml

# --- Tables that a page lets its reader save (CSV).

DIGITS = 7  # of every number


def csv_table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """Rows below a head; numbers with seven digits, nothing where there is no value.

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
    return f"{value:.{DIGITS}g}"


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
    """A unit of the files as it is printed."""
    return _UNIT_SIGNS.get(si, si.replace("*", "·").replace("^2", "²").replace("^3", "³"))


def amount(value: float | None, si: str, digits: int = 4) -> str:
    """A number with its SI unit."""
    return f"{number(value, digits)} {unit(si)}".rstrip()


def practical(value: float | None, si: str, digits: int = 3) -> str:
    """The same in the unit that test benches use: ms, °, 1/min, kW.

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
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}" if parts else ""


def counted(count: int, singular: str, plural: str = "") -> str:
    """A number with its noun: ``1 point``, ``2 points``; ``plural`` where it is not the singular with an s."""
    return f"{count} {singular}" if count == 1 else f"{count} {plural or singular + 's'}"


# --- Pages are Jinja templates; a page needs no other file.

UPRIGHT_WIDTH, ACROSS_WIDTH, ACROSS_HEIGHT = 515.0, 760.0, 411.0  # points for a figure on A4, margins and caption off
SMALLEST_LETTERS = 4.5  # points on paper; a figure laid across takes a page of its own, so only where it has to
WORTH_TURNING = 1.25  # larger by this at least
READABLE = " ,;:/?@=+$()*!.-_~|"  # letters and signs that a data URI in quotation marks may hold as they are


@functools.cache
def environment() -> Environment:
    """Templates of this package with the filters for numbers, units and names."""
    templates = Environment(loader=PackageLoader("matching.report"), autoescape=True, undefined=StrictUndefined)
    templates.filters |= {
        "number": number,
        "unit": unit,
        "practical": practical,
        "hertz": hertz,
        "component": component,
        "in_style": in_style,
        "explained": explained,
    }
    templates.tests["wide"] = is_wide
    return templates


TERMS = {  # of the field of control, for readers from the field of test beds; the longest of two that begin alike first
    "modulus margin": "least distance of the open loop from −1: 1 is as far as a loop without control, 0 is unstable",
    "damping ratio": "share of the critical damping: 0.02 rings for some ten periods",
    "drawn beds": "beds whose values are drawn within what [uncertainty] says is not known exactly",
    "response error": "root mean square of |log(H_rig/H_vehicle)| over band and compared functions; 0.1 is 10 % or 6°",
    "unmeasured torques": "torques that no sensor tells the controller, such as a brake on the shaft",
    "target mode": "mode of the vehicle that the rig has to have",
    "roll-off": "from this frequency on the loop hardly acts, so that what no model holds cannot make it unstable",
    "worst bed": "the least damped bed that a search found within [uncertainty]",
    "dead time": "time from a measured torque to the torque at the dynamometer's air gap",
    "sampled loop": "controller, delay line and bed, exactly as the sampled controller sees them",
    "R_XiL": "XiL fidelity (Eq. 16): 100 % is a test that cannot be told from the road",
    "coverage": "share of cases in which the interval holds the true value",
}


_BY_LOWER = {term.lower(): words for term, words in TERMS.items()}
_TERM = re.compile("|".join(rf"\b{re.escape(term)}\b" for term in TERMS), re.IGNORECASE)


def explained(text: str) -> Markup:
    """A text as HTML whose terms say what they mean where they are pointed at."""
    return Markup(
        _TERM.sub(
            lambda term: f'<abbr title="{escape(_BY_LOWER[term[0].lower()])}">{term[0]}</abbr>', str(escape(text))
        )
    )


def embedded(content: bytes) -> str:
    """A figure as a data URI, so that the page needs no other file."""
    kind = "png" if content.startswith(b"\x89PNG") else "svg+xml"
    return f"data:image/{kind};base64,{base64.b64encode(content).decode()}"


def in_address(text: str, kind: str) -> str:
    """A text of some kind as a data URI: a sixth shorter than with base64."""
    return f"data:{kind};charset=utf-8,{quote(text, safe=READABLE)}"


def in_style(text: str) -> str:
    """A text within quotation marks of a style sheet: all but letters, digits and spaces by their numbers."""
    return "".join(each if each.isalnum() or each == " " else f"\\{ord(each):x} " for each in text)


def is_wide(address: str) -> bool:
    """Whether a figure, a data URI of :func:`embedded`, is to be printed on paper laid across to be read."""
    content = address.removeprefix("data:image/svg+xml;base64,")
    if content == address:
        return False
    svg = base64.b64decode(content).decode(errors="replace")
    size = re.search(r'<svg[^>]*? width="([\d.]+)pt" height="([\d.]+)pt"', svg)
    letters = [float(points) for points in re.findall(r"font(?:-size)?: ?([\d.]+)px", svg)]
    if size is None or not letters:
        return False
    width, height = (float(text) for text in size.groups())
    upright, across = min(UPRIGHT_WIDTH / width, 1.0), min(ACROSS_WIDTH / width, ACROSS_HEIGHT / height, 1.0)
    return upright * min(letters) < SMALLEST_LETTERS and across >= WORTH_TURNING * upright


# --- Numbers at logarithmic axes as plain text: Matplotlib's are formulas, which are slow to set.

FORMULA = re.compile(r"\$\\mathdefault\{(.*)\}\$")
POWER = re.compile(r"\^\{(-?\d+)\}")
SUPERSCRIPTS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


class PlainPowers(LogFormatterSciNotation):
    """The same numbers without formulas, such as 10⁻³ and 2×10⁻³."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        """The text at a tick."""
        return plain(super().__call__(x, pos))


def plain(text: str) -> str:
    """A number that Matplotlib wrote as a formula; any other text as it is."""
    formula = FORMULA.fullmatch(text)
    if formula is None:
        return text
    with_times = formula[1].replace(r"\times", "×").replace("-", "−")
    return POWER.sub(lambda power: power[1].translate(SUPERSCRIPTS), with_times.replace("^{−", "^{-"))


def write_powers_plainly(fig: Figure) -> None:
    """No formulas at the axes of a figure."""
    for axes in fig.axes:
        for axis in (axes.xaxis, axes.yaxis):
            for ticker in (axis.major, axis.minor):
                if type(ticker.formatter) is LogFormatterSciNotation:
                    ticker.formatter.__class__ = PlainPowers


# --- Ticks and the room that their texts need, worked out once for a size of the axes: Matplotlib does it four times.

REPEATED = ("_update_ticks", "_get_ticklabel_bboxes")  # of an axis; without these names nothing is kept


@contextmanager
def ticks_kept(fig: Figure) -> Iterator[None]:
    """While a figure is laid out and drawn its ticks are those of before, unless limits, size or place change."""
    axes_of_figure = [axis for axes in fig.axes for axis in (axes.xaxis, axes.yaxis)]
    changed = [(axis, name) for axis in axes_of_figure for name in REPEATED if hasattr(axis, name)]
    for axis, name in changed:
        setattr(axis, name, _kept(axis, getattr(axis, name)))
    try:
        yield
    finally:
        for axis, name in changed:
            delattr(axis, name)


def _kept(axis: Any, method: Callable[..., Any]) -> Callable[..., Any]:
    last: list[Any] = [None, None]

    def ask(*arguments: Any, **options: Any) -> Any:
        state = (
            axis.axes.bbox.bounds, axis.get_figure(root=True).dpi, tuple(axis.get_view_interval()), axis.get_scale(),
            axis.major.locator, axis.major.formatter, [id(argument) for argument in arguments],
        )  # fmt: skip
        if state != last[0]:
            last[:] = state, method(*arguments, **options)
        return last[1]

    return ask


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


# --- Ticks of a logarithmic axis: few, and with plain numbers.

LABELLED_RATIO = 200  # high to low end of an axis up to which ticks between decades are labelled


def plain_ticks(axis: Any) -> None:
    """Ticks at 1, 2 and 5 of a decade (more are slow to draw and crowd), all labelled on a short axis.

    Parameters
    ----------
    axis : matplotlib.axis.Axis
        A logarithmic axis whose limits are set.
    """
    low, high = sorted(axis.get_view_interval())
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_locator(LogLocator(subs=(2, 5)))
    axis.set_minor_formatter(StrMethodFormatter("{x:g}") if high < LABELLED_RATIO * low else NullFormatter())


# --- Equations as MathML, which browsers render without any script.

DOTS = ("", "\u0307", "\u0308")  # combining marks above a letter, by number of derivatives
TIMES = '<mo lspace="0" rspace="0.17em">&InvisibleTimes;</mo>'  # apart: a subscript ran into the next factor
LEGEND = (
    "J inertia, b drag, c stiffness, d damping, i ratio, φ angle of an inertia, M torque of an input; a dot is a "
    "derivative with respect to time."
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


# --- Where a result comes from: date, version, seed, input files with checksums, the case as it was run.


@dataclass(frozen=True)
class Provenance:
    """What a match was made from.

    Attributes
    ----------
    date : str
        Day of the run (UTC), or that of ``SOURCE_DATE_EPOCH`` where that is set.
    version : str
    seed : int or None
        None where nothing was drawn.
    files : tuple of (str, str)
        Path and SHA-256 of every input file, the case file first; empty where the case came from no file.
    """

    date: str
    version: str
    seed: int | None
    files: tuple[tuple[str, str], ...]

    def to_dict(self) -> dict[str, Any]:
        """``made_by`` of ``result.json``."""
        case, checksum = self.files[0] if self.files else ("", "")
        files = [{"file": file, "sha256": sum_} for file, sum_ in self.files]
        return {
            "version": self.version, "date": self.date, "case": case, "sha256": checksum, "seed": self.seed,
            "files": files,
        }  # fmt: skip


def provenance(case: Case, seed: int) -> Provenance:
    """Of a case that was read from a file, and the seed of its match."""
    return made_from(case.path, seed, ("vehicle", "rig"))


def with_recordings(made: Provenance, recordings: Iterable[tuple[str, str | Path]]) -> Provenance:
    """The same with recordings, each by its name and by the file that was read."""
    return replace(made, files=(*made.files, *((name, _checksum(Path(file))) for name, file in recordings)))


def _checksum(file: Path) -> str:
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def made_from(file: str | Path, seed: int | None, names: Sequence[str] = ()) -> Provenance:
    """Of an input file (TOML; empty for none), of the files that it names under the keys ``names``, and a seed."""
    now = float(os.environ.get("SOURCE_DATE_EPOCH") or time.time())
    date = time.strftime("%Y-%m-%d", time.gmtime(now))
    path = Path(file)
    if not file or not path.is_file():
        return Provenance(date, VERSION, seed, ())
    content = read_toml(path) if names else {}
    files = [path, *(path.parent / content[key] for key in names if isinstance(content.get(key), str))]
    checked = tuple((str(each), _checksum(each)) for each in files if each.is_file())
    return Provenance(date, VERSION, seed, checked)


# --- A line of the lists that a report begins with.


@dataclass(frozen=True)
class ScreenPoint:
    """One line of a list, why it stands there, and the command that does it."""

    text: str
    reason: str = ""
    command: str = ""


# --- A small table, for a notebook and in print.

_TABLE = (
    "{% if title %}<p><b>{{ title }}</b></p>{% endif %}{% if rows %}<table><tr>{% for name in rows[0] %}"
    "<th>{{ name }}</th>{% endfor %}</tr>{% for row in rows %}<tr>{% for cell in row.values() %}<td>{{ cell }}</td>"
    "{% endfor %}</tr>{% endfor %}</table>{% endif %}"
)


def table(rows: Sequence[Mapping[str, Any]], title: str = "") -> str:
    """HTML of rows that share their keys."""
    return environment().from_string(_TABLE).render(rows=rows, title=title)


def aligned(rows: Sequence[Mapping[str, Any]], title: str = "") -> str:
    """Rows that share their keys, in columns of text."""
    cells = [[*rows[0]], *([str(cell) for cell in row.values()] for row in rows)] if rows else []
    widths = [max(map(len, column)) for column in zip(*cells)]
    text = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths)).rstrip() for row in cells]
    return "\n".join([title, *text] if title else text)


def preformatted(text: str) -> str:
    """HTML of text that is set in columns."""
    return environment().from_string("<pre>{{ text }}</pre>").render(text=text)


# --- Views of frequency responses: amplitude and phase, and where each is largest.


@display.plot.register
def plot_response(response: Response) -> Figure:
    """Amplitude and phase of every sensor, a column an input."""
    columns = len(response.inputs)
    with styled():
        fig = figure(max(7.0, 3.4 * columns), 5.4)
        grid = fig.subplots(2, columns, sharex=True, sharey="row", height_ratios=[2, 1], squeeze=False)
        for source, (amplitude, phase) in zip(response.inputs, grid.T, strict=True):
            for place, sensor in enumerate(response.sensors):
                values, look = response[sensor, source], curve(place)
                amplitude.loglog(response.frequencies, np.abs(values), label=spaced(sensor), **look)
                phase.semilogx(response.frequencies, np.degrees(np.unwrap(np.angle(values))), **look)
            amplitude.set_title(f"to {spaced(source)}", fontsize=9)
            phase.set_xlabel("frequency in Hz")
        grid[0, 0].set_ylabel("amplitude in SI unit\nof the sensor per N·m")
        grid[1, 0].set_ylabel("phase in °")
        fig.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=7)
    return fig


@display.files.register
def response_files(response: Response, folder: str, made: Any = None) -> display.ResultFiles:
    """Modulus and phase over frequency as CSV and as a figure; no result file, as JSON has no complex numbers."""
    head, columns = ["frequency [Hz]"], [response.frequencies]
    for sensor, source in itertools.product(response.sensors, response.inputs):
        head += [f"{sensor} / {source}, modulus [SI per N*m]", f"{sensor} / {source}, phase [deg]"]
        columns += [np.abs(response[sensor, source]), np.degrees(np.angle(response[sensor, source]))]
    others: dict[str, str | bytes] = {
        "response.csv": csv_table(head, zip(*columns, strict=True)),
        "response.svg": image(plot_response(response)),
    }
    return "", {}, others


@display.text.register
def response_text(response: Response) -> str:
    """Where every response is largest."""
    return aligned(_response_rows(response))


@display.html.register
def response_html(response: Response) -> str:
    """The result as HTML for a notebook."""
    return table(_response_rows(response))


def _response_rows(response: Response) -> list[dict[str, str]]:
    rows = []
    for sensor in response.sensors:
        for source in response.inputs:
            size = np.abs(response[sensor, source])
            rows.append(
                {
                    "sensor": sensor,
                    "input": source,
                    "largest": f"{size.max():.4g}",
                    "at [Hz]": f"{response.frequencies[int(size.argmax())]:.4g}",
                }
            )
    return rows


# --- Views of a simulation: every sensor reading over time, with the measured one behind it if there is one.

ROW_HEIGHT = 1.5  # inches


def simulation_figure(simulation: Simulation, measured: Mapping[str, np.ndarray] | None = None) -> Figure:
    """Every reading over time, a row each.

    Parameters
    ----------
    simulation : Simulation
    measured : mapping of str to ndarray (t,), optional
        Recorded readings by sensor, at the times of the simulation.
    """
    measured = measured or {}
    count = max(1, len(simulation.readings))
    with styled():
        fig = figure(7.0, 1.0 + ROW_HEIGHT * count)
        rows = fig.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
        for axes, (name, values) in zip(rows, simulation.readings.items()):
            if name in measured:
                read = np.isfinite(measured[name])  # a slower channel has no reading at most times
                axes.plot(
                    simulation.time[read], measured[name][read], color=LIMIT, linewidth=3.2, alpha=0.35,
                    label="recorded",
                )  # fmt: skip
            axes.plot(simulation.time, values, color=VEHICLE, linewidth=0.8, label="simulated")
            axes.set_ylabel(f"{spaced(name)}\nin {unit(simulation.units[name])}")
            axes.margins(x=0)
        rows[-1].set_xlabel("time in s")
        if measured:
            entries = max((axes.get_legend_handles_labels() for axes in rows), key=lambda entry: len(entry[0]))
            fig.legend(*entries, loc="outside upper right", ncols=2)
        fig.align_ylabels()
    return fig


@display.plot.register
def plot_simulation(simulation: Simulation) -> Figure:
    """Every reading over time."""
    return simulation_figure(simulation)


@display.files.register
def simulation_files(
    simulation: Simulation, folder: str = "", made: Any = None, measured: Mapping[str, np.ndarray] | None = None
) -> display.ResultFiles:
    """Every reading over time as CSV and as a figure, recorded ones (t,) by sensor behind them; no result file."""
    others: dict[str, str | bytes] = {"simulated.csv": csv_text(simulation.time, simulation.readings, simulation.units)}
    if simulation.readings:
        others["simulated.svg"] = image(simulation_figure(simulation, measured))
    return "", {}, others


@display.text.register
def simulation_text(simulation: Simulation) -> str:
    """Range of every reading."""
    return aligned(_simulation_rows(simulation), _title(simulation))


@display.html.register
def simulation_html(simulation: Simulation) -> str:
    """The text of the result as HTML for a notebook."""
    return table(_simulation_rows(simulation), _title(simulation))


def _title(simulation: Simulation) -> str:
    return f"{len(simulation.time)} samples over {simulation.time[-1] - simulation.time[0]:g} s"


def _simulation_rows(simulation: Simulation) -> list[dict[str, str]]:
    return [
        {
            "reading": name,
            "from": f"{values.min():.4g}",
            "to": f"{values.max():.4g}",
            "unit": unit(simulation.units[name]),
        }
        for name, values in simulation.readings.items()
    ]


# --- The page of a study: verdict, what to do and why, figures that act, their data, tables; one file without network.


@dataclass(frozen=True)
class PageTable:
    """A table below the figures: rows share their keys; the note says how to read it."""

    heading: str
    rows: Sequence[Mapping[str, str]]
    note: str = ""


@dataclass(frozen=True)
class StudyPage:
    """What a page says.

    Attributes
    ----------
    title, status, answer : str
        ``status`` is a word or a number in a frame before the answer, one sentence; ``good`` colours it.
    first_screen : mapping of str to sequence of ScreenPoint
        Lists by their heading, three of them side by side.
    captions : mapping of str to str
        By the figures' names.
    tables : sequence of PageTable
    notes : sequence of str
    """

    title: str
    status: str
    answer: str
    good: bool
    first_screen: Mapping[str, Sequence[ScreenPoint]]
    captions: Mapping[str, str]
    tables: Sequence[PageTable] = ()
    notes: Sequence[str] = ()


@dataclass(frozen=True)
class PageFigures:
    """Figures of a page by name: pictures (SVG), those that act in the browser, and their data (CSV)."""

    images: Mapping[str, bytes]
    moving: Mapping[str, str] = field(default_factory=dict)
    data: Mapping[str, str] = field(default_factory=dict)


def study_page(page: StudyPage, figures: PageFigures, made: Provenance | None = None) -> str:
    """The page as HTML; ``made`` says what it was made from."""
    values = {
        "title": page.title,
        "page": page,
        "figures": {name: embedded(content) for name, content in figures.images.items()},
        "captions": {name: page.captions.get(name, "") for name in figures.images},
        "moving": figures.moving,
        "data": {name: in_address(text, "text/csv") for name, text in figures.data.items()},
        "made": made,
    }
    return environment().get_template("study.html").render(values)
