"""The tab *Match*: the case as a form, a run with progress, results, and a map that answers what-if questions."""

from __future__ import annotations

import re
from functools import partial
from typing import Any

import panel as pn

from matching.explore import equivalents
from matching.explore.files.case_form import CaseForm, write_case_at
from matching.explore.files.forms import Field
from matching.explore.files.workspace import Workspace
from matching.explore.job import Ended
from matching.explore.page.elements import PANE_STYLE, WIDE, EquivalentBox, Message, heading, paragraph
from matching.explore.page.map_view import MapView
from matching.explore.page.running import Runner, address_of
from matching.frequency.studies.map_axis import quantities
from matching.report.common.wording import component, unit
from matching.report.match.checks import PEAK_UNITS
from matching.report.match.text import summary
from modelling.bed.manoeuvres.shapes import UNITS as MANOEUVRE_UNITS
from modelling.common.errors import InputError
from modelling.common.escape import html

STARTS = 14
TITLES = {
    "move": "What may move (bounds)", "loop": "Loop", "limits": "Limits", "response": "Compared responses",
    "targets": "Target modes", "manoeuvre": "Manoeuvre", "operating_point": "Operating point",
    "uncertainty": "What is not known exactly",
}  # fmt: skip
OPEN = ("move", "loop")  # tables that are shown unfolded


class MatchTab:
    """The open case."""

    def __init__(self, workspace: Workspace, document: Any):
        self.workspace, self.form, self.message = workspace, CaseForm(document), Message()
        self.tables = pn.Column(sizing_mode=WIDE)
        self.added = pn.widgets.Select(name="Let another quantity move", width=340)
        self.held = pn.widgets.Select(name="Hold a quantity that moves", width=340)
        self.add, self.hold = (pn.widgets.Button(name=name, width=100) for name in ("Add", "Hold"))
        self.undo, self.save = (pn.widgets.Button(name=name, width=100) for name in ("Undo", "Save"))
        self.starts = pn.widgets.TextInput(name="Starting points", value=str(STARTS), width=140)
        self.seed = pn.widgets.TextInput(name="Seed", value="0", width=140)
        self.out = workspace.out / "match"
        self.result = pn.pane.HTML(sizing_mode=WIDE, stylesheets=[PANE_STYLE])
        self.runner = Runner("Run the match", self._words, self._show)
        self.map = MapView(workspace, lambda: self.form.case, self._write_at)
        self.same = EquivalentBox(self._equivalent())
        self.add.on_click(lambda _: self._do(lambda: self.form.move(self.added.value)))
        self.hold.on_click(lambda _: self._do(lambda: self.form.hold(self.held.value)))
        self.undo.on_click(lambda _: self._do(self.form.undo))
        self.save.on_click(lambda _: self._do(self.form.document.save))
        for number in (self.starts, self.seed):
            number.param.watch(lambda _: self.same.set(self._equivalent()), "value")
        self.refresh()

    def panel(self) -> Any:
        """The tab's content."""
        return pn.Column(
            heading("Case"),
            self.tables,
            pn.FlexBox(self.added, self.add, self.held, self.hold, align_items="end"),
            self.message,
            pn.FlexBox(self.undo, self.save),
            heading("Run"),
            pn.FlexBox(self.starts, self.seed),
            self.runner.panel(),
            self.result,
            self.map.panel(),
            self.same,
            sizing_mode=WIDE,
        )

    def refresh(self) -> None:
        """Show the form as the case is."""
        by_table = self.form.fields
        self.tables[:] = [
            pn.Card(
                pn.FlexBox(*(self._input(field) for field in by_table[table])),
                title=title, collapsed=table not in OPEN, sizing_mode=WIDE, margin=(4, 5),
            )
            for table, title in TITLES.items()
            if table in by_table
        ]  # fmt: skip
        for chooser, names in ((self.added, self.form.addable), (self.held, [m.name for m in self.form.case.moves])):
            options = {component(name) + f" ({name.partition('.')[0]})": name for name in names}
            chooser.param.update(options=options, value=names[0] if names else None)
        self.save.disabled = self.undo.disabled = not self.form.document.changed

    def _input(self, field: Field) -> Any:
        label = " ".join((*field.table.split()[1:], field.key)).replace("_", " ")
        if field.keys[0] == "move":
            name = str(field.keys[1])
            label = f"{component(name)}, {field.key} [{unit(quantities(self.form.case)[name][1]) or '1'}]"
        elif si := self._unit(field):
            label += f" [{unit(si)}]"
        widget = pn.widgets.TextInput(name=label, value=field.text, width=320)
        widget.param.watch(partial(self._enter, field), "value")
        return widget

    def _unit(self, field: Field) -> str:
        """SI unit of a value of loop, limits or manoeuvre that is written without one; empty where there is none."""
        known = {
            "loop": {name: knob.unit for name, knob in self.form.case.loop.quantities.items()},
            "manoeuvre": MANOEUVRE_UNITS,
            "limits": PEAK_UNITS,
        }.get(str(field.keys[0]), {})
        key = re.split(r"[._](?=[a-z]+$)", field.key)[-1] if field.keys[0] == "limits" else field.key
        written = field.text.strip().partition(" ")[2]  # such as "1 deg"
        return "" if written or known.get(key) == "1" else known.get(key, "")

    def _enter(self, field: Field, event: Any) -> None:
        if event.new != field.text:
            self._do(lambda: self.form.set(field, event.new))

    def _do(self, act: Any) -> None:
        try:
            act()
        except InputError as error:
            self.message.say(str(error), wrong=True)
            return
        self.message.say("Saved" if not self.form.document.changed else "Changed; not saved yet")
        self.refresh()

    def _equivalent(self) -> equivalents.Equivalent:
        return equivalents.match(str(self.form.document.path), str(self.out), self.starts.value, self.seed.value)

    def _words(self) -> list[str]:
        if unsaved := self.workspace.unsaved:
            raise InputError(", ".join(map(str, unsaved)), "has changes that are not saved", "save or undo them")
        more = ["--starts", self.starts.value, "--seed", self.seed.value, "--out", str(self.out)]
        return ["match", str(self.form.document.path), *more]

    def _show(self, ended: Ended) -> None:
        report = address_of(self.out / "report.html", self.workspace.out)
        picture = address_of(self.out / "figures" / "overview.svg", self.workspace.out)
        self.result.object = (
            f'<pre tabindex="0" aria-label="Result">{html(summary(ended.result))}</pre>'
            f'<p><a href="{html(report)}" target="_blank">Open the report</a></p>'
            f'<img src="{html(picture)}" alt="Responses, manoeuvre and target modes of vehicle, rig and matched rig">'
        )

    def _write_at(self, values: dict[str, float]) -> str:
        return str(write_case_at(self.form.case, values, self.workspace.out / "what_if" / "case"))


def match_tab(workspace: Workspace) -> Any:
    """The tab's content, also without a case."""
    if workspace.case is not None:
        return MatchTab(workspace, workspace.case).panel()
    return pn.Column(heading("Match"), paragraph("Open a case to match it: rigmatch explore CASE"), sizing_mode=WIDE)
