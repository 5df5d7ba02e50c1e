"""A hold-out recording: what fitted models leave of it; and the fidelity of both models on unseen data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from matching.diagnosis.data import FitData, Segment
from matching.diagnosis.descent import Fit, FitOptions, solve
from matching.diagnosis.problem import FitProblem, first_state, flank_shifts
from modelling.fidelity.measures import (
    WEIGHTS,
    Fidelity,
    FidelityMethod,
    SensorUncertainty,
    SignalFidelity,
    SignalPair,
    assemble,
    assess_signal,
    delay_fidelity,
    dynamics_fidelity,
    fidelity_distribution,
)
from modelling.recordings.recording import longest_bridge
from modelling.system import System

# --- What base and extended model leave of held-out data, side by side on one time axis.


@dataclass(frozen=True)
class ModelResiduals:
    """Residuals of one model: on each segment (t, y), measured − simulated, in times the noise."""

    segments: Sequence[Segment]
    residuals: Sequence[np.ndarray]


@dataclass(frozen=True)
class HoldoutData:
    """Held-out readings and what both models leave of them.

    Attributes
    ----------
    time : ndarray (t,)
        s, from the start of each recording; parts one after another.
    parts : tuple of slice
        Parts without a gap.
    measured : ndarray (t, y)
        SI; NaN where nothing was measured.
    before, after : ndarray (t, y)
        Measured − simulated of base and extended model, SI; NaN where nothing was measured or simulated.
    noise : ndarray (y,)
        SI.
    """

    time: np.ndarray
    parts: tuple[slice, ...]
    measured: np.ndarray
    before: np.ndarray
    after: np.ndarray
    noise: np.ndarray


def holdout_data(noise: np.ndarray, base: ModelResiduals, extended: ModelResiduals) -> HoldoutData:
    """Order the held-out samples of two models, which may be cut into other segments, by recording and time.

    Parameters
    ----------
    noise : ndarray (y,)
        SI.
    base, extended : ModelResiduals
    """
    names, time, order = _by_recording_and_time(base)
    _, _, extended_order = _by_recording_and_time(extended)
    measured = np.concatenate([segment.readings for segment in base.segments])[order]
    before = np.concatenate(base.residuals)[order] * noise
    after = np.concatenate(extended.residuals)[extended_order] * noise
    starts = np.flatnonzero((names[1:] != names[:-1]) | (np.diff(time) > longest_bridge(time))) + 1
    edges = [0, *(int(start) for start in starts), len(time)]
    return HoldoutData(time, tuple(slice(a, b) for a, b in pairwise(edges)), measured, before, after, noise)


def _by_recording_and_time(model: ModelResiduals) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Names (t,) and times (t,) of all samples in order, and that order (t,)."""
    names = np.concatenate([np.full(len(segment.time), segment.name) for segment in model.segments])
    time = np.concatenate([segment.time for segment in model.segments])
    order = np.lexsort((time, names))
    return names[order], time[order], order


# --- Fidelity of base and extended model on held-out data: R_RVM and R_MU (Eqs. 18–23 of the paper).
#
# A diagnosed model is what a residual vehicle model is cut from, so R_RVM is what its errors cost a test bed. Reference
# is the measurement, test the free simulation; R_MU takes U = 2·u of the sensors.

DRIVABILITY_HZ = 30.0  # f_max of the paper's manoeuvres
SHARE_OF_SAMPLING = 0.25  # f_max at most, of the sampling frequency
LONGEST_DELAY = 0.25  # s between measurement and simulation that is looked for
SHORT_GAP = 0.02  # s without a reading, which an assessment on an even time axis bridges by a straight line
FEWEST_SAMPLES_OF_FIDELITY = 64  # of a part without a longer gap
SMALLEST_RANGE = 4.0  # times the noise: a sensor that moves less says nothing about the dynamics
DRAWS = 5_000  # of the Monte Carlo for the uncertainty of the fidelity
COVERAGE_FACTOR = 2.0  # U = 2·u
DOMAINS = {"residual_vehicle_model": "R_RVM", "measurement_uncertainty": "R_MU"}


