"""The step *Measurement*: recordings beside a model, compared with it and diagnosed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import panel as pn

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
    report_frame,
    same,
)
from matching.explore.files import Workspace, write_model
from matching.explore.jobs import Ended, Runner, address_of
from matching.explore.recordings import RecordingsTab
from matching.explore.signals import Measurement, in_units_of
from modelling.errors import InputError
from modelling.recordings.readers import read_table
from modelling.units import factor
from modelling.writing import write_all


class MeasurementTab(RecordingsTab):
    """Recordings beside one of the open models."""

    def __init__(self, workspace: Workspace):
        super().__init__(workspace, list(workspace.models))
        self._table: Any = None  # what was simulated last
        self.result = pn.pane.HTML(sizing_mode=WIDE, stylesheets=[PANE_STYLE])
        self.compare = Runner("Simulate", workspace.tasks, self._simulate_words, self._show_simulated)
        self.diagnose = Runner("Diagnose", workspace.tasks, self._diagnose_words, self._show_diagnosis)
        self.keep_as = pn.widgets.TextInput(name="Keep the extended model as", width=340, visible=False)
        self.keep = plain_button("Keep", visible=False)
        self.kept = Message()
        self.same = EquivalentBox(self._equivalent(["RECORDING"], ""))
        self.keep.on_click(lambda _: self._keep())
        self.open_first()

    def panel(self) -> Any:
        """The step's content."""
        return pn.Column(
            opening(
                "Measurement",
                "Recordings beside a model: simulate the inputs of the first, or let the diagnosis name what the model "
                "lacks.",
                self.compare.run,
                self.diagnose.run,
            ),
            self.compare.panel(),
            self.diagnose.panel(),
            *self.recordings_panel(),
            heading("Model against recording"),
            self.result,
            pn.FlexBox(self.keep_as, self.keep, align_items="end"),
            self.kept,
            self.signals,
            self.same,
            sizing_mode=WIDE,
        )

    def channels_changed(self) -> None:
        """Write the channel file as chosen, so that the command shown finds it."""
        try:
            self.same.set(self._equivalent([str(path) for path in self._used()], str(self.write_channels())))
        except InputError as error:
            self.message.say(str(error), wrong=True)

    def _equivalent(self, recordings: list[str], channels: str) -> Equivalent:
        model = str(write_model(self.workspace, self.role.value))
        return same("diagnose", model, recordings, out=self.workspace.out / "diagnosis", channels=channels)

    def _arguments(self, out: str, most: int | None = None) -> list[str]:
        channels, recordings = self.write_channels(), [str(path) for path in self._used()[:most]]
        model = str(write_model(self.workspace, self.role.value))
        return [model, *recordings, "--channels", str(channels), "--out", str(self.workspace.out / out)]

    def _simulate_words(self) -> list[str]:
        return ["simulate", *self._arguments("simulated", 1)]

    def _diagnose_words(self) -> list[str]:
        return ["diagnose", *self._arguments("diagnosis")]

    def _show_simulated(self, _: Ended) -> None:
        self._table = read_table(self.workspace.out / "simulated" / "simulated.csv")
        self.show_signal()

    def draw_model(self, unit: str) -> None:
        """What was simulated of the chosen signal, in the unit of the file."""
        simulated, column = getattr(self, "_table", None), self.signal.value
        name = next((name for name, (chosen, _) in self._choosers.items() if chosen.value == column), "")
        if simulated is None or name not in simulated.names:
            self.simulated.data = {"t": [], "y": []}
            return
        si = next((wanted.si for wanted in wanted_channels(self.system) if wanted.name == name), "")
        drawn = Measurement(Path(), simulated, simulated.names[0])
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


def measurement_tab(workspace: Workspace) -> Any:
    """The step's content, also without a model."""
    if workspace.models:
        return MeasurementTab(workspace).panel()
    return pn.Column(heading("Measurement"), paragraph("Open a model under Files first."))
