"""A result read from the folder that a command or ``save`` wrote it to."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matching.report import RESULTS
from modelling import display
from modelling.display import Displayed
from modelling.errors import InputError


class Entries(dict[str, Any]):
    """A table of a result's file, whose entries are attributes, too."""

    def __getattr__(self, name: str) -> Any:
        try:
            return self[name]
        except KeyError:
            raise AttributeError(f"there is no entry {name!r}, but {', '.join(self)}") from None


@dataclass(frozen=True)
class SavedResult(Displayed):
    """What a result's file holds, entry by entry as attributes: ``saved.status``, ``saved.response_error.after``.

    Attributes
    ----------
    path : Path
        The file.
    command : str
        The command whose result it is.
    content : Entries
    """

    path: Path
    command: str
    content: Entries

    def __getattr__(self, name: str) -> Any:
        return getattr(self.__dict__.get("content", Entries()), name)

    def to_dict(self) -> dict[str, Any]:
        """The content of the file."""
        return self.content

    def plot(self) -> Any:
        """Raise: the figures were drawn when the result was saved.

        Raises
        ------
        InputError
            Names the figures.
        """
        drawn = [name for name in self.content.get("files", ()) if name.endswith(".svg")]
        right = f"open {', '.join(drawn)} in {self.path.parent}" if drawn else "run the command again"
        raise InputError(str(self.path), "holds numbers, from which no figure is drawn again", right)


def load_result(path: Path) -> SavedResult:
    """See :func:`matching.api.load_result`."""
    found = [path] if path.is_file() else [path / name for name in RESULTS if (path / name).is_file()]
    if len(found) > 1:
        raise InputError(str(path), f"holds {len(found)} results", f"name one of {', '.join(map(str, found))}")
    if not found or found[0].name not in RESULTS:
        raise InputError(str(path), "is no result of rigmatch", "give a folder with result.json, map.json or the like")
    try:
        content = json.loads(found[0].read_text(encoding="utf-8"), object_hook=Entries)
    except ValueError as fault:
        raise InputError(str(found[0]), f"is not JSON: {fault}", "save the result again") from None
    if not isinstance(content, Entries):
        raise InputError(str(found[0]), "is no table", "save the result again")
    return SavedResult(found[0], RESULTS[found[0].name][0], content)


@display.html.register
def _(saved: SavedResult) -> str:
    from matching.report.page import preformatted

    return preformatted(str(saved))


@display.files.register
def _(saved: SavedResult, folder: str, made: Any = None) -> display.ResultFiles:
    """The same files again, those that lie beside the result's."""
    here = saved.path.parent.resolve()
    beside = {name: (here / name).resolve() for name in saved.content.get("files", ()) if name != saved.path.name}
    kept = {name: at.read_bytes() for name, at in beside.items() if at.is_relative_to(here) and at.is_file()}
    return saved.path.name, saved.content, kept
