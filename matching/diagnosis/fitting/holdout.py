"""Free simulation of held-out data with a fitted model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Protocol

import numpy as np

from matching.diagnosis.data.holdout_split import held_out_segments
from matching.diagnosis.data.segments import FitData, Segment
from matching.diagnosis.fitting.fit import Fit, FitOptions, solve
from matching.diagnosis.fitting.problem import FitProblem
from matching.diagnosis.fitting.start_states import first_state, flank_shifts
from modelling.model.system import System

START_ITERATIONS = 30  # of the fit of start states
RESTART_SECONDS = 1.0  # of a window of rattling that is simulated from its own start


@dataclass(frozen=True)
class HoldoutRun:
    """A simulation of data that the fit did not use.

    Attributes
    ----------
    problem : FitProblem
        The data may begin with samples that the fit used.
    v : ndarray (v,)
        Its parameters are those of the fit.
    residual : ndarray (r,)
        Weighted as those of the fit, but without memory: the whole error of a free simulation counts.
    fitted_samples : tuple of int
        How many samples of each segment the fit used; only those after them count.
    continued : bool
        Whether the start states are those of the fit; else they were fitted to these data.
    """

    problem: FitProblem
    v: np.ndarray
    residual: np.ndarray
    fitted_samples: tuple[int, ...]
    continued: bool

    def mask(self) -> np.ndarray:
        """(r,) which residuals belong to readings that were held out."""
        measured = [segment.measured.copy() for segment in self.problem.data.segments]
        for values, count in zip(measured, self.fitted_samples, strict=True):
            values[:count] = False
        return np.concatenate([values.ravel() for values in measured])

    @cached_property
    def errors(self) -> np.ndarray:
        """(r,) (measured − simulated)/noise, not weighted."""
        if self.problem.weighting is None:
            return self.residual
        return np.concatenate([part.ravel() for part in self.problem.errors(self.v)])

    def parts(self, residual: np.ndarray) -> list[np.ndarray]:
        """Residuals (r,) → (t, y) of what was held out of each segment; NaN where nothing was measured."""
        out = []
        by_sensor = self.problem.by_sensor(residual)
        for segment, values, count in zip(self.problem.data.segments, by_sensor, self.fitted_samples, strict=True):
            out.append(np.where(segment.measured, values, np.nan)[count:])
        return [part for part in out if len(part)]


class Holdout(Protocol):
    """Data that judge fits and are not fitted."""

    @property
    def data(self) -> FitData:
        """The data."""

    def simulate(self, fit: Fit) -> list[HoldoutRun]:
        """Simulate them with a fit."""

    def segments(self, fit: Fit) -> list[Segment]:
        """The segments to which the residuals of :meth:`simulate` belong, in their order."""


@dataclass(frozen=True)
class RestOfRecordings:
    """What follows the fitted samples of each segment.

    The simulation goes on freely from the fitted start; a segment without fitted samples gets a start state of its own.

    Attributes
    ----------
    whole : FitData
    counts : list of int
        Fitted samples of each segment.
    """

    whole: FitData
    counts: list[int]

    @property
    def data(self) -> FitData:
        """The data."""
        return replace(self.whole, segments=tuple(held_out_segments(self.whole, self.counts)))

    def simulate(self, fit: Fit) -> list[HoldoutRun]:
        """Simulate the rest with a fit."""
        if not self._has_segments(fit):
            return simulate_other(fit, replace(self.whole, segments=tuple(self._windows(fit))))
        fitted = [i for i, count in enumerate(self.counts) if count]
        data = replace(self.whole, segments=tuple(self.whole.segments[i] for i in fitted))
        counts = tuple(self.counts[i] for i in fitted)
        problem = replace(_without_memory(fit.problem), data=data, held_states=None, zero_samples=counts)
        v = problem.pack(fit.values, fit.starts)
        run = HoldoutRun(problem, v, problem.residuals(v[None])[0], counts, continued=True)
        rest = tuple(s for s, count in zip(self.whole.segments, self.counts, strict=True) if not count)
        return [run, *(simulate_other(fit, replace(self.whole, segments=rest)) if rest else [])]

    def segments(self, fit: Fit) -> list[Segment]:
        """The segments to which the residuals of :meth:`simulate` belong, in their order."""
        rests = held_out_segments(self.whole, self.counts)
        if not self._has_segments(fit):
            return [rest for rest in rests if len(rest.time)]
        continued = [rest for rest, count in zip(rests, self.counts, strict=True) if count and len(rest.time)]
        return continued + [rest for rest, count in zip(rests, self.counts, strict=True) if not count]

    def _has_segments(self, fit: Fit) -> bool:
        """Whether a fit has the segments of the data; else it is one over short windows of them."""
        return len(fit.problem.data.segments) == sum(count > 0 for count in self.counts)

    def _windows(self, fit: Fit) -> list[Segment]:
        """What a fit over short windows did not use, in windows as long as its own."""
        length = max(len(segment.time) for segment in fit.problem.data.segments)
        windows = []
        for segment, count in zip(self.whole.segments, self.counts, strict=True):
            if count < len(segment.time):
                pieces = max(round((len(segment.time) - count) / length), 1)
                edges = np.linspace(count, len(segment.time), pieces + 1).astype(int)
                windows += [segment.part(int(a), int(b)) for a, b in pairwise(edges)]
        return windows


@dataclass(frozen=True)
class RestartedRest(RestOfRecordings):
    """The same in windows of ``RESTART_SECONDS``, each with a start state fitted to it.

    A shaft that rattles forgets where it began: no model continues it freely over many seconds. The fits begin where
    the free continuation is.
    """

    def simulate(self, fit: Fit) -> list[HoldoutRun]:
        """Simulate the windows with a fit."""
        data = replace(self.whole, segments=tuple(window for window, _, _ in self._restarts()))
        if not self._has_segments(fit):
            return simulate_other(fit, data)
        (run, *_) = super().simulate(fit)
        fitted = [i for i, count in enumerate(self.counts) if count]
        states = dict(zip(fitted, run.problem.states(run.v), strict=True))
        starts = [states[i][first] if i in states else None for _, i, first in self._restarts()]
        return simulate_other(fit, data, starts)

    def segments(self, fit: Fit) -> list[Segment]:
        """The windows."""
        return [window for window, _, _ in self._restarts()]

    def _restarts(self) -> list[tuple[Segment, int, int]]:
        """Windows with the segment they are of and its sample that is their first."""
        out = []
        for i, (segment, count) in enumerate(zip(self.whole.segments, self.counts, strict=True)):
            if len(segment.time) - count > 1:
                seconds = float(segment.time[-1] - segment.time[count])
                edges = np.linspace(count, len(segment.time), max(round(seconds / RESTART_SECONDS), 1) + 1).astype(int)
                out += [(segment.part(int(a), int(b)), i, int(a)) for a, b in pairwise(edges)]
        return out


@dataclass(frozen=True)
class OtherRecordings:
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

    def segments(self, fit: Fit) -> list[Segment]:
        """Their segments."""
        return list(self.data.segments)


def holdout_residuals(runs: list[HoldoutRun]) -> list[np.ndarray]:
    """Errors (t, y), in times the noise, of all simulations."""
    return [part for run in runs for part in run.parts(run.errors)]


def simulate_other(
    fit: Fit, data: FitData, begin: Sequence[np.ndarray | None] | None = None, individual: Sequence[str] = ()
) -> list[HoldoutRun]:
    """Other data: parameters as fitted, only the start states are fitted to them, and the zeros of the recording.

    Parameters
    ----------
    begin : sequence of ndarray (x,), optional
        States from which the fits of the start states begin; those that the first readings show where there is none.
    individual : sequence of str, optional
        Further parameters that the data have of their own.
    """
    problem = _without_memory(fit.problem)
    known = {name: value for name, value in fit.values.items() if name in problem.system.parameters}
    system = problem.system.with_values(known)
    zeros = {
        name: problem.bounds[name] for name in (*zeros_of_recording(system), *individual) if name in problem.bounds
    }
    fixed = FitProblem(system, data, zeros, problem.steps_per_second, problem.stick_speed, weighting=problem.weighting)
    known_starts = begin or [None] * len(data.segments)
    starts = [
        first_state(system, fixed.model, segment) if start is None else start
        for segment, start in zip(data.segments, known_starts, strict=True)
    ]
    held = None if begin is None else starts  # angles that no sensor reads stay where the states have them
    fixed = replace(fixed, held_states=held)
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
    same = replace(problem, data=data, held_states=held)
    none_used = (0,) * len(data.segments)
    values = fit.values | fits[int(np.argmin([fitted.cost for fitted in fits]))].values
    return [HoldoutRun(same, same.pack(values, starts), residual, none_used, False)]


def zeros_of_recording(system: System) -> list[str]:
    """Names of the parameters of effects that are zeros: a recording that was not fitted has its own."""
    return [f"{e.name}.{key}" for e in system.effects if e.law.zero_of_recording for key, _ in e.parameters]


def parameters_by_recording(system: System) -> list[str]:
    """Names of the parameters that hold in the first recording only; a recording that was not fitted has its own."""
    return [f"{e.name}.{e.law.by_recording}_1" for e in system.effects if e.law.by_recording]


def _without_memory(problem: FitProblem) -> FitProblem:
    """A problem in which the whole error of a free simulation counts."""
    return problem if problem.weighting is None else replace(problem, weighting=problem.weighting.without_memory)


def rms_by_sensor(residuals: list[np.ndarray]) -> np.ndarray:
    """Root mean square (y,) of residuals (t, y), in times the noise; NaN for a sensor without readings."""
    total = np.concatenate(residuals)
    count = np.isfinite(total).sum(axis=0)
    return np.where(count, np.sqrt(np.nansum(total**2, axis=0) / np.maximum(count, 1)), np.nan)
