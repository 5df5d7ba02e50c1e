"""What every tab uses: commands as processes, live models, maps, fields that are edited, undo and saving."""

from __future__ import annotations

import contextlib
import json
import os
import shlex
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from time import monotonic
from typing import Any, NamedTuple

import numpy as np
import panel as pn
import param
from bokeh.models import ColumnDataSource, CrosshairTool, HoverTool, Span
from bokeh.plotting import figure
from panel.custom import JSComponent
from scipy.interpolate import RegularGridInterpolator

from matching.bed.measured import estimated_response, spectra
from matching.channel_names import Suggestion, channel_file, suggestions, time_column
from matching.explore.files import Document, ModelDocument, Workspace
from matching.progress import PROGRESS_ALWAYS
from matching.report.common import LIMIT, NOISE, RIG, VEHICLE, decimated
from matching.report.drivetrain import Sketch, case_drawings, drawing, sketch
from matching.report.page import table as page_table
from modelling.equations.casadi_code import compiled
from modelling.errors import InputError
from modelling.escape import file_name, html
from modelling.linear.linearise import linearise
from modelling.linear.state_space import Response, response
from modelling.modal.modes import LARGEST_WITH_ALL_MODES, damped_modes_of, modes_of
from modelling.modal.result import Mode, Modes
from modelling.recordings.read import Channel, read_recording
from modelling.recordings.readers import read_table
from modelling.recordings.recording import Recording
from modelling.recordings.table import Table
from modelling.system import Quantity, System
from modelling.units import factor
from modelling.writing import write_all

# --- What does the same without the page: a command for the terminal, and lines of Python.


@dataclass(frozen=True)
class Equivalent:
    """A command and the lines of Python that do the same."""

    command: str
    python: str


def same(command: str, *given: str | Sequence[str], out: str | Path, **options: str | int) -> Equivalent:
    """A command with its files and options; options that are empty are left out."""
    words, options = [command], {name: value for name, value in options.items() if value != ""}
    for each in given:
        words += [each] if isinstance(each, str) else each
    for name, value in options.items():
        words += [f"--{name}", str(value)]
    shown = [*map(_text, given), *(f"{name}={_text(value)}" for name, value in options.items())]
    python = f"import rigmatch as rm\nresult = rm.{command}({', '.join(shown)})\nprint(result)"
    return Equivalent(shlex.join(("rigmatch", *words, "--out", str(out))), python)


def _text(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False)


# --- A command of rigmatch in a process of its own, as a terminal would run it: its progress is read, it can be ended.

ROOT = Path(__file__).parents[2]  # where `matching` is imported from, installed or not


@dataclass(frozen=True)
class Ended:
    """How a command ended: its exit code, the result object where it answered, else its last line on standard error."""

    code: int
    result: dict[str, Any]
    line: str

    @property
    def cancelled(self) -> bool:
        """Whether it was asked to end."""
        return self.code in [own for number in (signal.SIGINT, signal.SIGTERM) for own in (128 + number, -number)]


