"""What tabs are made of: headings, messages, tables, figures, and elements that Panel does not have."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import panel as pn
import param
from bokeh.models import ColumnDataSource, CrosshairTool, HoverTool, Span
from bokeh.plotting import figure
from panel.custom import JSComponent

from matching.explore.signals import MeasuredCurves
from matching.report.common import LIMIT, NOISE, RIG, VEHICLE, component, spaced
from matching.report.page import table as page_table
from modelling.escape import html
from modelling.recordings.readers import READERS

# --- What does the same without the page: a command for the terminal, and lines of Python.


@dataclass(frozen=True)
class Equivalent:
    """A command and the lines of Python that do the same."""

    command: str
    python: str


WRITING = ("commission",)  # functions that write their results themselves


def same(command: str, *given: str | Sequence[str], out: str | Path, **options: str | int | list[str]) -> Equivalent:
    """A command with its files and options; options that are empty are left out."""
    words, options = [command], {name: value for name, value in options.items() if value != ""}
    for each in given:
        words += [each] if isinstance(each, str) else each
    for name, value in options.items():
        words += [f"--{name}", *(value if isinstance(value, list) else [str(value)])]
    if command in WRITING:
        options["out"] = str(out)
    shown = [*map(_text, given), *(f"{name}={_text(value)}" for name, value in options.items())]
    python = f"import rigmatch as rm\nresult = rm.{command}({', '.join(shown)})\nprint(result)"
    return Equivalent(shlex.join(("rigmatch", *words, "--out", str(out))), python)


def _text(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)


# --- Elements of the page that Panel does not have, each with its script and style beside this file.


def beside_this(name: str) -> str:
    """The text of a script or style."""
    return (Path(__file__).parent / name).read_text(encoding="utf-8")


class DrivetrainView(JSComponent):
    """A drawing whose parts can be picked by mouse and keys: as wide as the page, larger on request.

    ``svg`` and ``marks`` are those of :mod:`matching.report.drivetrain`; ``picked`` is the last part, with a count that
    makes it new; without ``reacts`` no part is a button. ``drawn`` is the last shaft that was drawn by dragging, with a
    count: two inertias, or one and ``-`` for a new one. ``undone`` counts Ctrl-Z outside a field.
    """

    label = param.String(default="the drivetrain")
    svg = param.String(default="")
    marks = param.Dict(default={})
    reacts = param.Boolean(default=False)
    picked = param.String(default="")
    drawn = param.String(default="")
    undone = param.Integer(default=0)
    _esm = beside_this("drivetrain.js")
    _stylesheets = [beside_this("drivetrain.css")]


class Slider(JSComponent):
    """The browser's own slider, which says its name and value to screen readers and moves by the arrow keys.

    ``label`` is what it sets, with its unit.
    """

    label = param.String(default="value")
    start = param.Number(default=0.0)
    end = param.Number(default=1.0)
    step = param.Number(default=0.01)
    value = param.Number(default=0.0)
    _esm = beside_this("slider.js")
    _stylesheets = [beside_this("slider.css")]


class StepBar(JSComponent):
    """The steps below each other, each with its state in a few words; screen readers know them as tabs.

    ``active`` is the number of the one that is open.
    """

    names = param.List(default=[], item_type=str)
    states = param.List(default=[], item_type=str)
    active = param.Integer(default=0)
    _esm = beside_this("tabs.js")
    _stylesheets = [beside_this("tabs.css")]


class Alive(JSComponent):
    """Covers the page once the program behind it has ended, and fits it to the screen."""

    _esm = beside_this("alive.js")


# --- Pieces that every tab uses: headings, messages, tables, the box with command and Python.

WIDE = "stretch_width"
AS_HIGH_AS_CONTENT = {"max-height": "none"}
# Panes have a shadow tree of their own, which the style sheet of the page does not reach.
PANE_STYLE = beside_this("pane.css")
# the arrow of a choice, which Bokeh draws black in any theme
CHOICE_STYLE = """
@media (prefers-color-scheme: dark) { select:not([multiple]).bk-input { background-image: url('data:image/svg+xml;utf8,\
<svg viewBox="0 0 25 20" xmlns="http://www.w3.org/2000/svg"><path d="M 0,0 25,0 12.5,20 Z" fill="white" /></svg>'); } }
"""
pn.widgets.Select.stylesheets = [CHOICE_STYLE]  # of all that have no style of their own


def heading(text: str, level: int = 2) -> pn.pane.HTML:
    """A heading."""
    return pn.pane.HTML(f"<h{level}>{html(text)}</h{level}>", sizing_mode=WIDE, margin=(0, 5), stylesheets=[PANE_STYLE])


def opening(name: str, lead: str, *buttons: Any) -> pn.FlexBox:
    """How every step begins: its name, what it is for in a sentence, and its main buttons at the right."""
    words = pn.pane.HTML(
        f'<h1>{html(name)}</h1><p class="lead">{html(lead)}</p>', styles={"flex": "1 1 420px"}, margin=(0, 5),
        stylesheets=[PANE_STYLE],
    )  # fmt: skip
    right = {"flex": "0 1 auto", "width": "max-content", "max-width": "100%", "margin-left": "auto"}
    main = pn.FlexBox(*buttons, styles=right, sizing_mode=None)
    return pn.FlexBox(words, main, align_items="center", justify_content="space-between", sizing_mode=WIDE)


def plain_button(name: str, *, visible: bool = True) -> pn.widgets.Button:
    """A button beside the main one, as wide as its name."""
    return pn.widgets.Button(
        name=name,
        visible=visible,
        stylesheets=[":host { min-width: max-content; } .bk-btn { border: 1px solid #7a8591 !important; }"],
    )


def strong(text: str) -> pn.pane.HTML:
    """The title of a box that can be folded."""
    return pn.pane.HTML(f"<b>{html(text)}</b>", margin=(0, 5), stylesheets=[PANE_STYLE])


def paragraph(text: str) -> pn.pane.HTML:
    """A paragraph."""
    return pn.pane.HTML(f"<p>{html(text)}</p>", sizing_mode=WIDE, margin=(0, 5), stylesheets=[PANE_STYLE])


class Message(pn.pane.HTML):
    """What just happened, read out by screen readers; an error where ``wrong``."""

    def __init__(self) -> None:
        super().__init__('<p role="status"></p>', sizing_mode=WIDE, margin=(0, 5), stylesheets=[PANE_STYLE])

    def say(self, text: str, *, wrong: bool = False) -> None:
        """Show a line; files in it by their names from the folder that the page was started in, a key in words."""
        text = with_short_paths(key_in_words(text) if wrong else text)
        kind = ' class="wrong"' if wrong else ""
        self.object = f'<p role="status"{kind}>{html(text)}</p>'


KEYS_IN_WORDS = {  # of budgets and fidelity cases, where the key says too little
    "half_width": "half-width", "degrees_of_freedom": "degrees of freedom", "coverage": "probability of the interval",
    "coverage_factor": "coverage factor k", "expanded_uncertainty": "expanded uncertainty U",
    "f_max": "largest relevant frequency [Hz]", "nrmse_fidelity": "fidelity R_NRMSE", "delay": "delay [s]",
    "range": "range of the signal",
}  # fmt: skip
# where an error is: in which file, and at which key of it
_PLACE = re.compile(r"(?P<file>[^\s:]+\.toml: )?(?P<key>[A-Za-z_]\w*(?:\.[\w.']+|\[\d+\])*): ")
_NUMBER = re.compile(r"\[(\d+)\]")
_TABLES = ("inputs.", "move.", "effects.")  # which the words of a field leave out


def key_in_words(text: str) -> str:
    """An error whose place is a key of an open file: the key as the page calls its field, without the file."""
    found = _PLACE.match(text)
    if not found or not (found["file"] or "." in found["key"] or "_" in found["key"]):
        return text
    if not found["file"] and Path(found["key"]).suffix.lower() in (".toml", ".json", ".fmu", *READERS):
        return text  # a file itself
    key = _NUMBER.sub(r".\1", found["key"].replace("'", ""))
    key = re.sub(r"\.(\d+)(?=\.|$)", lambda number: f".{int(number[1]) + ('[' not in found['key'])}", key)
    key = next((key.removeprefix(table) for table in _TABLES if key.startswith(table)), key)
    table, dot, last = key.rpartition(".")
    words = component(f"{table}{dot}{KEYS_IN_WORDS.get(last, last)}") or spaced(key)
    return f"{words[:1].upper()}{words[1:]}: {text[found.end() :]}"


_ABSOLUTE = re.compile(r"(?<![\w·²³)])(?:/[^\s/:'\",;]+){2,}")  # a path from the root


def with_short_paths(text: str) -> str:
    """A text whose files and folders are named from the folder that the page was started in, others by their name."""

    def short(found: re.Match[str]) -> str:
        path = Path(found[0])
        if not path.exists() and not path.parent.is_dir():
            return found[0]
        return str(path.relative_to(Path.cwd())) if path.is_relative_to(Path.cwd()) else path.name

    return _ABSOLUTE.sub(short, text)


def table(rows: Sequence[Mapping[str, str]], caption: str) -> str:
    """Rows that share their keys as a table (HTML) that scrolls where it is wider than the page."""
    scrolls = f'class="scrolls" tabindex="0" role="region" aria-label="{html(caption)}"'
    return f"<div {scrolls}>{page_table(rows, caption)}</div>"


def report_frame(title: str, *, address: str = "", page: str = "") -> str:
    """A report on the page, its first screen in sight: one that is served, or the text of its page."""
    source = f'src="{html(address)}"' if address else f'srcdoc="{html(page)}"'
    link = f'<p><a href="{html(address)}" target="_blank">Open the report</a></p>' if address else ""
    return f'{link}<iframe title="{html(title)}" {source}></iframe>'


def beside(main: Sequence[Any], side: Sequence[Any]) -> Any:
    """Fields at the side of what they change, below it on a narrow screen.

    As high as their content: the layout's own limit, the height of the window, would let what follows lie over them.
    """
    wide = {"flex": "1 1 600px", "min-width": "min(100%, 340px)"} | AS_HIGH_AS_CONTENT
    narrow = {"flex": "0 1 340px", "min-width": "min(100%, 320px)"} | AS_HIGH_AS_CONTENT
    return pn.FlexBox(
        pn.Column(*main, styles=wide), pn.Column(*side, styles=narrow), flex_wrap="wrap", gap="0 20px",
        align_items="flex-start", sizing_mode=WIDE, styles=AS_HIGH_AS_CONTENT,
    )  # fmt: skip


def offer(chooser: Any, options: dict[str, Any], wanted: Any = None) -> None:
    """Other options for a chooser; the choice stays where it is one of them, and nothing is wanted."""
    values = list(options.values())
    first = values[0] if values else None
    chosen = wanted if wanted is not None else chooser.value if chooser.value in values else first
    if options != chooser.options or chosen != chooser.value:
        chooser.param.update(options=options, value=chosen)


class EquivalentBox(pn.pane.HTML):
    """The command and the lines of Python, to copy."""

    def __init__(self, equivalent: Equivalent) -> None:
        super().__init__(sizing_mode=WIDE, margin=(10, 5), stylesheets=[PANE_STYLE])
        self.set(equivalent)

    def set(self, equivalent: Equivalent) -> None:
        """Show another one."""
        self.object = (
            '<details open class="same"><summary>The same without this page</summary>'
            f'<pre tabindex="0" aria-label="Command">{html(equivalent.command)}</pre>'
            f'<pre tabindex="0" aria-label="Python">{html(equivalent.python)}</pre></details>'
        )


# --- Bokeh figures of the page: responses with a cursor, signals.

TOOLS = "pan,wheel_zoom,box_zoom,reset,save"
HEIGHT = 260  # px


def plain_figure(title: str, x: str, y: str, **options: Any) -> Any:
    """An empty figure as wide as the page."""
    fig = figure(
        title=title, x_axis_label=x, y_axis_label=y, tools=TOOLS, active_drag="pan", height=HEIGHT,
        sizing_mode="stretch_width", output_backend="canvas", toolbar_location="above", **options,
    )  # fmt: skip
    fig.toolbar.logo = None
    fig.toolbar.autohide = False
    return fig


class ResponseFigures:
    """Modulus and phase of one response: of the file, with what is tried, and measured."""

    def __init__(self) -> None:
        self.before, self.now, self.measured = (ColumnDataSource({"f": [], "size": [], "phase": []}) for _ in range(3))
        cursor = Span(dimension="height", line_color=LIMIT, line_width=1)
        self.modulus = plain_figure("Modulus", "frequency [Hz]", "modulus", x_axis_type="log", y_axis_type="log")
        self.phase = plain_figure(
            "Phase", "frequency [Hz]", "phase [°]", x_axis_type="log", x_range=self.modulus.x_range
        )
        for fig, key, unit in ((self.modulus, "size", ""), (self.phase, "phase", "°")):
            fig.line("f", key, source=self.before, color=VEHICLE, line_width=4, alpha=0.4, legend_label="file")
            line = fig.line("f", key, source=self.now, color=RIG, line_width=1.6, legend_label="tried")
            fig.scatter("f", key, source=self.measured, color=NOISE, size=5, legend_label="measured")
            tips = [("f", "@f{0.000} Hz"), (key, f"@{key}{{0.0000}} {unit}")]
            fig.add_tools(HoverTool(renderers=[line], mode="vline", tooltips=tips), CrosshairTool(overlay=cursor))
            fig.legend.click_policy = "hide"
            fig.legend.location = "bottom_left"

    def show(self, source: ColumnDataSource, frequencies: np.ndarray, values: np.ndarray) -> None:
        """Put ``values`` (f,) at ``frequencies`` (f,), Hz, into one of the sources."""
        source.data = {"f": frequencies, "size": np.abs(values), "phase": np.degrees(np.angle(values))}

    def show_measured(self, curves: MeasuredCurves | None, sensor: str, source: str) -> None:
        """Put a measured response into its source, or nothing."""
        known = curves is not None and sensor in curves.sensors and source in curves.inputs
        for fig in (self.modulus, self.phase):
            fig.legend.items[-1].visible = known
        if curves is None or not known:
            self.show(self.measured, np.empty(0), np.empty(0, complex))
            return
        values = curves.values[:, curves.sensors.index(sensor), curves.inputs.index(source)]
        kept = np.isfinite(values)
        self.show(self.measured, curves.frequencies[kept], values[kept])
