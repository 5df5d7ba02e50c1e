"""A line of the lists that a report begins with."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ScreenPoint:
    """One line of a list, and why it stands there."""

    text: str
    reason: str = ""
