"""Answers of `rigmatch uncertainty` and `rigmatch fidelity` as objects."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from modelling.common.display import Displayed


@dataclass(frozen=True)
class Uncertainty(Displayed):
    """A budget evaluated; ``content`` is that of ``uncertainty.json``."""

    content: dict[str, Any]

    def to_dict(self) -> dict[str, Any]:
        """The content of ``uncertainty.json``."""
        return dict(self.content)

    @property
    def statements(self) -> tuple[str, ...]:
        """The result of every measurand as the GUM wants it written."""
        return tuple(one["statement"] for one in self.content["measurands"])


@dataclass(frozen=True)
class XilFidelity(Displayed):
    """A fidelity assessed; ``content`` is that of ``fidelity.json``."""

    content: dict[str, Any]

    def to_dict(self) -> dict[str, Any]:
        """The content of ``fidelity.json``."""
        return dict(self.content)

    @property
    def R_XiL(self) -> float:
        """The total, 0 … 1."""
        return float(self.content["R_XiL"])

    @property
    def domains(self) -> dict[str, float]:
        """Fidelity of every domain, 0 … 1."""
        return dict(self.content["domains"])
