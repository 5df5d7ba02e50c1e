"""Files that are edited in fields: what is being typed is never replaced; *Undo*, *Redo* and *Save*."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import panel as pn

from matching.explore.elements import CHOICE_STYLE, Message, plain_button
from modelling.errors import InputError

# --- Text fields that stay while what they show changes: what somebody is typing is never replaced.

WRONG = "wrong"  # CSS class of a field whose text was not taken
# one line, which hides no value; above its field a label is drawn at three quarters of its size
ONE_LINE = "label { max-width: calc(133% - 32px); white-space: nowrap; overflow: hidden; text-overflow: ellipsis; }"
STYLE = f"""
{ONE_LINE}{CHOICE_STYLE}
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


class Savable(Protocol):
    """A file that *Save* writes."""

    path: Path

    @property
    def changed(self) -> bool:
        """Whether something is not saved."""

    def save(self) -> None:
        """Write it."""


class Editing:
    """What a tab needs to edit files.

    The buttons are never greyed out: the browser drops a click on a grey button, and the server would release it only
    after it has taken the value that was typed just before the click.

    Parameters
    ----------
    enter : callable
        Writes a text into a field of the file and returns what to say; raises ``InputError`` where it is wrong.
    undo, redo : callable
        Take the last change back, and make it again; whether there was one.
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
        redo: Callable[[], bool],
        documents: Callable[[], Sequence[Savable]],
        changed: Callable[[], None],
        width: int,
    ):
        self._write, self._take_back, self._make_again = enter, undo, redo
        self._documents, self._changed = documents, changed
        self.message = Message()
        self.entries = Entries(self._enter, width)
        self.undo, self.redo = plain_button("Undo"), plain_button("Redo")
        self.save = pn.widgets.Button(name="Save", button_type="primary", width=100)
        self.undo.on_click(lambda _: self.undo_last())
        self.redo.on_click(lambda _: self.do(self._redo))
        self.save.on_click(lambda _: self.do(self._save))

    def buttons(self) -> Any:
        """*Undo*, *Redo* and *Save* beside each other."""
        return pn.FlexBox(self.undo, self.redo, self.save)

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

    def undo_last(self) -> None:
        """Take the last change back, as *Undo* does."""
        self.do(self._undo)

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

    def _redo(self) -> str:
        return "The change is made again" if self._make_again() else "There is no change to make again"

    def _save(self) -> str:
        self.all_taken()
        changed = [document for document in self._documents() if document.changed]
        for document in changed:
            document.save()
        return f"Saved: {', '.join(document.path.name for document in changed)}" if changed else "Everything is saved"
