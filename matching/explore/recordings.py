"""Recordings beside a model: dropped or named, their channels chosen, looked at with cursors and computed signals."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import panel as pn
from bokeh.events import Tap
from bokeh.models import ColumnDataSource, PlainText, Range1d, Span

from matching.channel_names import wanted_channels
from matching.explore.elements import (
    CHOICE_STYLE,
    PANE_STYLE,
    WIDE,
    Message,
    heading,
    paragraph,
    plain_button,
    plain_figure,
    table,
)
from matching.explore.fields import ONE_LINE
from matching.explore.files import Workspace, number_or_text
from matching.explore.signals import Computed, Measurement, opened_measurement
from matching.report.common import CURVE_COLOURS, LIMIT, RIG, number
from modelling.errors import InputError
from modelling.escape import file_name
from modelling.recordings.readers import READERS
from modelling.units import to_si
from modelling.writing import write_all

LARGEST_UPLOAD = "2000MB"  # of a dropped file; a larger one is opened by its path
NOT_RECORDED = "not recorded"
COLUMN_PX, UNIT_PX = 215, 125  # of two fields that stand beside each other, on a screen of 400 px too
COLOURS = tuple(colour for colour in CURVE_COLOURS if colour != RIG)  # of recordings; that of the model is its own
MOST_DRAWN = len(COLOURS)  # recordings over each other
STROKES = ("solid", "dashed", "dotdash", "dotted")
DASHES = ("solid", "dashed")  # of the cursors A and B
DIGITS = 5  # of what is read at a cursor


def in_own_turn(act: Callable[[], Any]) -> None:
    """Do something that changes a figure in the page's own turn: not while the text of a field is taken."""
    if pn.state.curdoc is None:
        act()
    else:
        pn.state.curdoc.add_next_tick_callback(act)


