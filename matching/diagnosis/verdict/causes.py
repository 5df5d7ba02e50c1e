"""A named cause with its parameters, and the candidates that were weighed against it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from matching.diagnosis.fitting.uncertainty import Estimate
from modelling.effects.place import place_in_file


@dataclass(frozen=True)
class CauseParameter:
    """A parameter of a named cause, SI; ``note`` says what is odd about its uncertainty."""

    value: float
    standard_uncertainty: float
    unit: str
    note: str = ""

    def to_dict(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        return estimate_to_dict(self, self.unit)


@dataclass(frozen=True)
class Alternative:
    """A rival of a named cause, with its confidence."""

    kind: str
    at: str
    confidence: float


@dataclass(frozen=True)
class NamedCause:
    """A named cause.

    Attributes
    ----------
    kind, at : str
    parameters : dict of str to CauseParameter
    confidence : float
        0 … 1.
    evidence : str
        One sentence that can be checked in the figures.
    alternatives : list of Alternative
    gain : float
        χ² without it over χ² with it.
    """

    kind: str
    at: str
    parameters: dict[str, CauseParameter]
    confidence: float
    evidence: str
    alternatives: list[Alternative]
    gain: float

    def to_dict(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        return {
            "kind": self.kind, "at": place_in_file(self.at), "confidence": self.confidence, "evidence": self.evidence,
            "parameters": {key: parameter.to_dict() for key, parameter in self.parameters.items()},
            "alternatives": [vars(rival) | {"at": place_in_file(rival.at)} for rival in self.alternatives],
            "gain": finite(self.gain),
        }  # fmt: skip


@dataclass(frozen=True)
class Candidate:
    """A candidate that was refitted in the place of a cause.

    Attributes
    ----------
    kind, at : str
    instead_of : str
        The cause, ``kind at place``; its own row is the cause itself.
    misfit : float
        Root mean square of all residuals of the fit, in times the noise.
    chi_square : float
    confidence : float
        0 … 1, among the candidates for this cause.
    """

    kind: str
    at: str
    instead_of: str
    misfit: float
    chi_square: float
    confidence: float


@dataclass(frozen=True)
class FittedCandidate:
    """A candidate that was added to the base model by itself.

    Attributes
    ----------
    kind, at : str
    misfit, misfit_holdout : float
        Root mean square of all residuals on fitted and on held-out data, in times the noise.
    chi_square : float
        On fitted data.
    not_taken : str
        Why it was not taken: ``not_better``, ``not_physical``, ``beyond_recording``, ``worse_unseen``, ``at_bound`` or
        ``rival``; empty if it was.
    """

    kind: str
    at: str
    misfit: float
    misfit_holdout: float
    chi_square: float
    not_taken: str

    def to_dict(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        return {
            "kind": self.kind, "at": place_in_file(self.at), "instead_of": None, "misfit": self.misfit,
            "misfit_holdout": finite(self.misfit_holdout), "chi_square": self.chi_square, "confidence": 0.0,
            "not_taken": self.not_taken or None,
        }  # fmt: skip


def estimate_to_dict(estimate: Estimate | CauseParameter, unit: str) -> dict[str, Any]:
    """Value, standard uncertainty and note of an estimate as ``diagnosis.json`` holds them."""
    uncertainty = finite(estimate.standard_uncertainty)
    values = {"value": estimate.value, "standard_uncertainty": uncertainty, "unit": unit}
    return values | ({"note": estimate.note} if estimate.note else {})


def finite(value: float) -> float | None:
    """A number that JSON can hold."""
    return float(value) if math.isfinite(value) else None
