"""The values of a file as fields of a form: which there are, and setting one with the file checked as a whole."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from matching.explore.files.document import Document, Keys
from matching.explore.files.model_document import number_or_text
from modelling.common.errors import InputError

HIDDEN_TEXTS = ("vehicle", "rig", "formula")  # changed in the file, where more than one value belongs together


@dataclass(frozen=True)
class Field:
    """A value of a file that can be written: its table and key for a reader, and where it stands."""

    table: str
    key: str
    keys: Keys
    text: str


def fields(document: Document, tables: Mapping[str, Any] | None = None, above: Keys = ()) -> list[Field]:
    """Every single value of a file, in its order; lists of tables by their number."""
    form: list[Field] = []
    for key, value in (document.content if tables is None else tables).items():
        keys = (*above, key)
        if isinstance(value, Mapping):
            form += fields(document, value, keys)
        elif isinstance(value, list) and value and all(isinstance(each, Mapping) for each in value):
            for number, each in enumerate(value):
                form += fields(document, each, (*keys, number))
        elif isinstance(value, int | float | str) and not isinstance(value, bool) and key not in HIDDEN_TEXTS:
            table = " ".join(str(part + 1) if isinstance(part, int) else part for part in above)
            form.append(Field(table, key, keys, f"{value:.10g}" if isinstance(value, float) else str(value)))
    return form


def set_field(document: Document, keys: Keys, text: str, check: Callable[[dict[str, Any]], Any]) -> Any:
    """Write a value, and return what the file then holds.

    Parameters
    ----------
    check : callable
        Reads the content of the file; what it returns is returned.

    Raises
    ------
    InputError
        If the file is wrong with it; then nothing has changed.
    """
    value = number_or_text(text)
    before = document.value(keys)
    if isinstance(before, float) and isinstance(value, int):
        value = float(value)
    if isinstance(before, str) and isinstance(value, str) is False and not _is_quantity(before):
        raise InputError(".".join(map(str, keys)), f"{text!r} is a number", "write a text")
    document.change(keys, value)
    try:
        return check(document.content)
    except InputError:
        document.undo()
        raise


def _is_quantity(text: str) -> bool:
    return text.strip()[:1] in "+-.0123456789" and bool(text.strip())