@dataclass(frozen=True)
class ModelFidelity:
    """Fidelity of one model: of its dynamics, of the measurement and in total, with standard uncertainties, and by
    signal."""

    r_rvm: float
    r_rvm_uncertainty: float
    r_mu: float
    r_xil: float
    r_xil_uncertainty: float
    signals: tuple[SignalFidelity, ...]

    def to_dict(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        return {
            "R_RVM": self.r_rvm,
            "R_MU": self.r_mu,
            "R_RVM_standard_uncertainty": self.r_rvm_uncertainty,
            "R_XiL": self.r_xil,
            "standard_uncertainty": self.r_xil_uncertainty,
            "signals": [
                {"name": signal.name, "R_NRMSE": signal.nrmse, "R_tau": signal.delay_fidelity,
                 "delay": signal.delay.value, "delay_standard_uncertainty": signal.delay.standard_uncertainty,
                 "delay_undetermined": signal.delay.reason or None}
                for signal in self.signals
            ],
        }  # fmt: skip


@dataclass(frozen=True)
class HoldoutFidelity:
    """Fidelity before and after the extension.

    Attributes
    ----------
    f_max : float
        Largest relevant frequency, Hz.
    weights : dict of str to float
        By domain.
    before, after : ModelFidelity
    noise_floor : float
        R_RVM of a perfect model: the measurement's noise counts against any.
    seconds : dict of str to float
        By sensor, how long the part is that was judged.
    notes : list of str
    """

    f_max: float
    weights: dict[str, float]
    before: ModelFidelity
    after: ModelFidelity
    noise_floor: float
    seconds: dict[str, float]
    notes: list[str]

    def to_dict(self) -> dict[str, Any]:
        """As in ``diagnosis.json``."""
        return {
            "f_max": self.f_max, "weights": {DOMAINS[name]: share for name, share in self.weights.items()},
            "before": self.before.to_dict(), "after": self.after.to_dict(),
            "noise_floor": {"R_RVM": self.noise_floor}, "judged_seconds": self.seconds, "notes": self.notes,
        }  # fmt: skip


@dataclass(frozen=True)
class _EvenPart:
    """A sensor's longest part without a long gap, at even steps: readings and residuals of both models (t,), SI."""

    measured: np.ndarray
    before: np.ndarray
    after: np.ndarray
    seconds: float


def fidelity(system: System, data: HoldoutData) -> HoldoutFidelity | None:
    """R_RVM and R_MU before and after the extension; None if no sensor can be judged.

    A sensor's figures are those of its longest part without a gap.
    """
    step = float(np.median(np.diff(data.time[data.parts[0]])))
    f_max = min(DRIVABILITY_HZ, SHARE_OF_SAMPLING / step)
    method = FidelityMethod(f_max, longest_delay=LONGEST_DELAY)
    before: list[SignalFidelity] = []
    after: list[SignalFidelity] = []
    sensors: list[SensorUncertainty] = []
    floor, seconds, notes = [], {}, []
    for j, sensor in enumerate(system.sensors):
        if not np.isfinite(data.measured[:, j]).any():
            continue
        part = _longest_part(data, j)
        if part is None:
            notes.append(f"{sensor.name} has no part of held-out data long enough for its fidelity")
            continue
        u, width = float(data.noise[j]), float(np.ptp(part.measured))
        if not width > SMALLEST_RANGE * u:
            notes.append(f"{sensor.name} hardly moves on held-out data and does not count in the fidelity")
            continue
        for scores, residual in ((before, part.before), (after, part.after)):
            if scores is after and np.array_equal(part.before, part.after):  # no cause: the delay is sought once
                scores.append(before[-1])
                continue
            pair = SignalPair(part.measured, part.measured - residual, noise=(u, 0.0))
            scores.append(assess_signal(sensor.name, pair, step, method))
        floor.append(max(0.0, 1 - u / width))
        sensors.append(SensorUncertainty(sensor.name, COVERAGE_FACTOR * u / width))
        seconds[sensor.name] = part.seconds
    if not sensors:
        return None
    total = sum(WEIGHTS[name] for name in DOMAINS)
    weights = {name: WEIGHTS[name] / total for name in DOMAINS}
    models = [
        _with_uncertainty(assemble({"residual_vehicle_model": tuple(scores)}, tuple(sensors), weights, method, step))
        for scores in (before, after)
    ]
    no_delay = [float(delay_fidelity(0.0, f_max))] * len(floor)
    return HoldoutFidelity(f_max, weights, models[0], models[1], dynamics_fidelity(floor, no_delay), seconds, notes)


def _longest_part(data: HoldoutData, j: int) -> _EvenPart | None:
    """A sensor's longest part without a long gap."""
    longest = np.empty(0, dtype=int)
    for part in data.parts:
        known = np.isfinite(data.measured[part, j]) & np.isfinite(data.before[part, j] + data.after[part, j])
        samples = np.flatnonzero(known) + part.start
        for piece in np.split(samples, np.flatnonzero(np.diff(data.time[samples]) > SHORT_GAP) + 1):
            if len(piece) > len(longest):
                longest = piece
    if len(longest) < FEWEST_SAMPLES_OF_FIDELITY:
        return None
    time = data.time[longest]
    step = float(np.median(np.diff(time)))
    even = time[0] + step * np.arange(int((time[-1] - time[0]) / step * (1 + 1e-9)) + 1)
    columns = (data.measured[longest, j], data.before[longest, j], data.after[longest, j])
    measured, before, after = (np.interp(even, time, column) for column in columns)
    return _EvenPart(measured, before, after, float(even[-1] - even[0]))


def _with_uncertainty(model: Fidelity) -> ModelFidelity:
    drawn = fidelity_distribution(model, DRAWS).summary()
    return ModelFidelity(
        model.domains["residual_vehicle_model"], drawn["residual_vehicle_model"].standard_uncertainty,
        model.domains["measurement_uncertainty"], model.total, drawn["total"].standard_uncertainty,
        model.signals["residual_vehicle_model"],
    )  # fmt: skip


# --- A given hold-out recording: only its start states, and what each recording has of its own, are fitted to it.

START_ITERATIONS = 30  # of the fit of start states


@dataclass(frozen=True)
class HoldoutRun:
    """A simulation of data that the fit did not use.

    Attributes
    ----------
    problem : FitProblem
    v : ndarray (v,)
        Its parameters are those of the fit, its start states were fitted to these data.
    residual : ndarray (r,)
        Weighted as those of the fit, but without memory: the whole error of a free simulation counts.
    """

    problem: FitProblem
    v: np.ndarray
    residual: np.ndarray

    def mask(self) -> np.ndarray:
        """(r,) which residuals belong to readings."""
        return np.concatenate([segment.measured.ravel() for segment in self.problem.data.segments])

    @cached_property
    def errors(self) -> np.ndarray:
        """(r,) (measured − simulated)/noise, not weighted."""
        if self.problem.weighting is None:
            return self.residual
        return np.concatenate([part.ravel() for part in self.problem.errors(self.v)])

    def parts(self, residual: np.ndarray) -> list[np.ndarray]:
        """Residuals (r,) → (t, y) of each segment; NaN where nothing was measured."""
        by_sensor = self.problem.by_sensor(residual)
        return [
            np.where(segment.measured, values, np.nan)
            for segment, values in zip(self.problem.data.segments, by_sensor, strict=True)
        ]


@dataclass(frozen=True)
class Holdout:
    """Recordings that are not fitted at all; only their start states are."""

    data: FitData

    def simulate(self, fit: Fit) -> list[HoldoutRun]:
        """Simulate them with a fit."""
        individual = parameters_by_recording(fit.problem.system)
        if not individual:
            return simulate_other(fit, self.data)
        runs = []
        for number in dict.fromkeys(segment.recording for segment in self.data.segments):
            segments = (replace(s, recording=1) for s in self.data.segments if s.recording == number)
            runs += simulate_other(fit, replace(self.data, segments=tuple(segments)), individual=individual)
        return runs


def holdout_residuals(runs: list[HoldoutRun]) -> list[np.ndarray]:
    """Errors (t, y), in times the noise, of all simulations."""
    return [part for run in runs for part in run.parts(run.errors)]


def simulate_other(fit: Fit, data: FitData, individual: Sequence[str] = ()) -> list[HoldoutRun]:
    """Other data: parameters as fitted, only the start states are fitted to them, and the zeros of the recording.

    Parameters
    ----------
    individual : sequence of str, optional
        Further parameters that the data have of their own.
    """
    problem = without_memory(fit.problem)
    known = {name: value for name, value in fit.values.items() if name in problem.system.parameters}
    system = problem.system.with_values(known)
    zeros = {
        name: problem.bounds[name] for name in (*zeros_of_recording(system), *individual) if name in problem.bounds
    }
    fixed = FitProblem(system, data, zeros, problem.steps_per_second, problem.stick_speed, weighting=problem.weighting)
    starts = [first_state(system, fixed.model, segment) for segment in data.segments]
    fits = [
        solve(
            fixed,
            fixed.pack(known, [start + shift for start in starts]),
            None,
            FitOptions(START_ITERATIONS, timed=False),
        )
        for shift in flank_shifts(system, fixed.model)
    ]
    best = np.argmin([[np.sum(part**2) for part in fit.by_sensor()] for fit in fits], axis=0)
    residual = np.concatenate([fits[k].by_sensor()[i].ravel() for i, k in enumerate(best)])
    starts = [fits[k].starts[i] for i, k in enumerate(best)]
    same = replace(problem, data=data, held_states=None)
    values = fit.values | fits[int(np.argmin([fitted.cost for fitted in fits]))].values
    return [HoldoutRun(same, same.pack(values, starts), residual)]


def zeros_of_recording(system: System) -> list[str]:
    """Names of the parameters of effects that are zeros: a recording that was not fitted has its own."""
    return [f"{e.name}.{key}" for e in system.effects if e.law.zero_of_recording for key, _ in e.parameters]


def parameters_by_recording(system: System) -> list[str]:
    """Names of the parameters that hold in the first recording only; a recording that was not fitted has its own."""
    return [f"{e.name}.{e.law.by_recording}_1" for e in system.effects if e.law.by_recording]


def without_memory(problem: FitProblem) -> FitProblem:
    """A problem in which the whole error of a free simulation counts."""
    return problem if problem.weighting is None else replace(problem, weighting=problem.weighting.without_memory)


def rms_by_sensor(residuals: list[np.ndarray]) -> np.ndarray:
    """Root mean square (y,) of residuals (t, y), in times the noise; NaN for a sensor without readings."""
    total = np.concatenate(residuals)
    count = np.isfinite(total).sum(axis=0)
    return np.where(count, np.sqrt(np.nansum(total**2, axis=0) / np.maximum(count, 1)), np.nan)
