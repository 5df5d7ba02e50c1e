"""What recordings of the controlled bed show beside vehicle and prediction."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from matching.bed_test.modes import MeasuredMode
from modelling.common.display import Displayed

COVERAGE_FACTOR = 2.0


@dataclass(frozen=True)
class ErrorJudgement:
    """A response error of the bed, measured and predicted at the same frequencies.

    Attributes
    ----------
    name : str
        ``measured`` or ``unmeasured`` torques, or ``INPUT → SENSOR``.
    value, uncertainty : float
        Response error and its standard uncertainty; NaN where nothing determines it.
    predicted, expected, allowed : float
        By the match for the bed as planned; what 95 % of beds drawn from ``[uncertainty]`` keep below; by the case.
    resolved : float
        Share of the functions that the recordings show: only these count.
    status : str
        ``as_predicted``, ``short`` or ``undetermined``.
    """

    name: str
    value: float
    uncertainty: float
    predicted: float
    expected: float
    allowed: float
    resolved: float
    status: str

    def to_dict(self) -> dict[str, Any]:
        """As ``verification.json`` holds it; what is not determined is null."""
        known = math.isfinite(self.value) and math.isfinite(self.uncertainty)
        return {
            "name": self.name, "error": self.value if known else None,
            "standard_uncertainty": self.uncertainty if known else None, "predicted": self.predicted,
            "expected": self.expected, "allowed": self.allowed, "resolved": self.resolved, "status": self.status,
        }  # fmt: skip


@dataclass(frozen=True)
class ModeJudgement:
    """A target mode: vehicle and prediction (Hz, damping ratio), and what was measured, None where it does not show."""

    number: int
    vehicle: tuple[float, float]
    predicted: tuple[float, float] | None
    measured: MeasuredMode | None
    status: str

    def to_dict(self) -> dict[str, Any]:
        """As ``verification.json`` holds it."""

        def pair(values: tuple[float, float] | None) -> dict[str, float] | None:
            return None if values is None else {"frequency": values[0], "damping_ratio": values[1]}

        return {
            "vehicle_mode": self.number, "vehicle": pair(self.vehicle), "predicted": pair(self.predicted),
            "measured": None if self.measured is None else dict(vars(self.measured)), "status": self.status,
        }  # fmt: skip


@dataclass(frozen=True)
class RecordedFidelity:
    """XiL fidelity of one recording of the bed against the vehicle's model on the recorded torques (Eqs. 14 to 23).

    Attributes
    ----------
    recording : str
        Path of its file.
    system_dynamics, measurement_uncertainty : float or None
        R_SD and R_MU; None where the recording or the case has nothing to judge them by.
    total, standard_uncertainty : float
        R_XiL and its standard uncertainty.
    of_vehicle : float
        The part of the uncertainty that comes from the vehicle's model.
    interval : tuple of float
        95 % interval of R_XiL.
    """

    recording: str
    system_dynamics: float | None
    measurement_uncertainty: float | None
    total: float
    standard_uncertainty: float
    of_vehicle: float
    interval: tuple[float, float]

    def to_dict(self) -> dict[str, Any]:
        """As ``verification.json`` holds it."""
        return {
            "recording": self.recording, "R_SD": self.system_dynamics, "R_MU": self.measurement_uncertainty,
            "R_XiL": self.total, "standard_uncertainty": self.standard_uncertainty, "of_vehicle": self.of_vehicle,
            "interval": list(self.interval),
        }  # fmt: skip


@dataclass(frozen=True)
class FunctionCurves:
    """One compared function at frequencies (f,): measured with standard uncertainty of its modulus, and the others.

    ``unit`` is the SI unit of the sensor, per N·m.
    """

    input: str
    sensor: str
    unit: str
    frequencies: np.ndarray = field(repr=False)
    measured: np.ndarray = field(repr=False)
    uncertainty: np.ndarray = field(repr=False)
    vehicle: np.ndarray = field(repr=False)
    predicted: np.ndarray = field(repr=False)


@dataclass(frozen=True)
class BedVerification(Displayed):
    """The judgement of recordings of a controlled bed.

    Attributes
    ----------
    status : str
        ``as_predicted``, ``short`` where something measured is worse than predicted and than allowed, beyond its
        uncertainty, or ``undetermined``.
    errors, functions : tuple of ErrorJudgement
        By kind of torque, and by compared function.
    modes : tuple of ModeJudgement
    fidelity : tuple of RecordedFidelity
        Of every recording.
    curves : tuple of FunctionCurves
    band : tuple of float
        Hz.
    notes : tuple of str
    """

    title: str
    status: str
    band: tuple[float, float]
    errors: tuple[ErrorJudgement, ...]
    functions: tuple[ErrorJudgement, ...]
    modes: tuple[ModeJudgement, ...]
    fidelity: tuple[RecordedFidelity, ...]
    curves: tuple[FunctionCurves, ...]
    notes: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """As ``verification.json`` holds it."""
        return {
            "title": self.title,
            "status": self.status,
            "band": list(self.band),
            "coverage_factor": COVERAGE_FACTOR,
            "errors": [error.to_dict() for error in self.errors],
            "functions": [function.to_dict() for function in self.functions],
            "modes": [mode.to_dict() for mode in self.modes],
            "fidelity": [fidelity.to_dict() for fidelity in self.fidelity],
            "notes": list(self.notes),
        }
