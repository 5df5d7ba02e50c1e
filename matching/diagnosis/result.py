"""What a diagnosis answers, and the data of its figures."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.special import chdtrc, erfc

from matching.diagnosis.audit import AuditedChannel
from matching.diagnosis.causes import Cause, simulated_motion
from matching.diagnosis.data import FitData
from matching.diagnosis.descent import Fit, Quadratic, discrepancy, reweighted
from matching.diagnosis.holdout import HoldoutData, HoldoutFidelity
from matching.diagnosis.hypotheses import Hypothesis, at_noise, scatters_only, sensors_beyond_noise, widened
from matching.diagnosis.screening import (
    ScreenedCandidate,
    Screening,
    as_late_as_contact,
    bounded_below,
    fit_extended,
)
from matching.diagnosis.statistics import (
    Estimate,
    at_least,
    covariance,
    discretisation_shift,
    effective_share,
    estimates,
    inflation,
)
from matching.diagnosis.unseen import UnseenData
from matching.diagnosis.windows import window_uncertainties
from modelling.display import Displayed
from modelling.effects import EFFECTS
from modelling.effects.effect import AXES, FittedMotion, TorqueTable, place_in_file, place_in_words, table_parameters
from modelling.errors import FitError
from modelling.system import Effect, Quantity, System

BEST_SO_FAR = "the best answer so far"  # how a note ends that says of a diagnosis that it was ended early

# --- A named cause with its parameters, and the candidates that were weighed against it.


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
        Of the kind, 0 … 1: the least of its share among its rivals and of what a free force at its place leaves of
        that.
    there : float
        Probability that something acts at this place, of whatever kind: that unseen data are met better with it, beyond
        chance; 0 where its values do not differ from those of no effect.
    left : dict of str to (float, float)
        By sensor, root mean square error on unseen data in times the noise, without the cause and with it.
    beside : (str, float)
        What the best free force at its place depends on, and the share that it predicts of what the cause leaves.
    in_model : bool
        Whether the extended model has it: it is there, explains a good part of the misfit and harms no second
        recording. Else it only says where something is.
    why_not : str
        Why the extended model does not have it: ``by_chance``, ``within_uncertainty``, ``explains_little``,
        ``second_recording``, ``map`` or ``table``; else empty.
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
    there: float = 1.0
    left: dict[str, tuple[float, float]] = field(default_factory=dict)
    beside: tuple[str, float] = ("", 0.0)
    in_model: bool = True
    why_not: str = ""

    def to_dict(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        return {
            "kind": self.kind, "at": place_in_file(self.at), "confidence": self.confidence, "evidence": self.evidence,
            "parameters": {key: parameter.to_dict() for key, parameter in self.parameters.items()},
            "alternatives": [vars(rival) | {"at": place_in_file(rival.at)} for rival in self.alternatives],
            "gain": finite(self.gain), "there": self.there, "in_model": self.in_model, "why_not": self.why_not or None,
            "left": {name: {"without": a, "with": b} for name, (a, b) in self.left.items()},
            "beside": {"over": self.beside[0], "share": self.beside[1]},
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
        The reason that decided: ``not_better``, ``not_physical``, ``beyond_recording``, ``worse_unseen``,
        ``by_chance``, ``within_uncertainty``, ``negligible``, ``at_bound``, ``rival`` or ``no_fit``; empty if it was
        taken.
    why : str
        Why it has no fit, where it has none; its numbers are then NaN.
    """

    kind: str
    at: str
    misfit: float
    misfit_holdout: float
    chi_square: float
    not_taken: str
    why: str = ""

    def to_dict(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        return {
            "kind": self.kind, "at": place_in_file(self.at), "instead_of": None, "misfit": finite(self.misfit),
            "misfit_holdout": finite(self.misfit_holdout), "chi_square": finite(self.chi_square), "confidence": 0.0,
            "not_taken": self.not_taken or None,
        } | ({"why": self.why} if self.why else {})  # fmt: skip


def estimate_to_dict(estimate: Estimate | CauseParameter, unit: str) -> dict[str, Any]:
    """Value, standard uncertainty and note of an estimate as ``diagnosis.json`` holds them."""
    uncertainty = finite(estimate.standard_uncertainty)
    values = {"value": estimate.value, "standard_uncertainty": uncertainty, "unit": unit}
    return values | ({"note": estimate.note} if estimate.note else {})


def finite(value: float) -> float | None:
    """A number that JSON can hold."""
    return float(value) if math.isfinite(value) else None


# --- What no cause explains, with a face: a smooth torque over speed, angle, twist, load or time.
#
# Of each inertia a torque over its speed, its angle, the torque of its shafts and time, of each shaft one over its
# twist: a linear spline whose values follow from least squares on the residual of the fit, by the response of the
# linear model, after what base parameters and start states can take (weak form: nothing is differentiated). Second
# differences are penalised, so that a curve is no rougher than the residual asks for (P-splines; Eilers and Marx,
# Statistical Science 11, 1996).

KNOTS = 9  # of a curve
ROUGHNESS = (1e-6, 1e-4, 1e-2, 1.0)  # weights of the second differences that are tried, of the mean diagonal
SMALLEST_SHARE = 0.05  # of the misfit beyond noise that a curve has to take to be shown
CURVE_BLOCKS = 6  # of the data, each foretold by the curve of the others
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
        Of the misfit beyond noise that it would take, each block of the data by the curve of the others.
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
    measured = np.cumsum(screening.mask.ravel()) / screening.mask.sum()
    share = 0.0
    for block in range(CURVE_BLOCKS):
        own = (measured > block / CURVE_BLOCKS) & (measured <= (block + 1) / CURVE_BLOCKS)
        foretold = _smooth(rows * ~own, screening.residual * ~own, factor)[0] @ rows[:, own]
        share += float(2 * foretold @ screening.residual[own] - foretold @ foretold) / excess
    half = measured <= 0.5
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


# --- What no cause explains, kept in the extended model as a table of torque, where that helps on unseen data.

REPEATS = 0.5  # correlation of the curves of both halves of the data, from which a curve is more than chance


@dataclass(frozen=True)
class KeptTable:
    """A curve as an effect of the extended model.

    Attributes
    ----------
    effect : Effect
    over : str
        ``speed``, ``angle`` or ``twist``.
    values : dict of str to float
        Parameters fitted with it, SI by name.
    nrmse_before, nrmse_after : float
        Error of all sensors on unseen data over their ranges, of the extended model without it and with it.
    """

    effect: Effect
    over: str
    values: dict[str, float]
    nrmse_before: float
    nrmse_after: float

    def to_dict(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        return {
            "at": self.effect.at, "over": self.over, "nrmse_before": self.nrmse_before,
            "nrmse_after": self.nrmse_after,
        }  # fmt: skip


def table_effect(curve: DiscrepancyCurve) -> Effect:
    """A curve over speed, angle or twist as an effect."""
    parameters = table_parameters(curve.over, curve.grid.tolist(), curve.torque.tolist())
    return Effect(TorqueTable.kind, curve.at, tuple((key, Quantity(value)) for key, value in parameters.items()))


def kept_table(final: Hypothesis, curves: Sequence[DiscrepancyCurve], unseen: UnseenData) -> KeptTable | None:
    """The best curve that repeats and with which unseen data are met better; None where there is none.

    The parameters of the model are fitted again with it.
    """
    start = final.at_fit()
    for curve in curves:
        if curve.over not in AXES or not curve.repeats > REPEATS:
            continue
        effect = table_effect(curve)
        model = replace(start, base=start.base.with_effects(effect), starts=tuple(final.fit.starts))
        try:
            extended = Hypothesis(model, fit_extended(model, final.fit))
        except FitError:
            continue
        before, after = unseen.error(final), unseen.error(extended)
        if before is not None and after is not None and unseen.keeps(extended, final):
            return KeptTable(effect, curve.over, extended.fit.values, before.pooled, after.pooled)
    return None


# --- Result


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
class Correlation:
    """Correlation of two fitted values, by name."""

    first: str
    second: str
    correlation: float


LEAST_CORRELATION = 0.5  # that is told: below, each uncertainty is nearly that with the other value known
MOST_CORRELATIONS = 12


def correlations(fit: Fit) -> list[Correlation]:
    """Pairs of fitted parameters with a large correlation, the largest first."""
    k, names = len(fit.problem.free), fit.problem.free
    own = covariance(fit, inflation(fit))[:k, :k]
    size = np.sqrt(np.maximum(np.diag(own), 1e-300))
    every = [
        Correlation(names[i], names[j], float(own[i, j] / (size[i] * size[j]))) for i in range(k) for j in range(i)
    ]
    large = [one for one in every if abs(one.correlation) >= LEAST_CORRELATION]
    return sorted(large, key=lambda one: -abs(one.correlation))[:MOST_CORRELATIONS]


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
    channels : list of AuditedChannel
        The audit of the channels.
    judged_by : str
        What decided at last which causes the extended model has: a hold-out (``holdout``), each of several recordings
        by a fit to the others (``recordings``), or blocks of the one recording (``blocks``).
    correlations : list of Correlation
        Of fitted values, the largest first.
    sources : tuple of str
        The recordings that were fitted.
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
    channels: list[AuditedChannel] = field(default_factory=list)
    judged_by: str = "blocks"
    correlations: list[Correlation] = field(default_factory=list)
    sources: tuple[str, ...] = ()

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
            "channels": [channel.to_dict() for channel in self.channels], "judged_by": self.judged_by,
            "correlations": [vars(one) for one in self.correlations],
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


# --- Errors of base and final hypothesis on fitted and held-out data, and where the remaining error is largest.

STATED_TOO_SMALL = 1.1  # times the stated uncertainty, from which scatter is said to be more
WORST_TIME_SHARE, WORST_TIME_SAMPLES = 16, 8  # the worst time is a sixteenth of a segment, at least so many samples


@dataclass(frozen=True)
class _Worst:
    """Samples of a segment and the mean square of the residual there."""

    square: float
    segment: int
    first: int
    last: int


def errors_by_sensor(
    system: System, base: Hypothesis, final: Hypothesis, before_holdout: np.ndarray, after_holdout: np.ndarray
) -> dict[str, SensorErrors]:
    """Root mean square errors of every sensor that was measured, SI.

    Parameters
    ----------
    before_holdout, after_holdout : ndarray (y,)
        On held-out data, in times the noise.
    """
    data = final.fit.problem.data
    before, after = ([test.ratio for test in fit.whiteness()] for fit in (base, final))
    out = {}
    for j, sensor in enumerate(system.sensors):
        if data.readings_by_sensor[j]:
            noise = float(data.noise[j])
            ratios = (before[j], after[j], before_holdout[j], after_holdout[j])
            out[sensor.name] = SensorErrors(noise, *(float(ratio * noise) for ratio in ratios))
    return out


def pooled_errors(whole: FitData, before: np.ndarray, after: np.ndarray) -> PooledErrors:
    """Errors on held-out data over each sensor's range, root mean square over the sensors.

    Parameters
    ----------
    whole : FitData
        Fitted and held-out data, of which the range is taken.
    before, after : ndarray (y,)
        On held-out data, in times the noise; NaN for a sensor without readings.
    """
    readings = np.concatenate([segment.readings for segment in whole.segments])
    measured = np.isfinite(readings).any(axis=0) & np.isfinite(after)
    width = np.zeros(len(whole.noise))
    width[measured] = np.nanmax(readings[:, measured], axis=0) - np.nanmin(readings[:, measured], axis=0)
    pooled = width > 0
    noise = whole.noise[pooled] / width[pooled]

    def rms(ratio: np.ndarray) -> float:
        return float(np.sqrt(np.mean((ratio[pooled] * noise) ** 2))) if pooled.any() else np.nan

    return PooledErrors(rms(before), rms(after), rms(np.ones(len(before))))


def remaining_errors(final: Hypothesis) -> list[RemainingError]:
    """For every sensor whose error is more than noise: when it is largest, with speeds and torques then."""
    problem, tests = final.fit.problem, final.whiteness()
    beyond = sensors_beyond_noise(final)
    if not beyond:
        return []
    motion, out = simulated_motion(final.fit), []
    for j, samples in beyond:
        worst = _worst_time(final, j)
        time, part = problem.data.segments[worst.segment].time, motion.segments[worst.segment]
        then = slice(part.start + worst.first, min(part.start + worst.last, part.stop))
        out.append(
            RemainingError(
                problem.model.sensors[j], tests[j].ratio,
                float(np.sqrt(worst.square)),
                float(time[worst.first]), float(time[min(worst.last, len(time) - 1)]),
                float(samples * np.median(np.diff(time))), _ranges(motion.speed, then), _ranges(motion.torque, then),
            )
        )  # fmt: skip
    return out


def _worst_time(final: Hypothesis, j: int) -> _Worst:
    """When the residual of a sensor is largest."""
    times = []
    for i, residual in enumerate(final.fit.errors):
        length = max(len(residual) // WORST_TIME_SHARE, WORST_TIME_SAMPLES)
        starts = range(0, max(len(residual) - length, 1), length)
        times += [_Worst(float(np.mean(residual[a : a + length, j] ** 2)), i, a, a + length) for a in starts]
    return max(times, key=lambda worst: worst.square)


def _ranges(signals: Mapping[str, np.ndarray], then: slice) -> dict[str, tuple[float, float]]:
    return {name: (float(values[then].min()), float(values[then].max())) for name, values in signals.items()}


def residual_once(final: Hypothesis) -> np.ndarray:
    """Residual (t, y), in times the noise, with every sample once: windows share the last of one and the first of the
    next."""
    segments, parts = final.fit.problem.data.segments, []
    for i, residual in enumerate(final.fit.errors):
        shared = i + 1 < len(segments) and segments[i + 1].name == segments[i].name
        shared = shared and segments[i + 1].time[0] == segments[i].time[-1]
        parts.append(residual[:-1] if shared else residual)
    return np.concatenate(parts)


def scatter_notes(final: Hypothesis) -> list[str]:
    """A sentence for every sensor that scatters by more than its stated uncertainty, where all of them only scatter."""
    if at_noise(final) or not scatters_only(final):
        return []
    sensors = final.fit.problem.system.sensors
    return [
        f"{sensor.name} scatters by {test.ratio:.3g} times its uncertainty, without a pattern: that is stated too small"
        for sensor, test in zip(sensors, final.whiteness(), strict=True)
        if test.ratio > STATED_TOO_SMALL
    ]


# --- What a recording cannot tell from a named cause, by the Fisher information of each candidate beside all others.
#
# Where a speed never changes its sign, friction, a constant torque and an offset change the readings alike. To first
# order a candidate takes the place of a cause as far as what the cause changes, freed of what every fitted quantity can
# change, lies in the span of what the candidate changes, freed likewise; the square of the part that is left is the
# noncentrality of a test between both (Silvey, Statistical Inference, 1975, section 7.2).

TOLD_APART = 9.0  # χ² over its inflation by which a candidate has to fall short of a cause: three standard deviations
ABOVE_NOISE = 4.0  # times that which the cause itself has to explain, or everything would be alike


@dataclass(frozen=True)
class KnownScreening:
    """A screening that the search has made, and the best guess of each candidate of it; none where it is not known."""

    screening: Screening
    screened: Sequence[ScreenedCandidate]

    def of(self, fit: Fit) -> Screening | None:
        """The screening, to be asked something else; None where it is that of another fit."""
        return copy(self.screening) if self.screening.fit is fit else None

    def too_small(self, least: float) -> set[tuple[str, str]]:
        """Kinds and places that take less than that of the residual's length."""
        best: dict[tuple[str, str], float] = {}
        for candidate in self.screened:
            name = candidate.kind_and_place
            best[name] = max(best.get(name, 0.0), candidate.reduction)
        return {name for name, reduction in best.items() if np.sqrt(reduction) < least}


def not_told_apart(
    final: Hypothesis, without: Hypothesis, cause: Cause, inflation: float, known: KnownScreening | None
) -> list[tuple[str, str]]:
    """Kinds and places of no more parameters that a recording cannot tell from a cause, the nearest first.

    Parameters
    ----------
    final, without : Hypothesis
        The final hypothesis, and the same without the cause.
    inflation : float
        By how much χ² overstates what is known.
    known : KnownScreening or None
        Taken where it is that of ``without``.
    """
    fit = without.fit
    if fit.residual.shape != final.fit.residual.shape:  # one of them fitted to windows, where shafts rattle
        return []
    if fit.problem.weighting is not final.fit.problem.weighting:
        fit = reweighted(fit, final.fit.problem.weighting)
    again = known.of(fit) if known else None
    screening = again or Screening(fit)
    left = screening.free(final.fit.residual)
    screening.residual = screening.free(fit.residual) - left
    explained = float(screening.residual @ screening.residual)
    limit = TOLD_APART * inflation
    if explained < ABOVE_NOISE * limit:
        return []
    best: dict[tuple[str, str], float] = {}
    # what takes so little of the whole residual cannot take what the cause took of it: triangle inequality
    least = np.sqrt(explained - limit) - np.linalg.norm(left)
    hopeless = known.too_small(float(least)) if known and again else set()
    for candidate in screening.candidates(without.model.system(), hopeless):
        if len(candidate.parameters) > len(cause.keys) or explained - candidate.reduction > limit:
            continue
        if _within_recorded(candidate, without):
            name = candidate.kind, candidate.at
            best[name] = max(best.get(name, 0.0), candidate.reduction)
    best.pop((cause.kind, cause.at), None)
    return sorted(best, key=lambda name: -best[name])


def _within_recorded(candidate: ScreenedCandidate, without: Hypothesis) -> bool:
    """Whether what a candidate would have to be lies within what the recording has shown."""
    recorded = without.model.recorded
    if recorded is None or EFFECTS[candidate.kind].replaces_quantity:
        return True
    for key, value in candidate.parameters.items():
        low, high = EFFECTS[candidate.kind].bounds_in_recording(key, candidate.at, recorded)
        if not low <= value <= high:
            return False
    return bool(np.isfinite(list(candidate.parameters.values())).all())


# --- How uncertain parameters are where the residual is no white noise of the stated size: model error that is left
# over.
#
# A fit moves a parameter by the sum over time of the influence of each sample: the residuals of all sensors at that
# time, weighted by the covariance and the Jacobian. For white noise the squares of these add up to the covariance. What
# a model leaves is correlated over time and over sensors (an angle and the speed beside it err together), so the
# variance of the sum is that of correlated values: the sum of squares times their integrated autocorrelation time
# (sandwich covariance; White, Econometrica 50, 1982, and for dependent data Newey and West, Econometrica 55, 1987).
#
# An error that is the same all along shows in no scatter. Weighted with a memory, which looks at fast changes, and
# without it, which looks at slow ones, a right model has the same parameters but for noise; what they differ by is what
# the model's error does to them (Hausman, Econometrica 46, 1978).


def influences(fit: Fit) -> np.ndarray:
    """(t, p) by how much the readings of each time moved each fitted parameter, SI; segments one after another."""
    count = len(fit.problem.free)
    weights = fit.jacobian @ covariance(fit)[:, :count]
    weights *= fit.residual[:, None]
    sensors = len(fit.problem.data.noise)
    return weights.reshape(len(weights) // sensors, sensors, count).sum(axis=1)


def correlated_uncertainties(fit: Fit) -> dict[str, float]:
    """Standard uncertainties of the fitted parameters by the scatter of what the samples ask for, SI by name."""
    shift = shift_by_memory(fit)
    out = {}
    for name, influence, moved in zip(fit.problem.free, influences(fit).T, shift, strict=False):
        square = float(influence @ influence)
        scatter = float(np.sqrt(square / effective_share(influence))) if square > 0 else 0.0
        out[name] = max(scatter, abs(float(moved)) / np.sqrt(3))  # anywhere within ±moved (JCGM 100, 4.3.7)
    return out


def shift_by_memory(fit: Fit) -> np.ndarray:
    """How far the variables (v,) move, to first order, where sensors are weighted without memory instead of with it, or
    the other way round; 0 where that does not simulate."""
    problem = fit.problem
    other = reweighted(fit, problem.weighting.without_memory if problem.weighting else discrepancy(fit))
    if not np.isfinite(other.cost):
        return np.zeros(problem.size)
    gradient = other.jacobian.T @ other.residual
    return Quadratic(other.jacobian).step(gradient, problem.lower - fit.v, problem.upper - fit.v, np.inf)[0]


def fitted_values(final: Hypothesis, fits: list[Fit]) -> dict[str, Estimate]:
    """All fitted parameters by name; ``fits`` are equivalent to that of the hypothesis, which comes first."""
    correlated = None if at_noise(final) else correlated_uncertainties(final.fit)
    values = widened(estimates(final.fit, discretisation_shift(final.fit), correlated), fits)
    if any(effect.law.abrupt for effect in final.fit.problem.system.effects):
        values = at_least(values, window_uncertainties(final.fit))
    return bounded_below(as_late_as_contact(values, final.fit, final.causes), final.fit, final.causes)


def cause_parameters(system: System, cause: Cause, estimates: Mapping[str, Estimate]) -> dict[str, CauseParameter]:
    """The parameters of a cause, SI, from the estimates of all fitted ones by name."""
    kind, names = EFFECTS[cause.kind], cause.names()
    values = kind.canonical({key: estimates[name].value for key, name in names.items()})
    return {
        key: CauseParameter(
            values[key], estimates[name].standard_uncertainty, kind.unit(key, cause.at, system), estimates[name].note
        )
        for key, name in names.items()
    }


def differs_from_nothing(final: Hypothesis, cause: Cause, estimates: Mapping[str, Estimate], beyond: float) -> bool:
    """Whether the values of a cause, all together, differ from those of no effect by more than their uncertainty.

    Only sizes count, which may be nothing: no time constant, and of a ripple neither order nor phase. Of values that
    others compensate each may be uncertain where all together are not: their correlations are those of
    the fit (a Wald test, at the probability that a normal error stays within ``beyond`` standard uncertainties).
    """
    kind, fit = EFFECTS[cause.kind], final.fit
    sizes = [
        key for key in cause.keys if (key in kind.zero_mean if kind.zero_mean else kind.parameters[key].lower <= 0)
    ]
    names = [(key, name) for key, name in cause.names().items() if key in (sizes or cause.keys)]
    away = []
    for key, name in names:
        nothing = 1.0 if key.startswith("factor") else 0.0
        if cause.replaces_quantity:
            nothing = final.model.base.parameters[cause.at].value
        away.append(estimates[name].value - nothing)
    sigma = np.array([estimates[name].standard_uncertainty for _, name in names])
    if not np.isfinite(sigma).all():
        return bool((np.abs(away) > beyond * sigma).any())
    columns = [fit.problem.free.index(name) for _, name in names]
    own = covariance(fit, inflation(fit))[np.ix_(columns, columns)]
    size = np.sqrt(np.maximum(np.diag(own), 1e-300))
    correlation = own / np.outer(size, size)
    np.fill_diagonal(correlation, 1.0)
    scaled = np.array(away) / np.maximum(sigma, 1e-300)
    distance = float(scaled @ np.linalg.pinv(correlation, rcond=CERTAIN, hermitian=True) @ scaled)
    return bool(chdtrc(len(names), distance) < erfc(beyond / np.sqrt(2)))


CERTAIN = 1e-6  # of the largest eigenvalue of a correlation: less is rounding
