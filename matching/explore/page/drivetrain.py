"""The tab *Drivetrain*: the drawing, the values of a part, changes that are marked, undone and saved."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import panel as pn

from matching.explore import equivalents
from matching.explore.files.model_document import part_of
from matching.explore.files.workspace import Workspace
from matching.explore.page.drivetrain_view import DrivetrainView
from matching.explore.page.elements import PANE_STYLE, WIDE, EquivalentBox, Message, heading, paragraph
from matching.explore.pictures import pictures
from matching.report.common.wording import amount, spaced, unit
from matching.report.drawing.figures import LEGEND
from matching.report.drawing.picture import Picture
from matching.report.drawing.svg import Marks, drivetrain_svg
from modelling.common.errors import InputError


class DrivetrainTab:
    """Drawing and values of the open models; ``changed`` is called after every change."""

    def __init__(self, workspace: Workspace, changed: Callable[[], None]):
        self.workspace, self._changed = workspace, changed
        self._role, self._part = next(iter(workspace.models)), ""
        self._pictures: dict[str, Picture] = {}
        self.views = {role: DrivetrainView(sizing_mode=WIDE) for role in workspace.models}
        self.message = Message()
        self.chooser = pn.widgets.Select(name="Part", groups=self._groups(), width=300)
        self.values = pn.Column(sizing_mode=WIDE)
        self.changes = pn.pane.HTML(sizing_mode=WIDE, stylesheets=[PANE_STYLE])
        self.undo = pn.widgets.Button(name="Undo", width=100)
        self.save = pn.widgets.Button(name="Save", button_type="primary", width=100)
        for role, view in self.views.items():
            view.param.watch(partial(self._picked, role), "picked")
        self.chooser.param.watch(lambda event: self.select(*event.new), "value")
        self.undo.on_click(self._undo)
        self.save.on_click(self._save)
        file = workspace.case or workspace.models[self._role]
        self.same = EquivalentBox(equivalents.show(str(file.path), str(workspace.out)))
        self.select(*self.chooser.value)

    def panel(self) -> Any:
        """The tab's content."""
        drawings = [part for role, view in self.views.items() for part in (heading(self._title(role), 2), view)]
        return pn.Column(
            *drawings,
            paragraph(f"Click a part, or choose it below, to see and change its values. {LEGEND}"),
            heading("Values", 2),
            self.chooser,
            self.values,
            self.message,
            self.changes,
            pn.FlexBox(self.undo, self.save),
            self.same,
            sizing_mode=WIDE,
        )

    def select(self, role: str, part: str) -> None:
        """Show the values of a part."""
        self._role, self._part = role, part
        if self.chooser.value != (role, part):
            self.chooser.value = (role, part)
            return
        self.values[:] = self._fields()
        self.refresh()

    def refresh(self) -> None:
        """Draw everything anew; pictures only where a value has changed."""
        for role, view in self.views.items():
            document = self.workspace.models[role]
            chosen = self._part if role == self._role else ""
            marks = Marks(selected=chosen, changed=document.changed_parts)
            view.svg = drivetrain_svg(self._picture(role), marks, reacts=True, prefix=role)
        rows = [
            f"<li>{spaced(role)}: {name}: {amount(before, document.system.units[name])} → "
            f"{amount(after, document.system.units[name])}</li>"
            for role, document in self.workspace.models.items()
            for name, (before, after) in document.changes.items()
        ]
        self.changes.object = f"<p>Not saved:</p><ul>{''.join(rows)}</ul>" if rows else "<p>Everything is saved.</p>"
        self.save.disabled = not rows
        self.undo.disabled = not self._history()

    def after_change(self) -> None:
        """Show values that were changed here or elsewhere."""
        self._pictures.clear()
        self.values[:] = self._fields()
        self.refresh()

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

    def _fields(self) -> list[Any]:
        document = self.workspace.models[self._role]
        names = [name for name in document.system.parameters if part_of(name) == self._part]
        fields = []
        for name in names:
            quantity, si = document.system.parameters[name], unit(document.system.units[name])
            between = (
                f", uncertain: {amount(quantity.lower, '1')} … {amount(quantity.upper, document.system.units[name])}"
                if quantity.uncertain
                else ""
            )
            label = f"{spaced(name.removeprefix(self._part + '.').replace('.', ' '))} [{si or '1'}]{between}"
            field = pn.widgets.TextInput(name=label, value=document.written(name), width=300)
            field.param.watch(partial(self._enter, name), "value")
            fields.append(field)
        return fields

    def _enter(self, name: str, event: Any) -> None:
        document = self.workspace.models[self._role]
        try:
            document.set_text(name, event.new)
        except InputError as error:
            self.message.say(str(error), wrong=True)
            return
        before = document.changes.get(name)
        self.message.say(f"{name} is {event.new}" + ("" if before else ", as in the file"))
        self._after_change()

    def _picked(self, role: str, event: Any) -> None:
        part = event.new.rpartition(" ")[0]
        if any(part_of(name) == part for name in self.workspace.models[role].system.parameters):
            self.select(role, part)
        else:
            self.message.say(f"{spaced(part)} has no values")

    def _history(self) -> list[str]:
        return [role for role, document in self.workspace.models.items() if document.changed]

    def _undo(self, _: Any) -> None:
        changed = self._history()
        role = self._role if self._role in changed else (changed or [""])[0]
        if role and self.workspace.models[role].undo():
            self.message.say("The last change is taken back")
            self._after_change()

    def _save(self, _: Any) -> None:
        try:
            for document in self.workspace.models.values():
                if document.changed:
                    document.save()
        except InputError as error:
            self.message.say(str(error), wrong=True)
            return
        self.message.say("Saved")
        self._after_change()

    def _after_change(self) -> None:
        self.after_change()
        self._changed()
