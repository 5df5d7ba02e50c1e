"""Places of effects: one ``table.name``, or several inputs or sensors that share one effect."""

from __future__ import annotations

from collections.abc import Iterable

SHARED = "+"  # between the places of a shared effect; no name may hold it


def shared_place(places: Iterable[str]) -> str:
    """The place of an effect that several inputs or sensors share: ``sensors.a+sensors.b``."""
    return SHARED.join(places)


def members(at: str) -> tuple[str, ...]:
    """The inputs or sensors that share an effect; of any other place, itself."""
    return tuple(at.split(SHARED))


def place_in_file(at: str) -> str | list[str]:
    """A place as files write it: a text, of a shared effect a list of texts."""
    places = members(at)
    return list(places) if len(places) > 1 else at


def place_in_words(at: str) -> str:
    """A place for a sentence: ``sensors.a and sensors.b``."""
    *first, last = members(at)
    return f"{', '.join(first)} and {last}" if first else last
