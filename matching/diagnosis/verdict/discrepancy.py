"""What no cause explains, with a face: a smooth torque over speed, angle, twist, load or time.

Of each inertia a torque over its speed, its angle, the torque of its shafts and time, of each shaft one over its twist:
a linear spline whose values follow from least squares on the residual of the fit, by the response of the linear model,
after what base parameters and start states can take (weak form: nothing is differentiated). Second differences are
penalised, so that a curve is no rougher than the residual asks for (P-splines; Eilers and Marx, Statistical Science 11,
1996).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from matching.diagnosis.candidates.screening import Screening
from matching.diagnosis.fitting.uncertainty import inflation
from matching.diagnosis.search.hypothesis import Hypothesis
from modelling.effects.first_guess import FittedMotion
from modelling.model.system import System

KNOTS = 9  # of a curve
ROUGHNESS = (1e-6, 1e-4, 1e-2, 1.0)  # weights of the second differences that are tried, of the mean diagonal
SMALLEST_SHARE = 0.05  # of the misfit beyond noise that a curve has to take to be shown
MOST_CURVES = 6
UNITS = {"speed": "rad/s", "angle": "rad", "load": "N*m", "time": "s", "twist": "rad"}


@dataclass(frozen=True)
class DiscrepancyCurve:
    """A torque that the recording asks for beside the extended model.

    Attributes
    ----------
    at : str
        Inertia (torque on it) or shaft (further torque of it, on the second end's side).
    over : str
        ``speed``, ``angle``, ``load`` (sum of the torques of its shafts), ``twist`` or ``time``.
    grid : ndarray (k,)
        SI.
    torque, standard_uncertainty : ndarray (k,)
        N·m. What base parameters and start states can take, as the part in proportion to speed, is not in it.
    share : float
        Of the misfit beyond noise that it would take.
    repeats : float
        Correlation of the curves of both halves of the data; NaN over time.
    """

    at: str
    over: str
    grid: np.ndarray
    torque: np.ndarray
    standard_uncertainty: np.ndarray
    share: float
    repeats: float

    def to_dict(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        return {
            "at": self.at, "over": self.over, "unit": UNITS[self.over], "grid": self.grid.tolist(),
            "torque": self.torque.tolist(), "standard_uncertainty": self.standard_uncertainty.tolist(),
            "share": self.share, "repeats": self.repeats if np.isfinite(self.repeats) else None,
        }  # fmt: skip


def discrepancy_curves(final: Hypothesis) -> list[DiscrepancyCurve]:
    """The curves that would take most of what a hypothesis leaves, best first; none where it leaves only noise."""
    excess = float(final.fit.residual @ final.fit.residual) - final.fit.problem.data.readings_count
    if excess <= 0:
        return []
    screening = Screening(final.fit)
    factor = inflation(final.fit)
    curves = [
        curve
        for at, over, values in _variables(screening.motion, screening.system)
        if (curve := _curve(screening, (at, over), values, excess, factor)) and curve.share > SMALLEST_SHARE
    ]
    return sorted(curves, key=lambda curve: -curve.share)[:MOST_CURVES]


def _variables(motion: FittedMotion, system: System) -> Iterator[tuple[str, str, np.ndarray]]:
    """Place, name and values (t,) of what a torque may depend on."""
    for part in system.inertias:
        at = f"inertias.{part.name}"
        yield at, "speed", motion.speed[part.name]
        yield at, "angle", motion.angle[part.name]
        yield at, "time", motion.time
        loads = [motion.torque[shaft.name] for shaft in system.shafts if part.name in shaft.between]
        if loads:
            yield at, "load", np.sum(loads, axis=0)
    for shaft in system.shafts:
        yield f"shafts.{shaft.name}", "twist", motion.twist[shaft.name]


def _curve(
    screening: Screening, place: tuple[str, str], values: np.ndarray, excess: float, factor: float
) -> DiscrepancyCurve | None:
    """The curve over one variable (t,); None where the variable hardly varies."""
    at, over = place
    grid = np.unique(np.quantile(values, np.linspace(0, 1, KNOTS)))
    if len(grid) < KNOTS or not np.ptp(values) > 0:
        return None
    hats = [np.interp(values, grid, unit) for unit in np.eye(KNOTS)]
    rows = np.array([screening.signature({at: hat}) for hat in hats])
    rows -= (rows @ screening.basis) @ screening.basis.T
    if not np.isfinite(rows).all():
        return None
    torque, covariance = _smooth(rows, screening.residual, factor)
    share = float(2 * torque @ (rows @ screening.residual) - torque @ (rows @ rows.T) @ torque) / excess
    half = np.cumsum(screening.mask.ravel()) <= screening.mask.sum() / 2
    repeats = np.nan
    if over != "time":
        first, second = (_smooth(rows * part, screening.residual * part, factor)[0] for part in (half, ~half))
        repeats = float(np.corrcoef(first, second)[0, 1]) if np.ptp(first) * np.ptp(second) > 0 else np.nan
    return DiscrepancyCurve(at, over, grid, torque, np.sqrt(np.diag(covariance)), min(share, 1.0), repeats)


def _smooth(rows: np.ndarray, residual: np.ndarray, factor: float) -> tuple[np.ndarray, np.ndarray]:
    """Values (k,) at the knots and their covariance (k, k), as rough as generalised cross-validation asks for.

    Parameters
    ----------
    rows : ndarray (k, r)
        What each knot changes in the residual (r,).
    factor : float
        Variance of the residual, correlation included, in times the noise.
    """
    gram, along = rows @ rows.T, rows @ residual
    second_differences = np.diff(np.eye(len(rows)), 2, axis=0)
    unit = float(np.trace(gram)) / len(rows)
    count = max(float(np.count_nonzero(residual)) / factor, len(rows) + 1.0)
    total, best = float(residual @ residual), (np.inf, along, gram)
    for weight in ROUGHNESS:
        inverse = np.linalg.pinv(
            gram + weight * unit * second_differences.T @ second_differences, rcond=1e-10, hermitian=True
        )
        torque = inverse @ along
        left = total - 2 * torque @ along + torque @ gram @ torque
        score = left / (count - float(np.trace(inverse @ gram))) ** 2
        if score < best[0]:
            best = float(score), torque, factor * inverse @ gram @ inverse
    return best[1], best[2]
