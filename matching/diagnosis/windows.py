"""Fits over short windows, each with its own start state: multiple shooting without matching conditions.

Rattling in a free play forgets where it began: over seconds of free simulation χ² has a minimum at every beat, and the
right gap may fit worse than none. Over a short horizon χ² is nearly convex in the parameters (multiple shooting: Bock
and Plitt 1984). Kinds that are ``abrupt`` are fitted so first, then over windows twice as long, until these are whole
segments.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby, pairwise

import numpy as np

from matching.diagnosis.causes import ExtendedModel, start_states
from matching.diagnosis.data import Segment
from matching.diagnosis.descent import SEARCH, Fit, FitOptions, chi_square, solve
from matching.diagnosis.problem import FitProblem, first_state, flank_shifts, jacobian
from matching.diagnosis.screening import extended_problem, fit_extended
from matching.diagnosis.statistics import covariance, discretisation_shift, inflation
from modelling.resources import time_is_over

SHORTEST_WINDOW = 0.5  # s
MOST_WINDOWS = 80  # of longer ones χ² has other minima, however much data there are
POOR_RATIO = 3.0  # of the median of the windows' mean squares, from which one began on the wrong flank
MOST_FLANKS, FLANK_ITERATIONS = 3, 12  # windows begun on every flank in a round, and the iterations of each fit
ITERATIONS, AGAIN_ITERATIONS = 30, 15
FEW_WINDOWS = 10  # over which gaps to begin with are compared: enough to tell one, and a third of the time (trial)
SAME_GAP = 0.1  # relative: two starts that end so near need no third
ROUNDS = 8  # at most, in which windows may begin where the one before ends
GOOD = 1.02  # mean square of the residual in times the noise, which needs no further round
PROGRESS = 0.98  # of χ², for a round to count
LOST_RATIO = 2.0  # of χ² to that of windows half as long, from which longer ones have lost the way


BETTER = 0.9  # of χ²: fits over short windows that are no better than this prove no local minimum
MUCH_BETTER = 0.8  # the same for windows to stand for the fit
NEAR_NOISE = 1.2  # mean square in times the noise, of a fit from which no wider gap is tried
FULL_ITERATIONS = 15  # of the fit over whole segments


def fit_from_windows(
    model: ExtendedModel, parent: Fit, motion: np.ndarray, gap: str, wider: Sequence[float], cost: float
) -> Fit | None:
    """Fit an extended model over windows that grow; None where that is no better than a fit over whole segments.

    Where no long simulation keeps what the windows reached, the fit is that over windows: with a rattling shaft they
    are what can be judged.

    Parameters
    ----------
    motion : ndarray (t, x)
        States of the parent's model as measured, segments one after another: windows begin there.
    gap : str
        Name of the free play among the parameters.
    wider : sequence of float
        Times the fitted free play, from which another fit begins where the first is not near the noise: within the true
        gap no torque is measured that a narrower one lacks, so a narrow one stays so.
    cost : float
        χ² of the fit over whole segments.
    """
    few = fit_short_windows(model, parent, motion, FEW_WINDOWS)
    for factor in wider:
        if few.cost < NEAR_NOISE * few.problem.data.readings_count:
            break
        values = model.values | few.values
        begun = replace(model, values=values | {gap: factor * values[gap]})
        again = fit_short_windows(begun, parent, motion, FEW_WINDOWS)
        same = abs(again.values[gap] - few.values[gap]) < SAME_GAP * few.values[gap]
        few = again if again.cost < few.cost else few
        if same:
            break
    short = fit_short_windows(replace(model, values=model.values | few.values), parent, motion)
    if short.cost > BETTER * cost:
        return None
    windows = fit_longer_windows(short)
    begun = replace(model, values=model.values | windows.values, starts=_segment_starts(windows, parent))
    fit = fit_extended(begun, parent, replace(SEARCH, iterations=FULL_ITERATIONS))
    whole = len(windows.problem.data.segments) == len(parent.problem.data.segments)
    kept = fit.cost < windows.cost if whole else windows.cost > MUCH_BETTER * fit.cost
    return fit if kept else windows


def _segment_starts(windows: Fit, parent: Fit) -> tuple[np.ndarray, ...]:
    """Start states (x,) of a parent's segments, from the windows that begin with them."""
    first: dict[int, np.ndarray] = {}
    for window, start in zip(windows.problem.data.segments, windows.starts, strict=True):
        first.setdefault(window.cut_from, start)
    return tuple(first[number] for number in range(len(parent.problem.data.segments)))