class Job:
    """A running command.

    Parameters
    ----------
    words : sequence of str
        As on the command line, without ``rigmatch`` and ``--json``.
    tell : callable of str, optional
        Called from another thread with every line of progress.
    done : callable of Ended, optional
        Called from that thread when it has ended.
    """

    def __init__(
        self,
        words: Sequence[str],
        tell: Callable[[str], None] | None = None,
        done: Callable[[Ended], None] | None = None,
    ):
        self.words = tuple(words)
        self._tell, self._done = tell or (lambda _: None), done or (lambda _: None)
        self._last_line, self._out = "", b""
        paths = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "matching", *words, "--json"],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            env=os.environ | {"PYTHONPATH": paths, PROGRESS_ALWAYS: "1"},
        )  # fmt: skip
        self._ended: Ended | None = None
        self._reader = threading.Thread(target=self._follow, daemon=True)
        self._reader.start()

    @property
    def running(self) -> bool:
        """Whether it has not ended yet."""
        return self._ended is None

    def cancel(self) -> None:
        """Ask it to end, and return at once; nothing of its results is left half written."""
        if self._process.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                self._process.send_signal(signal.SIGTERM)

    def wait(self, seconds: float | None = None) -> Ended:
        """How it ended, when it has."""
        self._reader.join(seconds)
        if self._ended is None:
            raise TimeoutError(f"{self.words[0]} is still running")
        return self._ended

    def _follow(self) -> None:
        answer = threading.Thread(target=self._take_answer, daemon=True)
        answer.start()
        assert self._process.stderr is not None
        line = b""
        while piece := self._process.stderr.read1(4096):  # type: ignore[attr-defined]
            *lines, line = (line + piece).replace(b"\r", b"\n").split(b"\n")
            for each in filter(None, (text.decode(errors="replace").strip() for text in lines)):
                self._last_line = each
                self._tell(each)
            if text := line.decode(errors="replace").strip():  # a bar of progress ends its line when the next begins
                self._tell(text)
        answer.join()
        code = self._process.wait()
        self._process.stderr.close()
        if line.strip():
            self._last_line = line.decode(errors="replace").strip()
        result = json.loads(self._out) if code == 0 else {}
        self._ended = Ended(code, result, "" if code == 0 else self._last_line.removeprefix("rigmatch: "))
        self._done(self._ended)

    def _take_answer(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as stream:
            self._out = stream.read()


# --- Modes and frequency responses that follow a slider: the equations are derived once, then only evaluated.

FREQUENCIES = 300  # of a response, spaced logarithmically
BELOW, ABOVE = 0.1, 3.0  # of the lowest and the highest frequency drawn, times the lowest and highest mode
WIDEST_DECADES = 3.0  # drawn at most; the highest modes are left out before
SLIDER_FACTOR = 3.0  # a quantity without a range moves by this factor up and down


@dataclass(frozen=True)
class LiveState:
    """Undamped and damped modes and responses at one set of values."""

    modes: Modes
    damped: Modes
    response: Response | None


class LiveModel:
    """A system compiled once, evaluated at other values of its quantities.

    Attributes
    ----------
    system : System
    frequencies : ndarray (f,)
        Hz, of the responses.
    """

    def __init__(self, system: System):
        self.system = system
        self._model = compiled(system)
        if self._model.n > LARGEST_WITH_ALL_MODES:
            raise InputError(
                "inertias", f"{self._model.n} degrees of freedom are too many", f"at most {LARGEST_WITH_ALL_MODES}"
            )
        self.frequencies = _grid(self.modes())

    def modes(self, values: Mapping[str, float] | None = None) -> Modes:
        """Undamped modes at values (SI) by name."""
        return modes_of(self._model, self._model.vector(values)[None]).case(0)

    def at(self, values: Mapping[str, float] | None = None) -> LiveState:
        """Modes and responses at values (SI) by name."""
        linear, answer = linearise(self._model, values), None
        if self.system.inputs and self.system.sensors:
            answer = response(linear, self.frequencies)
        return LiveState(self.modes(values), damped_modes_of(linear), answer)


def slider_range(quantity: Quantity) -> tuple[float, float] | None:
    """Lower and upper end of a slider (SI): the range of an uncertain quantity, else a factor; None at zero."""
    if quantity.lower is not None and quantity.upper is not None and quantity.lower < quantity.upper:
        return quantity.lower, quantity.upper
    if quantity.value == 0:
        return None
    ends = sorted((quantity.value / SLIDER_FACTOR, quantity.value * SLIDER_FACTOR))
    return ends[0], ends[1]


def _grid(modes: Modes) -> np.ndarray:
    elastic = modes.frequencies[modes.frequencies > 0]
    low = BELOW * float(elastic[0]) if len(elastic) else BELOW
    high = ABOVE * float(elastic[-1]) if len(elastic) else 1 / BELOW
    return np.geomspace(low, min(high, low * 10**WIDEST_DECADES), FREQUENCIES)


# --- Answers from a map that was computed: at a point of it, and between its points.


class MapGrid(NamedTuple):
    """Values of x (i,), of y (j,), SI, and a quantity of the points (j, i), NaN where there is none."""

    x: np.ndarray
    y: np.ndarray
    values: np.ndarray


def grid(content: Mapping[str, Any], key: str = "error") -> MapGrid:
    """A quantity of a map over its axes.

    Parameters
    ----------
    content : mapping
        Of ``map.json``.
    """
    x, y = (np.array(content[axis]["values"]) for axis in ("x", "y"))
    values = [np.nan if point[key] is None else point[key] for point in content["points"]]
    return MapGrid(x, y, np.array(values, float).reshape(len(y), len(x)))


def nearest_point(content: Mapping[str, Any], x: float, y: float) -> dict[str, Any]:
    """The point of the map nearest to values (SI) of its quantities, each counted in steps of its axis."""
    row, column = round(_place(content, "y", y)), round(_place(content, "x", x))
    return dict(content["points"][row * len(content["x"]["values"]) + column])


def interpolated_error(content: Mapping[str, Any], x: float, y: float) -> float:
    """Response error between the points of a map: its logarithm is linear in steps of the axes.

    Parameters
    ----------
    x, y : float
        SI.
    """
    for axis, value in (("x", x), ("y", y)):
        values = content[axis]["values"]
        if not values[0] <= value <= values[-1]:
            raise InputError(
                content[axis]["name"], f"{value:g} lies outside the map", f"{values[0]:g} … {values[-1]:g}"
            )
    columns, rows, errors = grid(content)
    places = np.arange(len(rows), dtype=float), np.arange(len(columns), dtype=float)
    read = RegularGridInterpolator(places, np.log(errors))
    answer = float(np.exp(read([[_place(content, "y", y), _place(content, "x", x)]])[0]))
    if not np.isfinite(answer):
        raise InputError("", "a point beside it has no error", "compute it exactly")
    return answer


def _place(content: Mapping[str, Any], axis: str, value: float) -> float:
    """Where a value lies on an axis, in steps from its first."""
    values = np.array(content[axis]["values"])
    return float(np.interp(value, values, np.arange(len(values))))


# --- Elements of the page that Panel does not have, each with its script and style beside this file.


def beside_this(name: str) -> str:
    """The text of a script or style."""
    return (Path(__file__).parent / name).read_text(encoding="utf-8")


class DrivetrainView(JSComponent):
    """A drawing whose parts can be picked by mouse and keys: as wide as the page, larger on request.

    ``svg`` and ``marks`` are those of :mod:`matching.report.drivetrain`; ``picked`` is the last part, with a count that
    makes it new; without ``reacts`` no part is a button.
    """

    label = param.String(default="the drivetrain")
    svg = param.String(default="")
    marks = param.Dict(default={})
    reacts = param.Boolean(default=False)
    picked = param.String(default="")
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


class TabBar(JSComponent):
    """A row of buttons that screen readers know as tabs; ``active`` is the number of the one that is open."""

    names = param.List(default=[], item_type=str)
    active = param.Integer(default=0)
    _esm = beside_this("tabs.js")
    _stylesheets = [beside_this("tabs.css")]


# --- Pieces that every tab uses: headings, messages, tables, the box with command and Python.

WIDE = "stretch_width"
# Panes have a shadow tree of their own, which the style sheet of the page does not reach.
PANE_STYLE = beside_this("pane.css")


def heading(text: str, level: int = 2) -> pn.pane.HTML:
    """A heading."""
    return pn.pane.HTML(f"<h{level}>{html(text)}</h{level}>", sizing_mode=WIDE, margin=(0, 5), stylesheets=[PANE_STYLE])


def paragraph(text: str) -> pn.pane.HTML:
    """A paragraph."""
    return pn.pane.HTML(f"<p>{html(text)}</p>", sizing_mode=WIDE, margin=(0, 5), stylesheets=[PANE_STYLE])


class Message(pn.pane.HTML):
    """What just happened, read out by screen readers; an error where ``wrong``."""

    def __init__(self) -> None:
        super().__init__('<p role="status"></p>', sizing_mode=WIDE, margin=(0, 5), stylesheets=[PANE_STYLE])

    def say(self, text: str, *, wrong: bool = False) -> None:
        """Show a line."""
        kind = ' class="wrong"' if wrong else ""
        self.object = f'<p role="status"{kind}>{html(text)}</p>'


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
    """Fields at the side of what they change, below it on a narrow screen."""
    wide = {"flex": "1 1 600px", "min-width": "min(100%, 340px)"}
    narrow = {"flex": "0 1 340px", "min-width": "min(100%, 320px)"}
    return pn.FlexBox(
        pn.Column(*main, styles=wide), pn.Column(*side, styles=narrow), flex_wrap="wrap", gap="0 20px",
        align_items="flex-start", sizing_mode=WIDE,
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


# --- Text fields that stay while what they show changes: what somebody is typing is never replaced.

WRONG = "wrong"  # CSS class of a field whose text was not taken
STYLE = f"""
label {{ max-width: 100%; overflow-wrap: anywhere; white-space: normal; }}
:host(.{WRONG}) :is(input, select) {{ border: 2px solid #a00000; background: #fff4f4; }}
"""


@dataclass(frozen=True)
class Entry:
    """A field: what it stands for, its label, its text as the file has it, and the texts to choose from (any: none)."""

    key: Hashable
    label: str
    text: str
    choices: tuple[str, ...] = ()


class Entries:
    """The text fields of a form.

    A field is made once. Afterwards only a text that changed elsewhere (undo, another tab) is put into it: a field made
    anew after every value would take along what is being typed into it, and a text sent back to the field just left
    would arrive over the next one.

    Parameters
    ----------
    enter : callable
        Takes key and text of a field that was left with another text; whether the text was right.
    width : int
        Of a field, px.
    """

    def __init__(self, enter: Callable[[Any, str], bool], width: int):
        self._enter, self._width = enter, width
        self._fields: dict[Hashable, Any] = {}
        self._texts: dict[Hashable, str] = {}
        self._taking: Hashable = None
        self._putting = False
        self._wrong: set[Hashable] = set()

    @property
    def wrong(self) -> list[str]:
        """Labels of fields that show a text which was not taken."""
        return [self._fields[key].name for key in self._fields if key in self._wrong]

    def show(self, entries: Iterable[Entry]) -> list[Any]:
        """The fields of ``entries``, in their order; others are forgotten."""
        shown = list(entries)
        keys = {entry.key for entry in shown}
        for gone in self._fields.keys() - keys:
            del self._fields[gone], self._texts[gone]
        self._wrong &= keys
        return [self._shown(entry) for entry in shown]

    def put_back(self) -> bool:
        """Show the file's text where a text was not taken; whether there was one."""
        wrong = list(self._wrong)
        for key in wrong:
            self._put(key, self._texts[key])
        return bool(wrong)

    def _shown(self, entry: Entry) -> Any:
        field = self._fields.get(entry.key)
        if field is None:
            looks = {"name": entry.label, "value": entry.text, "width": self._width, "stylesheets": [STYLE]}
            if entry.choices:
                field = pn.widgets.Select(options=list(dict.fromkeys((entry.text, *entry.choices))), **looks)
            else:
                field = pn.widgets.TextInput(**looks)
            field.param.watch(partial(self._left, entry.key), "value")
            self._fields[entry.key], self._texts[entry.key] = field, entry.text
            return field
        if field.name != entry.label:
            field.name = entry.label
        if entry.text != self._texts[entry.key]:
            self._texts[entry.key] = entry.text
            if entry.key != self._taking:
                self._put(entry.key, entry.text)
        return field

    def _put(self, key: Hashable, text: str) -> None:
        self._putting = True
        self._fields[key].value = text
        self._putting = False
        self._mark(key, wrong=False)

    def _left(self, key: Hashable, event: Any) -> None:
        """A field has another text: the user's, unless it was put there."""
        if self._putting:
            return
        self._taking = key
        try:
            right = self._enter(key, event.new)
        finally:
            self._taking = None
        self._mark(key, wrong=not right)

    def _mark(self, key: Hashable, *, wrong: bool) -> None:
        if key in self._fields and wrong != (key in self._wrong):
            (self._wrong.add if wrong else self._wrong.discard)(key)
            self._fields[key].css_classes = [WRONG] if wrong else []


def lay_out(box: Any, members: list[Any]) -> None:
    """Put ``members`` into a layout where others are there: laid out again, a field loses the cursor."""
    if list(box) != members:
        box[:] = members


# --- Fields, message, *Undo* and *Save* of files that are edited: the same in every tab.


class Editing:
    """What a tab needs to edit files.

    The buttons are never greyed out: the browser drops a click on a grey button, and the server would release it only
    after it has taken the value that was typed just before the click.

    Parameters
    ----------
    enter : callable
        Writes a text into a field of the file and returns what to say; raises ``InputError`` where it is wrong.
    undo : callable
        Takes the last change back; whether there was one.
    documents : callable
        The files that *Save* writes.
    changed : callable
        Shows the files as they are; called after every change, *Undo* and *Save*.
    width : int
        Of a field, px.
    """

    def __init__(
        self,
        enter: Callable[[Any, str], str],
        undo: Callable[[], bool],
        documents: Callable[[], Sequence[Document]],
        changed: Callable[[], None],
        width: int,
    ):
        self._write, self._take_back, self._documents, self._changed = enter, undo, documents, changed
        self.message = Message()
        self.entries = Entries(self._enter, width)
        self.undo = pn.widgets.Button(name="Undo", width=100)
        self.save = pn.widgets.Button(name="Save", button_type="primary", width=100)
        self.undo.on_click(lambda _: self.do(self._undo))
        self.save.on_click(lambda _: self.do(self._save))

    def buttons(self) -> Any:
        """*Undo* and *Save* beside each other."""
        return pn.FlexBox(self.undo, self.save)

    def do(self, act: Callable[[], str]) -> bool:
        """Do something that changes the files, say what it answers, show the files; whether it went well."""
        try:
            words = act()
            self._changed()
        except InputError as error:
            self.message.say(str(error), wrong=True)
            return False
        self.message.say(words)
        return True

    def all_taken(self) -> None:
        """Check that every field shows what the file would hold."""
        if wrong := self.entries.wrong:
            raise InputError(", ".join(wrong), "was not taken, as said when it was entered", "correct it or press Undo")

    def _enter(self, key: Any, text: str) -> bool:
        return self.do(lambda: self._write(key, text))

    def _undo(self) -> str:
        if self.entries.put_back():
            return "The value in the file is shown again"
        return "The last change is taken back" if self._take_back() else "There is no change to take back"

    def _save(self) -> str:
        self.all_taken()
        changed = [document for document in self._documents() if document.changed]
        for document in changed:
            document.save()
        return f"Saved: {', '.join(document.path.name for document in changed)}" if changed else "Everything is saved"


# --- Frequency responses from a recording, to be laid over those of a model.

POINTS = 60  # of a measured response, spaced logarithmically
PERIODS = 6.0  # of the lowest frequency within the recording
SAMPLES_A_PERIOD = 6.0  # of the highest frequency
MOVES = 1e-9  # of a torque's largest value: what changes less does not excite


@dataclass(frozen=True)
class MeasuredCurves:
    """Responses (f, y, u) at frequencies (f,), Hz, NaN where undetermined, with standard uncertainty of the modulus."""

    frequencies: np.ndarray
    inputs: tuple[str, ...]
    sensors: tuple[str, ...]
    values: np.ndarray
    uncertainties: np.ndarray


def measured_curves(recording: Recording, system: System) -> MeasuredCurves:
    """Responses of a recording's sensors to those of its inputs that change."""
    inputs = [part.name for part in system.inputs if np.ptp(recording[part.name]) > MOVES * _size(recording, part.name)]
    sensors = [part.name for part in system.sensors if part.name in recording.channels]
    if not inputs or not sensors:
        what = "no input changes" if not inputs else "no sensor of the model was recorded"
        raise InputError(recording.source, what, "record one that the model can answer")
    time = recording.time
    even = np.linspace(time[0], time[-1], len(time))
    signals = {name: np.interp(even, time, recording[name]) for name in (*inputs, *sensors)}
    step, lasts = float(even[1] - even[0]), float(even[-1] - even[0])
    low, high = PERIODS / lasts, 1 / (SAMPLES_A_PERIOD * step)
    try:
        spectrum = spectra(
            np.stack([signals[name] for name in inputs], axis=1),
            np.stack([signals[name] for name in sensors], axis=1),
            step,
            high,
        )
        responses = estimated_response([spectrum], np.geomspace(low, high, POINTS))
    except ValueError as error:
        raise InputError(recording.source, f"is too short: {error}", "record longer") from None
    spread = np.sqrt(responses.variances / 2)
    return MeasuredCurves(responses.frequencies, tuple(inputs), tuple(sensors), responses.values, spread)


def _size(recording: Recording, name: str) -> float:
    return max(float(np.abs(recording[name]).max()), 1e-300)


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


# --- Buttons that run a command in a process of its own, tell its progress and cancel it.

TICK_MS = 1000  # between two times that a running command is said to be running for
RESULTS = "results"  # part of the address below which the folder of results is served


class Runner:
    """A button to run, one to cancel, and a line of progress.

    Parameters
    ----------
    name : str
        On the button.
    words : callable
        The command line when the button is pressed; may raise ``InputError``, which is shown.
    done : callable
        Shows what the command answered.
    """

    def __init__(self, name: str, words: Callable[[], Sequence[str]], done: Callable[[Ended], None]):
        self._words, self._done = words, done
        self.job: Job | None = None
        self._end_ticks: Callable[[], None] = lambda: None
        self.run = pn.widgets.Button(name=name, button_type="primary", width=140)
        self.cancel = pn.widgets.Button(name="Cancel", width=100, disabled=True)
        self.message = Message()
        self.clock = paragraph("")  # apart from the message, which is read out whenever it changes
        self.run.on_click(lambda _: self.start())
        self.cancel.on_click(lambda _: self.stop())

    def panel(self) -> Any:
        """Buttons and line."""
        return pn.Column(pn.FlexBox(self.run, self.cancel), self.message, self.clock, sizing_mode="stretch_width")

    def start(self) -> None:
        """Run the command."""
        try:
            words = self._words()
        except InputError as error:
            self.message.say(str(error), wrong=True)
            return
        self.run.disabled, self.cancel.disabled = True, False
        self.message.say(f"{words[0]} is running …")
        page, begun = pn.state.curdoc, monotonic()
        if page is not None:
            ticks = page.add_periodic_callback(lambda: self._tick(begun), TICK_MS)
            self._end_ticks = lambda: page.remove_periodic_callback(ticks)
        self.job = Job(words, lambda line: _in_page(page, self.message.say, line),
                       lambda ended: _in_page(page, self._ended, ended))  # fmt: skip

    def stop(self) -> None:
        """Ask the command to end."""
        if self.job is not None:
            self.job.cancel()

    def _tick(self, begun: float) -> None:
        self.clock.object = f"<p>running for {monotonic() - begun:.0f} s</p>"

    def _ended(self, ended: Ended) -> None:
        self._end_ticks()
        self._end_ticks, self.clock.object = lambda: None, ""
        self.run.disabled, self.cancel.disabled = False, True
        if ended.cancelled:
            self.message.say("cancelled; nothing was written")
        elif ended.code:
            self.message.say(ended.line, wrong=True)
        else:
            self.message.say("done")
            self._done(ended)


def address_of(file: Path, out: Path) -> str:
    """Address of a file in the folder of results, from the page."""
    return f"{RESULTS}/{file.relative_to(out).as_posix()}"


def _in_page(page: Any, act: Callable[[Any], None], value: Any) -> None:
    """Do something in the page's own thread, where there is a page."""
    if page is None:
        act(value)
    else:
        page.add_next_tick_callback(lambda: act(value))


# --- Drawings of the open models; those of a case with what the case says of them.


def sketches(workspace: Workspace) -> dict[str, Sketch]:
    """Drawing of every open model, by its role; values as edited, dynamometers and cut as the saved case has them."""
    systems = {role: document.system for role, document in workspace.models.items()}
    if workspace.case is None:
        drawings = {role: drawing(system) for role, system in systems.items()}
    else:
        of_case = dict(zip(("vehicle", "rig"), case_drawings(workspace.load_case()), strict=True))
        largest = max(part.J.value for system in systems.values() for part in system.inertias)
        drawings = {role: drawing(system, of_case[role].emphasis, largest) for role, system in systems.items()}
    known = workspace.sketches  # a drawing takes a fifth of a second
    workspace.sketches = {
        role: known[role] if role in known and known[role].drawing == drawn else sketch(drawn)
        for role, drawn in drawings.items()
    }
    return workspace.sketches


# --- A measurement file beside a model: its columns, which channel each is, and the signals over time.

SHOWN_POINTS = 3000  # of a signal: two a column of pixels


@dataclass(frozen=True)
class Measurement:
    """A measurement file that is open.

    Attributes
    ----------
    path : Path
    table : Table
        All its columns, in the file's units.
    time : str
        The column of time.
    """

    path: Path
    table: Table
    time: str

    @property
    def columns(self) -> dict[str, str]:
        """Unit of every column but time, empty where the file states none."""
        return {column.name: column.unit for column in self.table.columns if column.name != self.time}

    @property
    def span(self) -> tuple[float, float]:
        """First and last time, in the file's unit."""
        time = self._column(self.time)
        return float(time[0]), float(time[-1])

    def suggestions(self, system: System) -> dict[str, Suggestion]:
        """The likeliest column of every channel of a model."""
        return suggestions(system, self.columns)

    def signal(self, column: str, low: float, high: float) -> tuple[np.ndarray, ...]:
        """Times and values (k,) of a column between two times, decimated for a screen, in the file's units."""
        time, values = self._column(self.time), self._column(column)
        first = max(int(np.searchsorted(time, low)) - 1, 0)  # one sample beyond each end: the curve reaches the edges
        last = int(np.searchsorted(time, high, side="right")) + 1
        return decimated(time[first:last], values[first:last], SHOWN_POINTS)

    def write_channels(self, chosen: Mapping[str, tuple[str, str]], folder: Path) -> Path:
        """Write a channel file that says which column, in which unit, is which channel; its path."""
        used = [column for column, _ in chosen.values() if column]
        if twice := next((column for column in used if used.count(column) > 1), ""):
            raise InputError(str(self.path), f"column {twice!r} stands for two channels", "choose another for one")
        name = f"{file_name(self.path.stem)}_channels.toml"
        write_all(folder, {name: channel_file(chosen, self.time)})
        return folder / name

    def _column(self, name: str) -> np.ndarray:
        return self.table[name].values


def opened_measurement(path: str | Path) -> Measurement:
    """Read a measurement file with all its columns."""
    table = read_table(path)
    time = time_column(table.names)
    if not time:
        raise InputError(str(path), "has no column called time", "call the column of time `time` or `t`")
    return Measurement(Path(path), table, time)


def read_as_suggested(path: Path, system: System) -> Recording:
    """The channels of a model from a file, each from the column that is likeliest."""
    file = opened_measurement(path)
    channels = {
        name: Channel(suggested.column, suggested.unit)
        for name, suggested in file.suggestions(system).items()
        if suggested.column
    }
    return read_recording(path, system, channels | {"time": Channel(file.time)})


def in_units_of(values: np.ndarray, si: str, unit: str) -> np.ndarray:
    """Values (k,) of a model, SI, in the unit of a file."""
    return values / factor(unit, si) if unit else values


# --- What if

LARGEST_SHARES = 3  # components of a mode that its row of the table names


@dataclass
class WhatIf:
    """A model with quantities that a slider moves.

    Attributes
    ----------
    document : ModelDocument
    values : dict of str to float
        Tried, SI, by name.
    now, before : LiveState
        With the tried values, and with those of the document.
    """

    document: ModelDocument
    values: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget what was tried, and follow the document."""
        self.live = LiveModel(self.document.system)
        self.values.clear()
        self.before: LiveState = self.live.at()
        self.now: LiveState = self.before

    @property
    def movable(self) -> dict[str, tuple[float, float]]:
        """Range of the slider (SI) of every quantity that has one."""
        ranges = {name: slider_range(quantity) for name, quantity in self.document.system.parameters.items()}
        return {name: ends for name, ends in ranges.items() if ends is not None}

    def try_value(self, name: str, value: float) -> None:
        """Set a quantity (SI) and follow it."""
        values = self.values | {name: value}
        self.now = self.live.at(values)
        self.values = values

    def keep(self) -> None:
        """Write what was tried into the document, as changes that can be undone."""
        for name, value in self.values.items():
            self.document.set_value(name, value)
        self.reset()


def largest_shares(mode: Mode) -> str:
    """The components that hold most of a mode's energy, in words: ``body left 49 %, …``."""
    shares = sorted((mode.kinetic | mode.potential).items(), key=lambda item: -item[1])[:LARGEST_SHARES]
    return ", ".join(f"{name.partition('.')[2].replace('_', ' ')} {100 * share:.0f} %" for name, share in shares)
