"""Fields, message, *Undo* and *Save* of files that are edited: the same in every tab."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import panel as pn

from matching.explore.files.document import Document
from matching.explore.page.elements import Message
from matching.explore.page.widgets.entries import Entries
from modelling.common.errors import InputError


class Editing:
    """What a tab needs to edit files.

    The buttons are never greyed out: the browser drops a click on a grey button, and the server would release it only
    after it has taken the value that was typed just before the click.

    Parameters
    ----------
    enter : callable
        Writes a text into a field of the file and returns what to say; raises ``InputError`` where it is wrong.
    undo : callable
        Takes the last change back; whether there was one.
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
        documents: Callable[[], Sequence[Document]],
        changed: Callable[[], None],
        width: int,
    ):
        self._write, self._take_back, self._documents, self._changed = enter, undo, documents, changed
        self.message = Message()
        self.entries = Entries(self._enter, width)
        self.undo = pn.widgets.Button(name="Undo", width=100)
        self.save = pn.widgets.Button(name="Save", button_type="primary", width=100)
        self.undo.on_click(lambda _: self.do(self._undo))
        self.save.on_click(lambda _: self.do(self._save))

    def buttons(self) -> Any:
        """*Undo* and *Save* beside each other."""
        return pn.FlexBox(self.undo, self.save)

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

    def all_taken(self) -> None:
        """Check that every field shows what the file would hold.

        Raises
        ------
        InputError
            If a text was not taken.
        """
        if wrong := self.entries.wrong:
            raise InputError(", ".join(wrong), "was not taken, as said when it was entered", "correct it or press Undo")

    def _enter(self, key: Any, text: str) -> bool:
        return self.do(lambda: self._write(key, text))

    def _undo(self) -> str:
        if self.entries.put_back():
            return "The value in the file is shown again"
        return "The last change is taken back" if self._take_back() else "There is no change to take back"

    def _save(self) -> str:
        self.all_taken()
        changed = [document for document in self._documents() if document.changed]
        for document in changed:
            document.save()
        return f"Saved: {', '.join(document.path.name for document in changed)}" if changed else "Everything is saved"
