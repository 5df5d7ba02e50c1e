"""What a diagnosis says, and what its pictures are drawn from."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from matching.diagnosis.data.holdout_fidelity import HoldoutData
from matching.diagnosis.fitting.uncertainty import Estimate
from modelling.common.display import Displayed
from modelling.effects.first_guess import FittedMotion
from modelling.model.system import System


@dataclass(frozen=True)
class NamedCause:
    """A named cause.

    Attributes
    ----------
    kind, at : str
    parameters : dict of str to (Estimate, str)
        Values with standard uncertainty, and their SI units.
    confidence : float
        0 … 1.
    evidence : str
        One sentence that the pictures let one check.
    alternatives : list of (str, str, float)
        Kind, place and confidence of its rivals.
    gain : float
        χ² without it over χ² with it.
    """

    kind: str
    at: str
    parameters: dict[str, tuple[Estimate, str]]
    confidence: float
    evidence: str
    alternatives: list[tuple[str, str, float]]
    gain: float

    def to_dict(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        parameters = {
            key: {"value": own.value, "standard_uncertainty": finite(own.standard_uncertainty), "unit": unit}
            | ({"note": own.note} if own.note else {})
            for key, (own, unit) in self.parameters.items()
        }
        rivals = [{"kind": kind, "at": at, "confidence": share} for kind, at, share in self.alternatives]
        return {
            "kind": self.kind, "at": self.at, "parameters": parameters, "confidence": self.confidence,
            "evidence": self.evidence, "alternatives": rivals, "gain": finite(self.gain),
        }  # fmt: skip


@dataclass(frozen=True)
class PlotData:
    """Arrays for the report, all over the fitted samples of all segments one after another.

    Attributes
    ----------
    before, after : FittedMotion
        The motion of the base model and of the extended one.
    measured, residual_before, residual_after : ndarray (t, y)
        SI; NaN where nothing was measured.
    inertias, shafts : dict of str to ndarray (t,)
        Torque left over by the base model, N·m, by component.
    sensors : list of str
    noise : ndarray (y,)
    """

    before: FittedMotion
    after: FittedMotion
    measured: np.ndarray
    residual_before: np.ndarray
    residual_after: np.ndarray
    inertias: dict[str, np.ndarray]
    shafts: dict[str, np.ndarray]
    sensors: list[str]
    noise: np.ndarray
    holdout: HoldoutData


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
class Diagnosis(Displayed):
    """The answer.

    Attributes
    ----------
    verdict : str
        ``adequate``, ``explained`` or ``unexplained``.
    causes : list of NamedCause
        Strongest first.
    parameters : dict of str to Estimate
        The base model's uncertain quantities, with the causes in the model.
    units : dict of str to str
    errors : dict of str to dict
        By sensor, root mean squares in SI: noise, before, after, before_holdout, after_holdout.
    gain : dict of str to float
    fidelity : dict or None
        R_RVM, R_MU and R_XiL on unseen data, before and after, see
        :func:`matching.diagnosis.data.holdout_fidelity.fidelity`.
    candidates : list of Candidate
        What was refitted in the place of each cause, the most likely first.
    rest : list of dict
        Where what remains sits.
    next_recording : str or None
    notes : list of str
    extended : System
    plot_data : PlotData
    """

    verdict: str
    causes: list[NamedCause]
    parameters: dict[str, Estimate]
    units: dict[str, str]
    errors: dict[str, dict[str, float | None]]
    gain: dict[str, float | None]
    fidelity: dict[str, Any] | None
    candidates: list[Candidate]
    rest: list[dict[str, Any]]
    next_recording: str | None
    notes: list[str]
    extended: System = field(repr=False)
    plot_data: PlotData = field(repr=False)

    def to_dict(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        parameters = {
            name: {
                "value": own.value,
                "standard_uncertainty": finite(own.standard_uncertainty),
                "unit": self.units[name],
            }
            | ({"note": own.note} if own.note else {})
            for name, own in self.parameters.items()
        }
        return {
            "verdict": self.verdict, "causes": [cause.to_dict() for cause in self.causes], "errors": self.errors,
            "gain": self.gain, "fidelity": self.fidelity, "candidates": [vars(one) for one in self.candidates],
            "next_recording": self.next_recording, "extended_model": "extended.toml",
            "parameters": parameters, "rest": self.rest, "notes": self.notes,
        }  # fmt: skip


def finite(value: float) -> float | None:
    """A number that JSON can hold."""
    return float(value) if math.isfinite(value) else None
