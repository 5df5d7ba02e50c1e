"""A case as a form: what may move within which bounds, what is held; the case beside it at other values."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from matching.explore.files.document import Document, Keys
from matching.explore.files.forms import Field, fields, set_field
from matching.explore.files.model_document import number_or_text
from matching.frequency.case.case import Case
from matching.frequency.case.case_file import case_files
from matching.frequency.case.load import case_from_tables
from matching.frequency.case.load_limits import limit_units
from matching.frequency.studies.map_axis import quantities
from matching.frequency.studies.map_point import held_at
from modelling.common.errors import unknown
from modelling.writing.output import write_all

FORM_TABLES = ("loop", "limits", "response", "move", "targets", "manoeuvre", "operating_point", "uncertainty")
SPREAD = 2.0  # a quantity that begins to move may do so by this factor up and down


class CaseForm:
    """An open case file with its fields.

    Parameters
    ----------
    document : Document
    with_models : callable, optional
        The content of the case with its models as they are edited; as they are saved without it.

    Attributes
    ----------
    case : Case
        With all changes, saved or not.

    Raises
    ------
    InputError
        If the case is wrong.
    """

    def __init__(self, document: Document, with_models: Callable[[dict[str, Any]], dict[str, Any]] = dict):
        self.document, self._with_models = document, with_models
        self.case: Case = self._read(document.content)

    @property
    def fields(self) -> dict[str, list[Field]]:
        """Fields by table of the file."""
        by_table: dict[str, list[Field]] = {}
        for field in fields(self.document):
            if field.keys[0] in FORM_TABLES:
                by_table.setdefault(str(field.keys[0]), []).append(field)
        return by_table

    @property
    def addable(self) -> list[str]:
        """Quantities that might move and do not yet."""
        moving = {name for move in self.case.moves for name in move.together}
        return [name for name in quantities(self.case) if name not in moving]

    @property
    def statable(self) -> dict[str, str]:
        """Units of limits that the case might state and does not, by their key."""
        stated = self.document.content.get("limits", {})
        return {key: si for key, si in limit_units(self.case.rig).items() if key not in stated}

    def set(self, keys: Keys, text: str) -> None:
        """Write the field at ``keys``; raises ``InputError`` where the case is wrong with it; then nothing changed."""
        self.case = set_field(self.document, keys, text, self._read)

    def move(self, name: str) -> None:
        """Let a quantity move, by a factor of two up and down to begin with.

        Raises
        ------
        InputError
            If the name is unknown, or the case is wrong with it.
        """
        if name not in self.addable:
            raise unknown(name, self.addable, "move")
        value = quantities(self.case)[name][0]
        bounds = {"lower": value / SPREAD, "upper": value * SPREAD if value else 1.0}
        self._change(("move", name), bounds)

    def limit(self, key: str, text: str) -> None:
        """State a limit; raises ``InputError`` where it is none, or the case is wrong with it."""
        self._change(("limits", key), number_or_text(text))

    def hold(self, name: str) -> None:
        """Let a quantity stay; raises ``InputError`` where the case is wrong without it."""
        text = self.document.without(("move", name))
        self._take(text)

    def undo(self) -> bool:
        """Take the last change back; whether there was one."""
        undone = self.document.undo()
        self.read_again()
        return undone

    def read_again(self) -> None:
        """Take the models as they are by now; raises ``InputError`` where the case is wrong with them."""
        self.case = self._read(self.document.content)

    def _change(self, keys: tuple[str, str], value: Any) -> None:
        table, key = keys
        first = table not in self.document.content
        self._take(self.document.replaced((table,), {key: value}) if first else self.document.replaced(keys, value))

    def _take(self, text: str) -> None:
        self.document.change_text(text)
        try:
            self.case = self._read(self.document.content)
        except BaseException:
            self.document.undo()
            raise

    def _read(self, content: dict[str, Any]) -> Case:
        return case_from_tables(self._with_models(content), str(self.document.path))


def write_case_at(case: Case, values: Mapping[str, float], folder: Path) -> Path:
    """Write the case with quantities (SI) held at values, all its models beside it; the path of the case file.

    Raises
    ------
    InputError
        If a name is unknown, a value impossible, or nothing would be left to move.
    """
    for name, value in values.items():
        case = held_at(case, name, value)
    write_all(folder, dict(case_files(case)))
    return folder / "case.toml"
