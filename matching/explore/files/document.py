"""A TOML file that is edited: values change, comments and order stay, every change can be undone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from modelling.common.errors import InputError
from modelling.common.tables import read_toml
from modelling.writing.output import write_all

Keys = tuple[str | int, ...]  # of tables and places in lists, from the top of the file to a value


class Document:
    """The text of a TOML file with its changes.

    Attributes
    ----------
    path : Path
    text : str
        As it would be saved.

    Raises
    ------
    InputError
        If the file cannot be read, or tomlkit is not installed.
    """

    def __init__(self, path: str | Path):
        self.path = Path(path)
        read_toml(self.path)  # one line that says what is wrong, and the limits of size
        self._texts = [self.path.read_bytes().decode()]

    @property
    def text(self) -> str:
        """As it would be saved."""
        return self._texts[-1]

    @property
    def content(self) -> dict[str, Any]:
        """What the text holds, in Python's own types."""
        return _toolkit().parse(self.text).unwrap()

    @property
    def saved_content(self) -> dict[str, Any]:
        """What the file held when it was opened or last saved."""
        return _toolkit().parse(self._texts[0]).unwrap()

    @property
    def changed(self) -> bool:
        """Whether something is not saved."""
        return self.text != self._texts[0]

    def value(self, keys: Keys) -> Any:
        """The value at a place, as the file writes it (number, text with unit, table).

        Raises
        ------
        KeyError
            If there is none.
        """
        return _at(self.content, keys)

    def replaced(self, keys: Keys, value: Any) -> str:
        """The text with another value at a place; the value's comment stays. A missing last key is added."""
        return edited(self.text, {keys: value})

    def without(self, keys: Keys) -> str:
        """The text without a value."""
        document = _toolkit().parse(self.text)
        del _at(document, keys[:-1])[keys[-1]]
        return _toolkit().dumps(document)

    def change(self, keys: Keys, value: Any) -> None:
        """Put another value at a place."""
        self.change_text(self.replaced(keys, value))

    def change_text(self, text: str) -> None:
        """Take a whole text as a change."""
        if text != self.text:
            self._texts.append(text)

    def undo(self) -> bool:
        """Take the last change back; whether there was one."""
        if len(self._texts) == 1:
            return False
        self._texts.pop()
        return True

    def save(self) -> None:
        """Write the file; it is whole at every moment.

        Raises
        ------
        InputError
            If it was changed by something else meanwhile, or cannot be written.
        """
        if self.path.read_bytes().decode() != self._texts[0]:
            raise InputError(str(self.path), "was changed by another program since it was opened", "open it again")
        write_all(self.path.parent, {self.path.name: self.text.encode()})
        self._texts = [self.text]


def edited(text: str, values: Mapping[Keys, Any]) -> str:
    """The text of a TOML file with other values at some places; a missing last key is added.

    Raises
    ------
    InputError
        If tomlkit is not installed.
    """
    document = _toolkit().parse(text)
    for keys, value in values.items():
        _at(document, keys[:-1])[keys[-1]] = value
    return str(_toolkit().dumps(document))


def _at(content: Any, keys: Sequence[str | int]) -> Any:
    for key in keys:
        content = content[key]
    return content


def _toolkit() -> Any:
    try:
        import tomlkit
    except ImportError:
        raise InputError("tomlkit", "is not installed", 'in rigmatch\'s folder: pip install -e ".[explore]"') from None
    return tomlkit
