"""The tab *Measurement*: a file is dropped, its channels are named, looked at, compared and diagnosed."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import panel as pn
from bokeh.models import ColumnDataSource, PlainText, Range1d

from matching.channel_names import wanted_channels
from matching.explore.elements import (
    PANE_STYLE,
    WIDE,
    Equivalent,
    EquivalentBox,
    Message,
    heading,
    opening,
    paragraph,
    plain_button,
    plain_figure,
    report_frame,
    same,
)
from matching.explore.fields import ONE_LINE
from matching.explore.files import Workspace, within, write_case, write_model
from matching.explore.jobs import Ended, Runner, address_of
from matching.explore.signals import Measurement, in_units_of, opened_measurement
from matching.report.common import RIG, VEHICLE
from modelling.errors import InputError
from modelling.escape import file_name
from modelling.recordings.readers import READERS, read_table
from modelling.units import factor
from modelling.writing import write_all

LARGEST_UPLOAD = "2000MB"  # of a dropped file; a larger one is opened by its path
IDENTIFIED = "identify"  # folder of its results
CASE_FILES = (".toml", ".csv")  # of them
NOT_RECORDED = "not recorded"
COLUMN_PX, UNIT_PX = 215, 125  # of two fields that stand beside each other, on a screen of 400 px too


class MeasurementTab:
    """A recording beside one of the open models; ``to_match`` is called when the identified case is open."""

    def __init__(self, workspace: Workspace, to_match: Callable[[], None] = lambda: None):
        self.workspace, self._to_match = workspace, to_match
        self.file: Measurement | None = None
        self.role = pn.widgets.Select(name="Model", options=list(workspace.models), width=200)
        self.drop = pn.widgets.FileDropper(
            name="or drop it here", max_file_size=LARGEST_UPLOAD, height=130, sizing_mode=WIDE
        )  # its own check of types knows none of these formats
        self.path = pn.widgets.TextInput(name="Recording: its path on this machine", styles={"flex": "1 1 300px"})
        self.message = Message()
        self.channels = pn.Column(sizing_mode=WIDE)
        self.signal = pn.widgets.Select(name="Signal", width=300)
        self.source = ColumnDataSource({"t": [], "y": []})
        self.simulated = ColumnDataSource({"t": [], "y": []})
        self.figure = self._figure()
        self.signals = pn.Column(self.signal, pn.pane.Bokeh(self.figure, sizing_mode=WIDE), sizing_mode=WIDE)
        self.signals.visible = False
        self.result = pn.pane.HTML(sizing_mode=WIDE, stylesheets=[PANE_STYLE])
        self.compare = Runner("Simulate", workspace.tasks, self._simulate_words, self._show_simulated)
        self.diagnose = Runner("Diagnose", workspace.tasks, self._diagnose_words, self._show_diagnosis)
        self.identify = Runner("Identify", workspace.tasks, self._identify_words, self._show_identified)
        self.identified = pn.pane.HTML(sizing_mode=WIDE, stylesheets=[PANE_STYLE])
        self.case_as = pn.widgets.TextInput(name="Folder for the case with these values", width=340, visible=False)
        self.hand_over = plain_button("Go on to Match", visible=False)
        self.handed = Message()
        self.keep_as = pn.widgets.TextInput(name="Keep the extended model as", width=340, visible=False)
        self.keep = plain_button("Keep", visible=False)
        self.kept = Message()
        self.same = EquivalentBox(self._equivalent("RECORDING", ""))
        self.drop.param.watch(self._dropped, "value")
        self.path.param.watch(self._named, "value")
        self.role.param.watch(self._other_model, "value")
        self.signal.param.watch(lambda _: self.show_signal(), "value")
        self.keep.on_click(lambda _: self._keep())
        self.hand_over.on_click(lambda _: self._hand_over())
        if workspace.recordings:
            self.open(workspace.recordings[0])

    def panel(self) -> Any:
        """The tab's content."""
        return pn.Column(
            opening(
                "Measurement",
                "A recording beside the model: simulate its inputs, let the diagnosis name what the model lacks, or "
                "identify the values of the case.",
                self.compare.run,
                self.diagnose.run,
                *([self.identify.run] if self.workspace.case is not None else []),
            ),
            self.compare.panel(),
            self.diagnose.panel(),
            self.identify.panel(),
            self.identified,
            pn.FlexBox(self.case_as, self.hand_over, align_items="end"),
            self.handed,
            heading("Recording"),
            pn.FlexBox(self.role, self.path, align_items="end"),
            self.drop,
            self.message,
            self.channels,
            heading("Model against recording"),
            self.result,
            pn.FlexBox(self.keep_as, self.keep, align_items="end"),
            self.kept,
            self.signals,
            self.same,
            sizing_mode=WIDE,
        )

    def open(self, path: Path) -> None:
        """Read a file, suggest its channels and draw its first signal."""
        try:
            self.file = opened_measurement(path)
        except InputError as error:
            self.message.say(str(error), wrong=True)
            return
        file, system = self.file, self.workspace.models[self.role.value].system
        self.workspace.recordings = [path, *(each for each in self.workspace.recordings if each != path)]
        self.message.say(f"{path.name}: {file.table.rows} samples, columns {', '.join(file.columns)}")
        suggested = file.suggestions(system)
        self._choosers: dict[str, tuple[Any, Any]] = {}
        for wanted in wanted_channels(system):
            options = {NOT_RECORDED: ""} | {name: name for name in file.columns}
            label = f"{wanted.name.replace('_', ' ')} ({'input, ' if wanted.needed else ''}{wanted.kind})"
            column = pn.widgets.Select(
                name=label,
                options=options,
                value=suggested[wanted.name].column,
                width=COLUMN_PX,
                stylesheets=[ONE_LINE],
            )
            unit = pn.widgets.TextInput(
                name=f"unit of {wanted.name.replace('_', ' ')}",
                value=suggested[wanted.name].unit,
                width=UNIT_PX,
                stylesheets=[ONE_LINE],
            )
            for chooser in (column, unit):
                chooser.param.watch(lambda _: self._name_files(), "value")
            self._choosers[wanted.name] = column, unit
        self.channels[:] = [
            heading("Channels"),
            paragraph("Suggested from names and units; correct what is wrong."),
            pn.FlexBox(*(pn.Row(*pair) for pair in self._choosers.values())),
        ]
        low, high = file.span
        self.figure.x_range.update(start=low, end=high, bounds=(low, high))
        self.signals.visible = True
        names = list(file.columns)
        self.signal.param.update(options=names, value=names[0] if names else None)
        self._name_files()
        self.show_signal()

    def _name_files(self) -> None:
        """Write the channel file as chosen, so that the command shown finds it."""
        assert self.file is not None
        try:
            self.same.set(self._equivalent(str(self.file.path), str(self._write_channels())))
        except InputError as error:
            self.message.say(str(error), wrong=True)

    def _equivalent(self, recording: str, channels: str) -> Equivalent:
        model = str(write_model(self.workspace, self.role.value))
        return same("diagnose", model, [recording], out=self.workspace.out / "diagnosis", channels=channels)

    def show_signal(self) -> None:
        """Draw what is in sight of the chosen signal."""
        if self.file is None or self.signal.value not in self.file.columns:
            return
        low, high = self.figure.x_range.start, self.figure.x_range.end
        time, values = self.file.signal(self.signal.value, low, high)
        self.source.data = {"t": time, "y": values}
        unit = self.file.columns[self.signal.value]
        # as plain text: Bokeh fetches a library from the network for a label with $$
        self.figure.yaxis.axis_label = PlainText(text=f"{self.signal.value} [{unit or 'SI'}]")
        self.figure.xaxis.axis_label = PlainText(text=f"time [{self.file.time_unit}]")
        self._draw_simulated(unit)

    def _figure(self) -> Any:
        fig = plain_figure("Recording", "time [s]", "", x_range=Range1d(0, 1))
        fig.line("t", "y", source=self.source, color=VEHICLE, line_width=1.2, legend_label="recorded")
        fig.line("t", "y", source=self.simulated, color=RIG, line_width=1.2, legend_label="model")
        fig.legend.click_policy = "hide"
        fig.add_layout(fig.legend[0], "below")  # within the frame it would cover the signal
        fig.legend[0].orientation = "horizontal"
        self._waiting = False
        for end in ("start", "end"):
            fig.x_range.on_change(end, lambda attr, old, new: self._moved())
        return fig

    def _moved(self) -> None:
        if self._waiting or pn.state.curdoc is None:
            return
        self._waiting = True
        pn.state.curdoc.add_next_tick_callback(self._draw_again)

    def _draw_again(self) -> None:
        self._waiting = False
        self.show_signal()

    def _named(self, event: Any) -> None:
        if not event.new:
            return
        if pn.state.curdoc is None:
            self.open(Path(event.new))
        else:  # the figure may be changed in the page's own turn alone, not while a field's text is taken
            pn.state.curdoc.add_next_tick_callback(lambda: self.open(Path(event.new)))

    def _other_model(self, _: Any) -> None:
        if self.file is not None:
            self.open(self.file.path)

    def _dropped(self, event: Any) -> None:
        for name, content in (event.new or {}).items():
            if Path(name).suffix.lower() not in READERS:
                self.message.say(f"{name} is no recording; known are {', '.join(READERS)}", wrong=True)
                continue
            folder = self.workspace.out / "recordings"
            data = content.encode() if isinstance(content, str) else content
            write_all(folder, {file_name(name): data})
            self.open(folder / file_name(name))

    def _write_channels(self) -> Path:
        if self.file is None:
            raise InputError("", "no recording is open", "drop one")
        chosen = {name: (column.value, unit.value) for name, (column, unit) in self._choosers.items()}
        return self.file.write_channels(chosen, self.workspace.out / "recordings")

    def _arguments(self, out: str) -> list[str]:
        channels, file = self._write_channels(), self.file
        assert file is not None
        model = str(write_model(self.workspace, self.role.value))
        return [model, str(file.path), "--channels", str(channels), "--out", str(self.workspace.out / out)]

    def _simulate_words(self) -> list[str]:
        return ["simulate", *self._arguments("simulated")]

    def _diagnose_words(self) -> list[str]:
        return ["diagnose", *self._arguments("diagnosis")]

    def _identify_words(self) -> list[str]:
        channels, file = self._write_channels(), self.file
        assert file is not None
        recorded = "--bed" if self.role.value == "rig" else "--vehicle"
        case, out = str(write_case(self.workspace)), str(self.workspace.out / IDENTIFIED)
        return ["identify", case, recorded, str(file.path), "--channels", str(channels), "--out", out]

    def _show_identified(self, _: Ended) -> None:
        address = address_of(self.workspace.out / IDENTIFIED / "report.html", self.workspace.out)
        self.identified.object = report_frame("Identification", address=address)
        taken = (f"identified{number or ''}" for number in itertools.count())
        free = next(name for name in taken if not (self.workspace.home / name).exists())
        self.case_as.param.update(value=free, visible=True)
        self.hand_over.visible = True

    def _hand_over(self) -> None:
        """Write the identified case into a folder of its own, open it, and go on to the step Match."""
        try:
            folder = within(self.workspace.home, self.case_as.value)
            if folder.exists():
                raise InputError(self.case_as.value, "exists", "name a new folder")
            found = self.workspace.out / IDENTIFIED
            write_all(folder, {file.name: file.read_bytes() for file in found.iterdir() if file.suffix in CASE_FILES})
            self.workspace.open(folder / "case.toml")
        except InputError as error:
            self.handed.say(str(error), wrong=True)
            return
        self._to_match()

    def _show_simulated(self, _: Ended) -> None:
        self._table = read_table(self.workspace.out / "simulated" / "simulated.csv")
        self.show_signal()

    def _draw_simulated(self, unit: str) -> None:
        table, column = getattr(self, "_table", None), self.signal.value
        name = next((name for name, (chosen, _) in self._choosers.items() if chosen.value == column), "")
        if table is None or name not in table.names:
            self.simulated.data = {"t": [], "y": []}
            return
        system = self.workspace.models[self.role.value].system
        si = next((wanted.si for wanted in wanted_channels(system) if wanted.name == name), "")
        drawn = Measurement(Path(), table, table.names[0])
        assert self.file is not None
        of_file = self.file.time_unit
        seconds = factor(of_file, "s")
        time, values = drawn.signal(name, self.figure.x_range.start * seconds, self.figure.x_range.end * seconds)
        self.simulated.data = {"t": in_units_of(time, "s", of_file), "y": in_units_of(values, si, unit)}

    def _show_diagnosis(self, _: Ended) -> None:
        out = self.workspace.out / "diagnosis"
        self.result.object = report_frame("Diagnosis", address=address_of(out / "report.html", self.workspace.out))
        model = self.workspace.models[self.role.value].path
        self.keep_as.param.update(value=str(model.with_name(f"{model.stem}_extended.toml")), visible=True)
        self.keep.visible = True

    def _keep(self) -> None:
        target = Path(self.keep_as.value)
        if target.exists():
            self.kept.say(f"{target} is there already; name another file", wrong=True)
            return
        text = (self.workspace.out / "diagnosis" / "extended.toml").read_text(encoding="utf-8")
        try:
            write_all(target.parent, {target.name: text})
        except InputError as error:
            self.kept.say(str(error), wrong=True)
            return
        self.kept.say(f"written: {target}")


def measurement_tab(workspace: Workspace, to_match: Callable[[], None]) -> Any:
    """The tab's content, also without a model."""
    if workspace.models:
        return MeasurementTab(workspace, to_match).panel()
    return pn.Column(heading("Measurement"), paragraph("Open a model under Files first."))
