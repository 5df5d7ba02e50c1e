"""The tab *Validity*: an uncertainty budget and a fidelity case as tables that can be edited, with their figures."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import panel as pn

from matching.explore.equivalents import Equivalent, fidelity, uncertainty
from matching.explore.files.document import Document, Keys
from matching.explore.files.forms import Field, fields, set_field
from matching.explore.files.workspace import Workspace
from matching.explore.page.editing import Editing
from matching.explore.page.elements import PANE_STYLE, WIDE, EquivalentBox, heading, paragraph
from matching.explore.page.widgets.entries import Entry, lay_out
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
from modelling.common.escape import html

DRAWS, SEED = 20_000, 1  # of the fidelity's uncertainty, as its command has them
BUDGET_DRAWS = 200_000  # 10⁴/(1 − 0.95) (JCGM 101, 7.2.2); to decide a check as well takes many seconds


class EditedTable:
    """A file as a table of fields, with what follows from it.

    Parameters
    ----------
    judge : callable
        Text and figure of the file's content.
    """

    def __init__(self, title: str, document: Document, same: Equivalent, judge: Callable[[dict[str, Any]], Any]):
        self.title, self.document, self._judge = title, document, judge
        self.editing = Editing(self._enter, document.undo, lambda: [document], self.refresh, width=230)
        self.rows, self._boxes = pn.Column(sizing_mode=WIDE), dict[str, Any]()
        self.answer = pn.pane.HTML(sizing_mode=WIDE, stylesheets=[PANE_STYLE])
        self.same = EquivalentBox(same)
        self._content: dict[str, Any] = {}  # what was judged last
        self._judged: tuple[str, Any] = ("", None)
        self.editing.do(lambda: "")

    def panel(self) -> Any:
        """Fields, answer, command."""
        return pn.Column(
            heading(self.title), self.rows, self.editing.message, self.editing.buttons(), self.answer, self.same,
            sizing_mode=WIDE,
        )  # fmt: skip

    def refresh(self) -> None:
        """Show the file as it is, and what follows from it."""
        text, picture = self._judged_once(self.document.content)
        self.answer.object = (
            f'<pre tabindex="0" aria-label="Result">{html(text)}</pre>'
            f'<div class="picture" tabindex="0" role="region" aria-label="Figure of {html(self.title)}">'
            f'<img src="{embedded(image(picture))}" alt="Figure of the result"></div>'
        )
        form = fields(self.document)
        by_table: dict[str, list[Any]] = {}
        for field, widget in zip(form, self.editing.entries.show(map(_entry, form)), strict=True):
            by_table.setdefault(field.table, []).append(widget)
        boxes = {name: self._boxes.get(name) or pn.FlexBox() for name in by_table}
        self._boxes = boxes
        for name, members in by_table.items():
            lay_out(boxes[name], members)
        lay_out(self.rows, list(boxes.values()))

    def _enter(self, keys: Keys, text: str) -> str:
        set_field(self.document, keys, text, self._judged_once)
        name = ".".join(map(str, keys)).removesuffix(".value")
        return f"{name} is {text}. {'Changed; not saved yet' if self.document.changed else 'As in the file'}"

    def _judged_once(self, content: dict[str, Any]) -> tuple[str, Any]:
        """Text and figure; judging takes a second, and entering and showing both ask."""
        if content != self._content:
            self._judged = self._judge(content)
            self._content = content
        return self._judged


def _entry(field: Field) -> Entry:
    label = f"{field.table.rpartition(' ')[2]} {field.key}".strip().replace("_", " ")
    return Entry(field.keys, label, field.text)


def validity(workspace: Workspace) -> Any:
    """The tab's content."""
    parts = []
    if workspace.budget is not None:
        path = workspace.budget.path
        same = uncertainty(str(path), str(workspace.out / "uncertainty"), BUDGET_DRAWS)

        def judge_budget(content: dict[str, Any]) -> Any:
            evaluated = evaluate(budget_from_tables(content, str(path)), draws=BUDGET_DRAWS)
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
