"""The tab *Match*: the case as a form, a run with progress, results, and a map that answers what-if questions."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from typing import Any

import panel as pn

from matching.explore import equivalents
from matching.explore.files.as_shown import case_tables, write_case
from matching.explore.files.case_form import CaseForm, write_case_at
from matching.explore.files.document import Keys
from matching.explore.files.forms import Field
from matching.explore.files.workspace import Workspace
from matching.explore.job import Ended
from matching.explore.page.editing import Editing
from matching.explore.page.elements import PANE_STYLE, WIDE, EquivalentBox, heading, offer, paragraph
from matching.explore.page.map_view import MapView
from matching.explore.page.match_result import result_html
from matching.explore.page.running import Runner
from matching.explore.page.widgets.entries import Entry, lay_out
from matching.frequency.studies.map_axis import quantities
from matching.report.common.wording import component, spaced, unit
from matching.report.match.checks import PEAK_UNITS
from modelling.bed.manoeuvres.shapes import UNITS as MANOEUVRE_UNITS
from modelling.bed.structures import STRUCTURES

STARTS = 14
TITLES = {
    "move": "What may move (bounds)", "loop": "Loop", "limits": "Limits", "response": "Compared responses",
    "targets": "Target modes", "manoeuvre": "Manoeuvre", "operating_point": "Operating point",
    "uncertainty": "What is not known exactly",
}  # fmt: skip
PAIRS = {"max-width": "690px"}  # two fields: lower and upper bound beside each other
CHOICES: dict[Keys, tuple[str, ...]] = {("loop", "structure"): tuple(STRUCTURES)}
OPEN = ("move", "loop")  # tables that are shown unfolded


class MatchTab:
    """The open case; ``rig_changed`` is called when values were taken into the rig."""

    def __init__(self, workspace: Workspace, document: Any, rig_changed: Callable[[], None]):
        self.workspace, self._rig_changed = workspace, rig_changed
        self._ordered: dict[str, float] = {}  # of the match that is shown, SI
        self.form = CaseForm(document, partial(case_tables, workspace))
        self.editing = Editing(self._enter, self.form.undo, lambda: [document], self.refresh, width=320)
        self.tables, self._cards = pn.Column(sizing_mode=WIDE), dict[str, Any]()
        self.added = pn.widgets.Select(name="Let another quantity move", width=340)
        self.held = pn.widgets.Select(name="Hold a quantity that moves", width=340)
        self.add, self.hold = (pn.widgets.Button(name=name, width=100) for name in ("Add", "Hold"))
        self.limit = pn.widgets.Select(name="State another limit", width=340)
        self.limit_text = pn.widgets.TextInput(name="at most, or at least for a margin", width=220)
        self.state = pn.widgets.Button(name="State", width=100)
        self.take = pn.widgets.Button(name="Take the order into the rig", width=240, visible=False)
        self.starts = pn.widgets.TextInput(name="Starting points", value=str(STARTS), width=140)
        self.seed = pn.widgets.TextInput(name="Seed", value="0", width=140)
        self.out = workspace.out / "match"
        self.result = pn.pane.HTML(sizing_mode=WIDE, stylesheets=[PANE_STYLE])
        self.runner = Runner("Run the match", self._words, self._show)
        self.same = EquivalentBox(self._equivalent())
        self.map = MapView(workspace, lambda: self.form.case, self._write_at)
        self.add.on_click(lambda _: self.editing.do(self._add))
        self.hold.on_click(lambda _: self.editing.do(self._hold))
        self.state.on_click(lambda _: self.editing.do(self._state))
        self.take.on_click(lambda _: self.editing.do(self._take))
        for number in (self.starts, self.seed):
            number.param.watch(lambda _: self.same.set(self._equivalent()), "value")
        self._ran: list[str] = []  # texts of the files when they were run last
        self.refresh()

    def panel(self) -> Any:
        """The tab's content."""
        return pn.Column(
            heading("Case"),
            self.tables,
            pn.FlexBox(self.added, self.add, self.held, self.hold, align_items="end"),
            pn.FlexBox(self.limit, self.limit_text, self.state, align_items="end"),
            self.editing.message,
            self.editing.buttons(),
            heading("Run"),
            paragraph("A run takes the values as they are shown, saved or not."),
            pn.FlexBox(self.starts, self.seed),
            self.runner.panel(),
            self.result,
            self.take,
            self.same,
            self.map.panel(),
            sizing_mode=WIDE,
        )

    def refresh(self) -> None:
        """Show the form as the case is; fields and tables that are there stay."""
        by_table = self.form.fields
        shown = [(table, field) for table in TITLES for field in by_table.get(table, ())]
        members: dict[str, list[Any]] = {}
        widgets = self.editing.entries.show(self._entry(field) for _, field in shown)
        for (table, _), widget in zip(shown, widgets, strict=True):
            members.setdefault(table, []).append(widget)
        for table in members.keys() - self._cards.keys():
            self._cards[table] = pn.Card(
                pn.FlexBox(styles=PAIRS if table == "move" else {}),
                title=TITLES[table],
                collapsed=table not in OPEN,
                sizing_mode=WIDE,
                margin=(4, 5),
            )
        for table, inside in members.items():
            lay_out(self._cards[table][0], inside)
        lay_out(self.tables, [self._cards[table] for table in members])
        for chooser, names in ((self.added, self.form.addable), (self.held, [m.name for m in self.form.case.moves])):
            offer(chooser, {component(name) + f" ({name.partition('.')[0]})": name for name in names})
        offer(
            self.limit,
            {f"{spaced(key.replace('.', ' '))} [{unit(si) or '1'}]": key for key, si in self.form.statable.items()},
        )
        self.same.set(self._equivalent())
        self.map.refresh()
        if self.result.object and self._texts() != self._ran:
            self.runner.message.say("The result below is of the case before the last change")

    def models_changed(self) -> None:
        """Follow changes of the models in other tabs."""
        self.editing.do(self._read_again)

    def _read_again(self) -> str:
        self.form.read_again()
        return ""

    def _add(self) -> str:
        self.form.move(self.added.value)
        return self._changed_words()

    def _hold(self) -> str:
        self.form.hold(self.held.value)
        return self._changed_words()

    def _state(self) -> str:
        key = self.limit.value
        self.form.limit(key, self.limit_text.value)
        return f"limits.{key} is {self.limit_text.value}. {self._changed_words()}"

    def _take(self) -> str:
        rig = self.workspace.models["rig"]
        ordered = {name: value for name, value in self._ordered.items() if name in rig.system.parameters}
        for name, value in ordered.items():
            rig.set_value(name, value)
        self._rig_changed()
        self.form.read_again()
        return f"Taken into {rig.path.name}, not saved yet: {', '.join(ordered)}. Save it in the tab Drivetrain"

    def _changed_words(self) -> str:
        return "Changed; not saved yet" if self.form.document.changed else "As in the file"

    def _entry(self, field: Field) -> Entry:
        label = " ".join((*field.table.split()[1:], field.key)).replace("_", " ")
        if field.keys[0] == "move":
            name = str(field.keys[1])
            label = f"{component(name)}, {field.key} [{unit(quantities(self.form.case)[name][1]) or '1'}]"
        elif si := self._unit(field):
            label += f" [{unit(si)}]"
        return Entry(field.keys, label, field.text, CHOICES.get(field.keys, ()))

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

    def _enter(self, keys: Keys, text: str) -> str:
        self.form.set(keys, text)
        return f"{'.'.join(map(str, keys))} is {text}. {self._changed_words()}"

    def _equivalent(self) -> equivalents.Equivalent:
        return equivalents.match(str(write_case(self.workspace)), str(self.out), self.starts.value, self.seed.value)

    def _words(self) -> list[str]:
        self.editing.all_taken()
        self._ran = self._texts()
        more = ["--starts", self.starts.value, "--seed", self.seed.value, "--out", str(self.out)]
        return ["match", str(write_case(self.workspace)), *more]

    def _texts(self) -> list[str]:
        return [file.text for file in (self.form.document, *self.workspace.models.values())]

    def _show(self, ended: Ended) -> None:
        self.result.object = result_html(ended.result, self.out, self.workspace.out)
        self._ordered = {trade["name"].removeprefix("rig."): trade["ordered"] for trade in ended.result["adapters"]}
        self.take.visible = bool(self._ordered)

    def _write_at(self, values: dict[str, float]) -> str:
        self.editing.all_taken()
        if not values:
            return str(write_case(self.workspace))
        return str(write_case_at(self.form.case, values, self.workspace.out / "what_if" / "case"))


def without_case() -> Any:
    """The tab's content where no case is open."""
    return pn.Column(heading("Match"), paragraph("Open a case to match it: rigmatch explore CASE"), sizing_mode=WIDE)