def fit_short_windows(model: ExtendedModel, parent: Fit, motion: np.ndarray, most: int | None = None) -> Fit:
    """Fit an extended model over short windows.

    Parameters
    ----------
    motion : ndarray (t, x)
        States of the parent's model as measured, segments one after another: windows begin there.
    most : int, optional
        Windows that are fitted at most, spread over the data; all if not given.
    """
    windows = _spread(_cut(parent, motion), most)
    problem, p = extended_problem(model, windows)
    problem.held_states = start_states(problem, windows, p)
    first = ITERATIONS if most is not None else AGAIN_ITERATIONS  # of all windows, from values that some have told
    return _again(solve(problem, problem.pack(model.values, problem.held_states), None, FitOptions(first)))


def _spread(windows: Fit, most: int | None) -> Fit:
    """A fit over windows with so many of them at most, evenly spread."""
    count = len(windows.problem.data.segments)
    if most is None or count <= most:
        return windows
    return _of_windows(windows, np.unique(np.linspace(0, count - 1, most).round().astype(int)))


def _of_windows(fit: Fit, kept: np.ndarray) -> Fit:
    """A fit over some of its windows (k,) alone; residual and Jacobian stay those of all."""
    problem, starts = fit.problem, fit.starts
    held = [starts[i] for i in kept]
    data = replace(problem.data, segments=tuple(problem.data.segments[i] for i in kept))
    fewer = replace(problem, data=data, held_states=held)
    return replace(fit, problem=fewer, v=fewer.pack(fit.values, held))


def _again(fit: Fit) -> Fit:
    """A fit over windows begun again from better start states while that pays.

    One step for all windows is as short as the worst of them asks for. Windows that are far off therefore wait while
    the others are fitted: these tell the parameters, from which those find their flank.
    """
    good = GOOD * fit.problem.data.readings_count
    for _ in range(ROUNDS):
        if fit.cost < good or time_is_over():
            break
        begun = replace(fit, v=_joined(fit))
        shares = _squares(fit.problem, begun.v) / np.array([s.measured.sum() for s in fit.problem.data.segments])
        near = np.flatnonzero(shares <= max(GOOD, POOR_RATIO * float(np.median(shares))))
        if len(near) < len(shares):
            some = _of_windows(begun, near)
            told = solve(some.problem, some.v, None, FitOptions(AGAIN_ITERATIONS))
            starts = begun.starts
            for i, start in zip(near.tolist(), told.starts, strict=True):
                starts[i] = start
            begun = replace(begun, v=begun.problem.pack(told.values, starts))
            begun = replace(begun, v=_joined(begun))
        again = solve(fit.problem, begun.v, None, FitOptions(AGAIN_ITERATIONS, enough_cost=good))
        if again.cost > PROGRESS * fit.cost:
            break
        fit = again
    return fit


def fit_longer_windows(fit: Fit) -> Fit:
    """The fit of short windows carried on over windows twice as long, again and again, until they are whole segments.

    A fit over long windows finds its way only from near the minimum, and that of windows half as long is near enough.
    Where it does not keep what those reached (rattling forgets where it began), the last that did is returned.
    """
    while True:
        segments, starts = _pairs(fit)
        if len(segments) == len(fit.problem.data.segments) or time_is_over():
            return fit
        problem = replace(fit.problem, data=replace(fit.problem.data, segments=tuple(segments)), held_states=starts)
        begun = replace(fit, problem=problem, v=problem.pack(fit.values, starts))
        enough = replace(SEARCH, enough_cost=GOOD * problem.data.readings_count)
        longer = _again(solve(problem, _joined(begun), None, enough))
        if longer.cost > LOST_RATIO * fit.cost:
            return fit
        fit = longer


def window_uncertainties(fit: Fit) -> dict[str, float]:
    """Standard uncertainties of a fit's parameters as short windows along its own motion determine them.

    Where torques jump, a long simulation magnifies the smallest change of a parameter until readings have nothing in
    common with before: its Jacobian at one point takes that for knowledge. Over a short window it is none.
    """
    windows = _cut(fit, np.concatenate(fit.problem.states(fit.v)))
    residual = windows.problem.residuals(windows.v[None])[0]
    derivatives = jacobian(windows.problem, windows.v, residual)
    refitted = replace(windows, residual=residual, jacobian=derivatives, cost=chi_square(residual))
    sigma = np.hypot(np.sqrt(np.diag(covariance(refitted, inflation(refitted)))), discretisation_shift(refitted))
    return dict(zip(fit.problem.free, (float(s) for s in sigma), strict=False))


