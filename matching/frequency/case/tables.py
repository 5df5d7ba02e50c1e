"""Tables and texts of a case file, checked."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from modelling.common.errors import InputError, unknown


def text_of(table: Mapping[str, Any], key: str, where: str) -> str:
    """A text that has to be there.

    Raises
    ------
    InputError
        Naming file and key.
    """
    value = table.get(key)
    if not isinstance(value, str) or not value:
        raise InputError(f"{where}: {key}", "is missing or no text", f'write {key} = "…"')
    return value


def table_of(data: Mapping[str, Any], key: str, where: str, known: set[str] | None = None) -> dict[str, Any]:
    """A table, empty where it is left out; with ``known`` no other keys may stand in it.

    Raises
    ------
    InputError
        Naming file and key.
    """
    table = data.get(key, {})
    if not isinstance(table, dict):
        raise InputError(f"{where}: {key}", "is no table", f"write [{key}]")
    for name in table:
        if known is not None and name not in known:
            raise unknown(name, sorted(known), f"{where}: {key}")
    return table
