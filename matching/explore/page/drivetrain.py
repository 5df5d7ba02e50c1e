"""The tab *Drivetrain*: the drawing, the values of a part, changes that are marked, undone and saved."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import panel as pn

from matching.explore import equivalents
from matching.explore.files.as_shown import write_case, write_model
from matching.explore.files.document import Document
from matching.explore.files.model_document import part_of
from matching.explore.files.workspace import Workspace
from matching.explore.page.editing import Editing
from matching.explore.page.elements import PANE_STYLE, WIDE, EquivalentBox, heading, paragraph
from matching.explore.page.widgets.drivetrain_view import DrivetrainView
from matching.explore.page.widgets.entries import Entry, lay_out
from matching.explore.pictures import pictures
from matching.report.common.wording import amount, spaced, unit
from matching.report.drawing.figures import LEGEND
from matching.report.drawing.picture import Picture
from matching.report.drawing.svg import Marks, drivetrain_svg
from modelling.common.escape import html


class DrivetrainTab:
    """Drawing and values of the open models; ``changed`` is called after every change."""

    def __init__(self, workspace: Workspace, changed: Callable[[], None]):
        self.workspace, self._changed = workspace, changed
        self._role, self._part = next(iter(workspace.models)), ""
        self._pictures: dict[str, Picture] = {}
        self.views = {role: DrivetrainView(label=f"the {spaced(role)}", sizing_mode=WIDE) for role in workspace.models}
        self.editing = Editing(self._enter, self._undo, self._documents, self._after_change, width=300)
        self.chooser = pn.widgets.Select(name="Part", groups=self._groups(), width=300)
        self.values = pn.Column(sizing_mode=WIDE)
        self.changes = pn.pane.HTML(sizing_mode=WIDE, stylesheets=[PANE_STYLE])
        for role, view in self.views.items():
            view.param.watch(partial(self._picked, role), "picked")
        self.chooser.param.watch(lambda event: self.select(*event.new), "value")
        self.same = EquivalentBox(self._equivalent())
        self.select(*self.chooser.value)

    def panel(self) -> Any:
        """The tab's content."""
        drawings = [part for role, view in self.views.items() for part in (heading(self._title(role), 2), view)]
        return pn.Column(
            *drawings,
            paragraph(
                f"Click a part, or choose it below, to see and change its values. {LEGEND[0].upper()}{LEGEND[1:]}."
            ),
            heading("Values", 2),
            self.chooser,
            self.values,
            self.editing.message,
            self.changes,
            self.editing.buttons(),
            self.same,
            sizing_mode=WIDE,
        )

    def select(self, role: str, part: str) -> None:
        """Show the values of a part."""
        self._role, self._part = role, part
        if self.chooser.value != (role, part):
            self.chooser.value = (role, part)
            return
        lay_out(self.values, self.editing.entries.show(self._entries()))
        self.refresh()

    def refresh(self) -> None:
        """Draw everything anew; pictures only where a value has changed."""
        for role, view in self.views.items():
            document = self.workspace.models[role]
            chosen = self._part if role == self._role else ""
            marks = Marks(selected=chosen, changed=document.changed_parts)
            view.svg = drivetrain_svg(self._picture(role), marks, reacts=True, prefix=role)
        rows = [
            html(
                f"{spaced(role)}: {name}: {amount(before, document.system.units[name])} → "
                f"{amount(after, document.system.units[name])}"
            )
            for role, document in self.workspace.models.items()
            for name, (before, after) in document.changes.items()
        ]
        listed = "".join(f"<li>{row}</li>" for row in rows)
        self.same.set(self._equivalent())
        self.changes.object = f"<p>Not saved:</p><ul>{listed}</ul>" if rows else "<p>Everything is saved.</p>"

    def after_change(self) -> None:
        """Show values that were changed here or elsewhere."""
        self._pictures.clear()
        lay_out(self.values, self.editing.entries.show(self._entries()))
        self.refresh()

    def _equivalent(self) -> equivalents.Equivalent:
        has_case = self.workspace.case is not None
        file = write_case(self.workspace) if has_case else write_model(self.workspace, self._role)
        return equivalents.show(str(file), str(self.workspace.out))

    def _groups(self) -> dict[str, dict[str, tuple[str, str]]]:
        groups = {}
        for role, document in self.workspace.models.items():
            names = dict.fromkeys(part_of(name) for name in document.system.parameters)
            groups[role] = {f"{role}: {spaced(name.replace('.', ' '))}": (role, name) for name in names}
        return groups

    def _title(self, role: str) -> str:
        title = self.workspace.models[role].system.title
        return f"{role.capitalize()}: {title}" if title else role.capitalize()

    def _picture(self, role: str) -> Picture:
        if role not in self._pictures:
            self._pictures |= pictures(self.workspace)
        return self._pictures[role]

    def _entries(self) -> list[Entry]:
        document = self.workspace.models[self._role]
        entries = []
        for name in (name for name in document.system.parameters if part_of(name) == self._part):
            quantity, si = document.system.parameters[name], unit(document.system.units[name])
            between = (
                f", uncertain: {amount(quantity.lower, '1')} … {amount(quantity.upper, document.system.units[name])}"
                if quantity.uncertain
                else ""
            )
            label = f"{spaced(name.removeprefix(self._part + '.').replace('.', ' '))} [{si or '1'}]{between}"
            entries.append(Entry((self._role, name), label, document.written(name)))
        return entries

    def _enter(self, place: tuple[str, str], text: str) -> str:
        role, name = place
        document = self.workspace.models[role]
        document.set_text(name, text)
        return f"{name} is {text}" + ("" if name in document.changes else ", as in the file")

    def _picked(self, role: str, event: Any) -> None:
        part = event.new.rpartition(" ")[0]
        if any(part_of(name) == part for name in self.workspace.models[role].system.parameters):
            self.select(role, part)
        else:
            self.editing.message.say(f"{spaced(part)} has no values")

    def _undo(self) -> bool:
        changed = [role for role, document in self.workspace.models.items() if document.changed]
        role = self._role if self._role in changed else (changed or [self._role])[0]
        return self.workspace.models[role].undo()

    def _documents(self) -> list[Document]:
        return list(self.workspace.models.values())

    def _after_change(self) -> None:
        self.after_change()
        self._changed()
