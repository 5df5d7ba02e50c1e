"""What a diagnosis answers, and the data of its figures."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from matching.diagnosis.data.holdout_fidelity import HoldoutFidelity
from matching.diagnosis.data.holdout_residuals import HoldoutData
from matching.diagnosis.fitting.uncertainty import Estimate
from matching.diagnosis.verdict.causes import Candidate, FittedCandidate, NamedCause, estimate_to_dict, finite
from matching.diagnosis.verdict.discrepancy import DiscrepancyCurve
from matching.diagnosis.verdict.kept_table import KeptTable
from modelling.common.display import Displayed
from modelling.effects.first_guess import FittedMotion
from modelling.effects.place import place_in_file, place_in_words
from modelling.model.system import System


@dataclass(frozen=True)
class PlotData:
    """Arrays of the figures, over the fitted samples of all segments one after another.

    Attributes
    ----------
    before, after : FittedMotion
        The motion of the base model and of the extended one.
    measured, residual_before, residual_after : ndarray (t, y)
        SI; NaN where nothing was measured.
    inertias, shafts : dict of str to ndarray (t,)
        Torque that each component of the base model lacks, N·m.
    sensors : list of str
    noise : ndarray (y,)
        SI.
    holdout : HoldoutData
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
class SensorErrors:
    """Root mean square errors of one sensor, SI; NaN where there is no reading."""

    noise: float
    before: float
    after: float
    before_holdout: float
    after_holdout: float


@dataclass(frozen=True)
class Pictured:
    """What the figures show: known before the causes are judged, so that they can be drawn meanwhile.

    Attributes
    ----------
    errors : dict of str to SensorErrors
        By sensor.
    discrepancy : list of DiscrepancyCurve
    plot_data : PlotData
    """

    errors: dict[str, SensorErrors]
    discrepancy: list[DiscrepancyCurve]
    plot_data: PlotData = field(repr=False)


@dataclass(frozen=True)
class PooledErrors:
    """Errors on held-out data over each sensor's range, root mean square over the sensors; NaN without any."""

    nrmse_before: float
    nrmse_after: float
    noise_floor: float


@dataclass(frozen=True)
class RemainingError:
    """Where the error of a sensor that is beyond its noise is largest.

    Attributes
    ----------
    sensor : str
    ratio, worst_ratio : float
        Root mean square in times the noise: of all data, and of the worst time.
    begin, end : float
        The worst time, s.
    slower_than : float
        Period above which the error shows best, s.
    speed, torque : dict of str to (float, float)
        Smallest and largest speed of each inertia, rad/s, and torque of each shaft, N·m, in that time.
    """

    sensor: str
    ratio: float
    worst_ratio: float
    begin: float
    end: float
    slower_than: float
    speed: dict[str, tuple[float, float]]
    torque: dict[str, tuple[float, float]]

    def to_dict(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        return {
            "sensor": self.sensor, "ratio": self.ratio, "worst_ratio": self.worst_ratio,
            "from": self.begin, "to": self.end, "slower_than": self.slower_than,
            "speed": {name: list(span) for name, span in self.speed.items()},
            "torque": {name: list(span) for name, span in self.torque.items()},
        }  # fmt: skip


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
    errors : dict of str to SensorErrors
        By sensor.
    gain : PooledErrors
    fidelity : HoldoutFidelity or None
        R_RVM, R_MU and R_XiL on held-out data, before and after.
    candidates : list of Candidate
        What was refitted in the place of each cause, the most likely first.
    fitted_candidates : list of FittedCandidate
        What was added to the base model by itself, best first.
    rest : list of RemainingError
    discrepancy : list of DiscrepancyCurve
        Smooth torques that would take most of the rest, where that is more than noise.
    next_recording : str or None
    notes : list of str
    extended : System
    plot_data : PlotData
    kept : KeptTable or None
        The curve of ``discrepancy`` that the extended model keeps.
    """

    verdict: str
    causes: list[NamedCause]
    parameters: dict[str, Estimate]
    units: dict[str, str]
    errors: dict[str, SensorErrors]
    gain: PooledErrors
    fidelity: HoldoutFidelity | None
    candidates: list[Candidate]
    fitted_candidates: list[FittedCandidate]
    rest: list[RemainingError]
    discrepancy: list[DiscrepancyCurve]
    next_recording: str | None
    notes: list[str]
    extended: System = field(repr=False)
    plot_data: PlotData = field(repr=False)
    kept: KeptTable | None = None

    @property
    def pictured(self) -> Pictured:
        """What its figures show."""
        return Pictured(self.errors, self.discrepancy, self.plot_data)

    def to_dict(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        return {
            "verdict": self.verdict, "causes": [cause.to_dict() for cause in self.causes],
            "errors": {name: _finite_numbers(vars(errors)) for name, errors in self.errors.items()},
            "gain": _finite_numbers(vars(self.gain)), "fidelity": self.fidelity.to_dict() if self.fidelity else None,
            "candidates": self._candidates_to_dict(), "next_recording": self.next_recording,
            "extended_model": "extended.toml",
            "parameters": {
                name: estimate_to_dict(estimate, self.units[name]) for name, estimate in self.parameters.items()
            },
            "rest": [remaining.to_dict() for remaining in self.rest],
            "discrepancy": [curve.to_dict() for curve in self.discrepancy],
            "kept_discrepancy": self.kept.to_dict() if self.kept else None, "notes": self.notes,
        }  # fmt: skip

    def _candidates_to_dict(self) -> list[dict[str, Any]]:
        """Those in the place of a cause, and every other that was fitted, with why it was not taken."""
        fitted = {(candidate.kind, candidate.at): candidate.to_dict() for candidate in self.fitted_candidates}
        rows = []
        for candidate in self.candidates:
            row = fitted.pop((candidate.kind, candidate.at), {"misfit_holdout": None})
            is_cause = candidate.instead_of == f"{candidate.kind} at {place_in_words(candidate.at)}"
            reason = None if is_cause else row.get("not_taken") or "rival"
            rows.append(
                vars(candidate)
                | {"at": place_in_file(candidate.at), "misfit_holdout": row["misfit_holdout"], "not_taken": reason}
            )
        return rows + list(fitted.values())


def _finite_numbers(values: dict[str, float]) -> dict[str, float | None]:
    return {key: finite(value) for key, value in values.items()}
