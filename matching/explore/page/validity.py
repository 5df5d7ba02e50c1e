"""The tab *Validity*: an uncertainty budget and a fidelity case as tables that can be edited, with their figures."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import panel as pn

from matching.explore.equivalents import Equivalent, fidelity, uncertainty
from matching.explore.files.document import Document
from matching.explore.files.forms import Field, fields, set_field
from matching.explore.files.workspace import Workspace
from matching.explore.page.elements import PANE_STYLE, WIDE, EquivalentBox, Message, heading, paragraph
from matching.report.common.environment import embedded
from matching.report.common.style import image
from matching.report.fidelity.view import as_text as fidelity_text
from matching.report.fidelity.view import plot as fidelity_figure
from matching.report.uncertainty.view import as_text as uncertainty_text
from matching.report.uncertainty.view import plot as uncertainty_figure
from matching.validity.budget.budget_file import budget_from_tables
from matching.validity.fidelity.case_file import fidelity_from_tables
from matching.validity.fidelity.result import xil_fidelity
from matching.validity.uncertainty.evaluate import evaluate
from modelling.common.errors import InputError
from modelling.common.escape import html

DRAWS, SEED = 20_000, 1  # of the fidelity's uncertainty, as its command has them


class EditedTable:
    """A file as a table of fields, with what follows from it.

    Parameters
    ----------
    judge : callable
        Text and figure of the file's content.
    """

    def __init__(self, title: str, document: Document, same: Equivalent, judge: Callable[[dict[str, Any]], Any]):
        self.title, self.document, self._judge = title, document, judge
        self.message, self.rows = Message(), pn.Column(sizing_mode=WIDE)
        self.answer = pn.pane.HTML(sizing_mode=WIDE, stylesheets=[PANE_STYLE])
        self.undo, self.save = (pn.widgets.Button(name=name, width=100) for name in ("Undo", "Save"))
        self.same = EquivalentBox(same)
        self.undo.on_click(lambda _: self._do(self.document.undo))
        self.save.on_click(lambda _: self._do(self.document.save))
        self._do(lambda: None)

    def panel(self) -> Any:
        """Fields, answer, command."""
        return pn.Column(
            heading(self.title), self.rows, self.message, pn.FlexBox(self.undo, self.save), self.answer, self.same,
            sizing_mode=WIDE,
        )  # fmt: skip

    def _do(self, act: Callable[[], Any]) -> None:
        try:
            act()
            text, picture = self._judge(self.document.content)
        except InputError as error:
            self.message.say(str(error), wrong=True)
            return
        self.answer.object = (
            f'<pre tabindex="0" aria-label="Result">{html(text)}</pre>'
            f'<img src="{embedded(image(picture))}" alt="Figure of the result">'
        )
        self.message.say("Changed; not saved yet" if self.document.changed else "")
        self.undo.disabled = self.save.disabled = not self.document.changed
        by_table: dict[str, list[Field]] = {}
        for field in fields(self.document):
            by_table.setdefault(field.table, []).append(field)
        self.rows[:] = [
            pn.FlexBox(*(self._input(table, field) for field in members)) for table, members in by_table.items()
        ]

    def _input(self, table: str, field: Field) -> Any:
        label = f"{table.rpartition(' ')[2]} {field.key}".strip().replace("_", " ")
        widget = pn.widgets.TextInput(name=label, value=field.text, width=230)
        widget.param.watch(partial(self._enter, field), "value")
        return widget

    def _enter(self, field: Field, event: Any) -> None:
        if event.new != field.text:
            self._do(lambda: set_field(self.document, field.keys, event.new, self._judge))


def validity(workspace: Workspace) -> Any:
    """The tab's content."""
    parts = []
    if workspace.budget is not None:
        path, same = workspace.budget.path, uncertainty(str(workspace.budget.path), str(workspace.out / "uncertainty"))

        def judge_budget(content: dict[str, Any]) -> Any:
            evaluated = evaluate(budget_from_tables(content, str(path)))
            return uncertainty_text(evaluated), uncertainty_figure(evaluated)

        parts.append(EditedTable("Uncertainty budget", workspace.budget, same, judge_budget).panel())
    if workspace.fidelity is not None:
        case, same = workspace.fidelity.path, fidelity(str(workspace.fidelity.path), str(workspace.out / "fidelity"))

        def judge_fidelity(content: dict[str, Any]) -> Any:
            judged = xil_fidelity(*fidelity_from_tables(content, case), DRAWS, SEED)
            return fidelity_text(judged), fidelity_figure(judged)

        parts.append(EditedTable("XiL fidelity", workspace.fidelity, same, judge_fidelity).panel())
    if not parts:
        parts.append(paragraph("Open a budget or a fidelity case: rigmatch explore BUDGET FIDELITY_CASE"))
    return pn.Column(*parts, sizing_mode=WIDE)