def _pairs(fit: Fit) -> tuple[list[Segment], list[np.ndarray]]:
    """Windows of each segment of a fit joined two by two, and their start states (x,)."""
    windows = list(zip(fit.problem.data.segments, fit.starts, strict=True))
    segments, starts = [], []
    for _, group in groupby(windows, key=lambda window: window[0].cut_from):
        members = list(group)
        for i in range(0, len(members), 2):
            segments.append(_joined_segment([segment for segment, _ in members[i : i + 2]]))
            starts.append(members[i][1])
    return segments, starts


def _joined_segment(parts: list[Segment]) -> Segment:
    """Windows that share the last sample of one with the first of the next, as one."""
    pieces = [parts[0], *(part.part(1, len(part.time)) for part in parts[1:])]
    time, inputs, readings = (
        np.concatenate(arrays)
        for arrays in zip(*((piece.time, piece.inputs, piece.readings) for piece in pieces), strict=True)
    )
    return replace(parts[0], time=time, inputs=inputs, readings=readings)


def _cut(parent: Fit, motion: np.ndarray) -> Fit:
    """The parent fit over windows that begin in a motion (t, x); residual and Jacobian are those of the segments."""
    data = parent.problem.data
    total = sum(float(np.ptp(segment.time)) for segment in data.segments)
    length = max(SHORTEST_WINDOW, total / MOST_WINDOWS)
    windows, starts, begin = [], [], 0
    for number, segment in enumerate(data.segments):
        count = max(1, round(float(np.ptp(segment.time)) / length))
        edges = np.linspace(0, len(segment.time), count + 1).astype(int)
        for first, last in pairwise(edges):
            part = segment.part(int(first), int(last) + 1)  # the last sample is also the next window's first
            windows.append(replace(part, cut_from=number))
            starts.append(motion[begin + first])
        begin += len(segment.time)
    problem = replace(parent.problem, data=replace(data, segments=tuple(windows)), held_states=starts)
    return replace(parent, problem=problem, v=problem.pack(parent.values, starts))


def _joined(fit: Fit) -> np.ndarray:
    """Variables of a fit over windows, each beginning where the one before ends if it fits better from there; poor ones
    on the flank of a free play from which they fit best."""
    problem, starts = fit.problem, fit.starts
    ends = [states[-1] for states in problem.states(fit.v)]
    v = problem.pack(fit.values, [starts[0], *ends[:-1]])
    kept, moved = (_squares(problem, point) for point in (fit.v, v))
    starts = [
        end if b < a else start for start, end, a, b in zip(starts, problem.unpack(v)[1], kept, moved, strict=True)
    ]
    squares = np.minimum(kept, moved)
    count = np.array([segment.measured.sum() for segment in problem.data.segments])
    share = squares / np.maximum(count, 1)
    poor = share > max(GOOD, POOR_RATIO * float(np.median(share)))
    for i in sorted(np.flatnonzero(poor).tolist(), key=lambda i: -share[i])[:MOST_FLANKS]:
        starts[i] = _best_flank(fit, i, starts[i], ends[i - 1] if i else starts[i])
    return problem.pack(fit.values, starts)


def _best_flank(fit: Fit, i: int, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """The start state (x,) of a window that fits best, the parameters held: begun from its own, from where the window
    before ends (x,), as its readings have it, and on the flanks of a free play.

    From within a free play, or from its wrong flank, no small step leads to the right one.
    """
    known = {name: value for name, value in fit.values.items() if name in fit.problem.system.parameters}
    system = fit.problem.system.with_values(known)
    data = replace(fit.problem.data, segments=(fit.problem.data.segments[i],))
    window = replace(fit.problem, system=system, data=data, bounds={}, held_states=[start])
    shifts = flank_shifts(system, window.model)
    if len(shifts) == 1:
        return start
    begins = [start, *(start + share * shift for shift in shifts[1:] for share in (1, 2))]
    measured = first_state(system, window.model, data.segments[0])
    begins += [other + shift for other in (end, measured) for shift in shifts]
    best: Fit | None = None
    for begin in {tuple(begin): begin for begin in begins}.values():  # a window may begin where the one before ends
        options = FitOptions(FLANK_ITERATIONS, rival_cost=best.cost if best else 0.0)
        fit = solve(window, window.pack({}, [begin]), None, options)
        best = fit if best is None or fit.cost < best.cost else best
    assert best is not None
    return best.starts[0]


def _squares(problem: FitProblem, v: np.ndarray) -> np.ndarray:
    """χ² (w,) of every window for variables v (v,)."""
    return np.array([chi_square(part.ravel()) for part in problem.by_sensor(problem.residuals(v[None])[0])])