class RecordingsTab:
    """Recordings beside one of the open models; a step adds what it does with them.

    Parameters
    ----------
    workspace : Workspace
    roles : list of str
        Of the open models, those that the recordings may belong to.
    """

    recordings_named = "Recording"

    def __init__(self, workspace: Workspace, roles: list[str]):
        self.workspace = workspace
        self.file: Measurement | None = None
        self._files: dict[Path, Measurement] = {}
        self._choosers: dict[str, tuple[Any, Any]] = {}
        self.role = pn.widgets.Select(name="Model", options=roles, width=200)
        self.drop = pn.widgets.FileDropper(
            name="or drop them here", max_file_size=LARGEST_UPLOAD, multiple=True, height=130, sizing_mode=WIDE
        )  # its own check of types knows none of these formats
        self.path = pn.widgets.TextInput(
            name=f"{self.recordings_named}: its path on this machine", styles={"flex": "1 1 300px"}
        )
        self.used = pn.widgets.CheckBoxGroup(name="Recordings that are used", inline=True)
        self.used_box = pn.Column(paragraph("Recordings that are used:"), self.used, sizing_mode=WIDE, visible=False)
        self.message = Message()
        self.channels = pn.Column(sizing_mode=WIDE)
        self._make_plot()
        self.drop.param.watch(lambda event: in_own_turn(lambda: self._dropped(event)), "value")
        self.path.param.watch(self._named, "value")
        self.role.param.watch(lambda _: in_own_turn(self._other_model), "value")
        self.used.param.watch(lambda _: in_own_turn(self._chosen), "value")

    def recordings_panel(self) -> list[Any]:
        """Fields for the files and their channels."""
        chooser = [self.role] if len(self.role.options) > 1 else []
        return [
            heading("Recordings"), pn.FlexBox(*chooser, self.path, align_items="end"), self.drop, self.message,
            self.used_box, self.channels,
        ]  # fmt: skip

    # --- Files and channels

    def open_first(self) -> None:
        """Open what the program knows of, the one named first in sight."""
        for path in reversed(self.workspace.recordings):
            self.open(path)

    def open(self, path: Path) -> bool:
        """Read a file, suggest its channels and draw its first signal; whether it could be read."""
        try:
            file = self._files.get(path) or opened_measurement(path)
        except InputError as error:
            self.message.say(str(error), wrong=True)
            return False
        others = [known for known in self._used() if known != path and self._files[known].alike(file)]
        self._files = {path: file} | {known: own for known, own in self._files.items() if known != path}
        self.remember(path)
        self.message.say(f"{path.name}: {file.table.rows} samples, columns {', '.join(file.columns)}")
        self.used.param.update(options=self._names(), value=[path, *others])
        self.used_box.visible = len(self._files) > 1
        self._show_file(file)
        return True

    def remember(self, path: Path) -> None:
        """Offer a recording to the other steps too."""
        self.workspace.recordings = [path, *(each for each in self.workspace.recordings if each != path)]

    def forget(self, path: Path) -> None:
        """Read a file anew when it is opened: it has another content."""
        self._files.pop(path, None)

    def _names(self) -> dict[str, Path]:
        """The open recordings by what they are called: a name that two of them have with its folder."""
        names = [path.name for path in self._files]
        return {(path.name if names.count(path.name) == 1 else str(path)): path for path in self._files}

    def _used(self) -> list[Path]:
        return [path for path in self.used.value if path in self._files]

    def _chosen(self) -> None:
        """Other recordings are used: one channel file holds for all of them."""
        used = self._used()
        first = self._files[used[0]] if used else None
        if first is not None and (wrong := next((p for p in used if not first.alike(self._files[p])), None)):
            self.message.say(
                f"{wrong.name} has other columns or units than {used[0].name}; use one of them", wrong=True
            )
            self.used.value = [path for path in used if first.alike(self._files[path])]
            return
        if first is not None and first is not self.file:
            self._show_file(first)
        self.show_signal()

    def _show_file(self, file: Measurement) -> None:
        self.file = file
        suggested = file.suggestions(self.system)
        before = {name: (column.value, own.value) for name, (column, own) in self._choosers.items()}
        self._choosers = {}
        for wanted in wanted_channels(self.system):
            options = {NOT_RECORDED: ""} | {name: name for name in file.columns}
            label = f"{wanted.name.replace('_', ' ')} ({'input, ' if wanted.needed else ''}{wanted.kind})"
            first = suggested[wanted.name].column, suggested[wanted.name].unit
            chosen, of = before.get(wanted.name, first)
            if chosen not in options.values() or not self._keeps_channels(file):
                chosen, of = first
            column = pn.widgets.Select(
                name=label, options=options, value=chosen, width=COLUMN_PX, stylesheets=[ONE_LINE, CHOICE_STYLE]
            )  # fmt: skip
            own = pn.widgets.TextInput(
                name=f"unit of {wanted.name.replace('_', ' ')}", value=of, width=UNIT_PX, stylesheets=[ONE_LINE]
            )
            for chooser in (column, own):
                chooser.param.watch(lambda _: self.channels_changed(), "value")
            self._choosers[wanted.name] = column, own
        self._columns = list(file.columns)
        self.channels[:] = [
            heading("Channels"),
            paragraph("Suggested from names and units; correct what is wrong."),
            pn.FlexBox(*(pn.Row(*pair) for pair in self._choosers.values())),
        ]
        low, high = self._span()
        self.figure.x_range.update(start=low, end=high, bounds=(low, high))
        self.signals.visible = True
        self._offer_signals()
        self.cursors = (low + (high - low) / 3, low + 2 * (high - low) / 3)
        self.channels_changed()
        self.show_signal()

    def _keeps_channels(self, file: Measurement) -> bool:
        """Whether what was chosen for the recording before holds for this one."""
        return getattr(self, "_columns", None) == list(file.columns)

    def channels_changed(self) -> None:
        """Another column or unit was chosen."""

    @property
    def system(self) -> Any:
        """The model that the recordings belong to."""
        return self.workspace.models[self.role.value].system

    def write_channels(self) -> Path:
        """Write the channel file as chosen; its path."""
        if self.file is None or not self._used():
            raise InputError("", "no recording is open", "drop one")
        chosen = {name: (column.value, own.value) for name, (column, own) in self._choosers.items()}
        return self.file.write_channels(chosen, self.workspace.out / "recordings")

    def _named(self, event: Any) -> None:
        if event.new:
            in_own_turn(lambda: self.open(Path(event.new)))

    def _other_model(self) -> None:
        if self.file is not None:
            self._show_file(self.file)

    def _dropped(self, event: Any) -> None:
        for name, content in (event.new or {}).items():
            if Path(name).suffix.lower() not in READERS:
                self.message.say(f"{name} is no recording; known are {', '.join(READERS)}", wrong=True)
                continue
            self.take_dropped(name, content.encode() if isinstance(content, str) else content)

    def take_dropped(self, name: str, content: bytes) -> None:
        """Keep a file that was dropped, and open it."""
        path = self.workspace.out / "recordings" / file_name(name)
        write_all(path.parent, {path.name: content})
        self.forget(path)
        self.open(path)

    # --- Signals over time, two cursors, computed signals

    def _make_plot(self) -> None:
        self.signal = pn.widgets.Select(name="Signal", width=300)
        self.formula = pn.widgets.TextInput(
            name="Compute a signal from columns, in SI units", placeholder="motor_torque * motor_speed",
            styles={"flex": "1 1 300px"},
        )  # fmt: skip
        self.compute = plain_button("Compute")
        self._computed: dict[str, Computed] = {}  # by its name among the signals
        self.sources = [ColumnDataSource({"t": [], "y": []}) for _ in range(MOST_DRAWN)]
        self.source = self.sources[0]
        self.simulated = ColumnDataSource({"t": [], "y": []})
        self.figure = self._figure()
        self.at = [pn.widgets.TextInput(name=f"Cursor {name}", width=150) for name in "AB"]
        self.read = pn.pane.HTML(sizing_mode=WIDE, stylesheets=[PANE_STYLE])
        self.said = Message()
        self.signals = pn.Column(
            heading("Signals"), pn.FlexBox(self.signal, self.formula, self.compute, align_items="end"), self.said,
            pn.pane.Bokeh(self.figure, sizing_mode=WIDE),
            paragraph("A click into the figure moves the nearer cursor: A is drawn solid, B dashed."),
            pn.FlexBox(*self.at, align_items="end"), self.read, sizing_mode=WIDE, visible=False,
        )  # fmt: skip
        self.signal.param.watch(lambda _: in_own_turn(self.show_signal), "value")
        self.compute.on_click(lambda _: in_own_turn(self._compute))
        for place, field in enumerate(self.at):
            field.param.watch(lambda _, place=place: in_own_turn(lambda: self._typed(place)), "value")

    def _figure(self) -> Any:
        fig = plain_figure("Recording", "time [s]", "", x_range=Range1d(0, 1))
        self._lines = [
            fig.line("t", "y", source=source, color=COLOURS[place], line_width=1.2, legend_label=f"recording {place}",
                     line_dash=STROKES[place % len(STROKES)])
            for place, source in enumerate(self.sources)
        ]  # fmt: skip
        fig.line("t", "y", source=self.simulated, color=RIG, line_width=1.2, legend_label="model")
        self._items = list(fig.legend.items)
        self.spans = [Span(dimension="height", line_color=LIMIT, line_width=1.5, line_dash=dash) for dash in DASHES]
        for span in self.spans:
            fig.add_layout(span)
        fig.legend.click_policy = "hide"
        fig.add_layout(fig.legend[0], "below")  # within the frame it would cover the signal
        fig.legend[0].orientation = "horizontal"
        fig.on_event(Tap, lambda event: self._tapped(event.x))
        self._waiting = False
        for end in ("start", "end"):
            fig.x_range.on_change(end, lambda attr, old, new: self._moved())
        return fig

    def _span(self) -> tuple[float, float]:
        """First and last time of the recordings that are used, in their unit."""
        spans = [self._files[path].span for path in self._used()] or [(0.0, 1.0)]
        return min(low for low, _ in spans), max(high for _, high in spans)

    @property
    def _time_unit(self) -> str:
        return "s" if self.file is None else self.file.time_unit

    def _offer_signals(self, wanted: str = "") -> None:
        assert self.file is not None
        names = [*self.file.columns, *self._computed]
        value = next((name for name in (wanted, self.signal.value) if name in names), names[0] if names else None)
        self.signal.param.update(options=names, value=value)

    def _unit_of(self, column: str) -> str:
        """Unit in which a column is: as chosen for its channel, else as its file states."""
        chosen = next((own.value for chosen, own in self._choosers.values() if chosen.value == column), "")
        assert self.file is not None
        return chosen or self.file.columns.get(column, "")

    def _compute(self) -> None:
        """Take the formula as a signal; it is refused where it is none of the columns."""
        if self.file is None:
            return
        try:
            made = Computed.of(self.formula.value, {name: self._unit_of(name) for name in self.file.columns})
        except InputError as error:
            self.said.say(str(error), wrong=True)
            return
        self.said.say("")
        self._computed[made.text] = made
        self._offer_signals(made.text)

    @property
    def _shown(self) -> str | Computed:
        return self._computed.get(self.signal.value, self.signal.value)

    def show_signal(self) -> None:
        """Draw what is in sight of the chosen signal, of every recording that is used."""
        if self.file is None or self.signal.value not in [*self.file.columns, *self._computed]:
            return
        low, high = self.figure.x_range.start, self.figure.x_range.end
        used, unit = self._used()[:MOST_DRAWN], self.file.columns.get(self.signal.value, "")
        names = {path: name for name, path in self._names().items()}
        for place, source in enumerate(self.sources):
            there = place < len(used)
            time, values = self._files[used[place]].signal(self._shown, low, high) if there else ([], [])
            source.data = {"t": time, "y": values}
            label = names[used[place]].replace("$$", "$") if there and len(used) > 1 else "recorded"
            self._items[place].label = {"value": label}
            self._items[place].visible = there
        # as plain text: Bokeh fetches a library from the network for a label with $$
        self.figure.yaxis.axis_label = PlainText(text=f"{self.signal.value} [{unit or 'SI'}]")
        self.figure.xaxis.axis_label = PlainText(text=f"time [{self._time_unit}]")
        self.draw_model(unit)
        self._items[-1].visible = len(self.simulated.data["t"]) > 0
        self._read_cursors()

    def draw_model(self, unit: str) -> None:
        """What the model says of the chosen signal, in the unit of the file, over the recording."""

    def _moved(self) -> None:
        if self._waiting or pn.state.curdoc is None:
            return
        self._waiting = True
        pn.state.curdoc.add_next_tick_callback(self._draw_again)

    def _draw_again(self) -> None:
        self._waiting = False
        self.show_signal()

    @property
    def cursors(self) -> tuple[float, float]:
        """Times of A and B, in the unit of the recordings."""
        return self.spans[0].location or 0.0, self.spans[1].location or 0.0

    @cursors.setter
    def cursors(self, times: tuple[float, float]) -> None:
        for span, field, time, name in zip(self.spans, self.at, times, "AB", strict=True):
            span.location = float(time)
            field.param.update(name=f"Cursor {name} [{self._time_unit}]", value=number(time, DIGITS))

    def _tapped(self, time: float | None) -> None:
        if self.file is None or time is None:
            return
        first, second = self.cursors
        self.cursors = (time, second) if abs(time - first) <= abs(time - second) else (first, time)
        self._read_cursors()

    def _typed(self, place: int) -> None:
        """A cursor's time was typed."""
        text = self.at[place].value
        if text == number(self.cursors[place], DIGITS):
            return
        try:
            seconds = to_si(number_or_text(text), self._time_unit, self.at[place].name)
        except InputError as error:
            self.said.say(str(error), wrong=True)
            return
        self.said.say("")
        times = [*self.cursors]
        times[place] = seconds
        self.cursors = times[0], times[1]
        self._read_cursors()

    def _read_cursors(self) -> None:
        """Values of the chosen signal at both cursors, and their differences."""
        if self.file is None:
            return
        first, second = self.cursors
        gap = second - first
        rows, unit = [], self.file.columns.get(self.signal.value, "") or "SI"
        names = {path: name for name, path in self._names().items()}
        for path in self._used()[:MOST_DRAWN]:
            values = self._files[path].at(self._shown, (first, second))
            shown = [number(value, DIGITS) for value in (*values, values[1] - values[0])]
            rows.append({"recording": names[path]} | dict(zip((f"A [{unit}]", f"B [{unit}]", f"Δy [{unit}]"), shown,
                                                              strict=True)))  # fmt: skip
        words = f"Δt = {number(gap, DIGITS)} {self._time_unit}"
        if gap and self._time_unit == "s":
            words += f", 1/Δt = {number(1 / abs(gap), DIGITS)} Hz"
        self.read.object = table(rows, words) if rows else ""
