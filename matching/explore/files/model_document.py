"""A model file that is edited by the names of its quantities."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matching.explore.files.document import Document, Keys
from modelling.common.errors import InputError, unknown
from modelling.effects.place import shared_place
from modelling.model.components import TABLES_WITH_QUANTITIES
from modelling.model.files import from_dict
from modelling.units import factor

DIGITS = 6  # of a value that a slider sets


class ModelDocument(Document):
    """A model file with its system.

    Attributes
    ----------
    system : System
        With all changes, saved or not.

    Raises
    ------
    InputError
        As :func:`modelling.model.files.load` does.
    """

    def __init__(self, path: str | Path):
        super().__init__(path)
        self.system = from_dict(self.content, str(path))
        self._saved = self.system

    @property
    def changes(self) -> dict[str, tuple[float, float]]:
        """Saved and present value (SI) of every quantity that differs, by name."""
        before, after = self._saved.parameters, self.system.parameters
        return {name: (before[name].value, after[name].value) for name in after if before[name] != after[name]}

    @property
    def changed_parts(self) -> frozenset[str]:
        """Parts with a changed quantity, as ``shafts.link``."""
        return frozenset(part_of(name) for name in self.changes)

    def written(self, name: str) -> str:
        """A quantity's value as the file writes it, unit included if it has one there."""
        value = self._bare(name)
        return value if isinstance(value, str) else f"{value:g}" if isinstance(value, float) else str(value)

    def set_text(self, name: str, text: str) -> None:
        """Set a quantity to what a user wrote: a number in SI, or a number with a unit.

        Raises
        ------
        InputError
            If it is no such number, or the model is none with it; then nothing has changed.
        """
        self._set(name, number_or_text(text))

    def set_value(self, name: str, value: float) -> None:
        """Set a quantity to a value in SI; it is written in the unit that the file has for it.

        Raises
        ------
        InputError
            If the model is none with it; then nothing has changed.
        """
        before = self._bare(name)
        unit = before.strip().lstrip("+-0123456789.eE").strip() if isinstance(before, str) else ""
        scale = factor(unit, self.system.units[name]) if unit else 1.0
        rounded = float(f"{value / scale:.{DIGITS}g}")
        self._set(name, f"{rounded:g} {unit}" if unit else rounded)

    def undo(self) -> bool:
        """Take the last change back; whether there was one."""
        undone = super().undo()
        self.system = from_dict(self.content, str(self.path))
        return undone

    def save(self) -> None:
        """Write the file; raises as :meth:`Document.save` does."""
        super().save()
        self._saved = self.system

    def _set(self, name: str, value: Any) -> None:
        keys = self._keys(name)
        if isinstance(self._value_in_file(keys), Mapping):
            keys = (*keys, "value")
        text = self.replaced(keys, value)
        before = self.system
        self.change_text(text)
        try:
            self.system = from_dict(self.content, str(self.path))
        except InputError:
            Document.undo(self)
            self.system = before
            raise

    def _bare(self, name: str) -> Any:
        value = self._value_in_file(self._keys(name))
        if value is None:
            return self.system.parameters[name].value
        return value["value"] if isinstance(value, Mapping) else value

    def _value_in_file(self, keys: Keys) -> Any:
        """None where the file leaves a quantity at its default."""
        try:
            return self.value(keys)
        except KeyError:
            return None

    def _keys(self, name: str) -> Keys:
        """Where a quantity stands in the file."""
        if name not in self.system.parameters:
            raise unknown(name, list(self.system.parameters), str(self.path))
        for number, effect in enumerate(self.content.get("effects", ())):
            at = effect["at"]
            place = shared_place(at) if isinstance(at, list) else at
            if name.startswith(f"{place}.{effect['kind']}."):
                return ("effects", number, name.removeprefix(f"{place}.{effect['kind']}."))
        table, part, key = name.split(".", 2)
        return table, part, key


def part_of(name: str) -> str:
    """The part that a quantity belongs to: ``shafts.link`` of ``shafts.link.backlash.gap``."""
    table, _, rest = name.partition(".")
    return f"{table}.{rest.partition('.')[0]}" if table in (*TABLES_WITH_QUANTITIES, "inputs", "sensors") else name


def number_or_text(text: str) -> float | int | str:
    """What a user wrote as TOML has it: a number where it is one, else text with a unit."""
    bare = text.strip()
    for kind in (int, float):
        try:
            return kind(bare)
        except ValueError:
            continue
    return bare
