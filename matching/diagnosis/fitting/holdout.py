"""Free simulation on data that no fit saw."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from matching.diagnosis.data.segments import Data, Segment
from matching.diagnosis.fitting.fit import Fit, Problem, first_state, solve


@dataclass(frozen=True)
class Ahead:
    """A simulation of data that no fit saw.

    Attributes
    ----------
    problem : Problem
    v : ndarray (v,)
        Its parameters are those of the fit.
    residual : ndarray (r,)
    seen : tuple of int
        How many samples of each segment the fit did see; only what follows them counts.
    carried : bool
        Whether the start states are the fit's too; else they were found on these data.
    """

    problem: Problem
    v: np.ndarray
    residual: np.ndarray
    seen: tuple[int, ...]
    carried: bool

    def mask(self) -> np.ndarray:
        """Which residuals (r,) are of data that were measured and not seen."""
        own = [segment.counts.copy() for segment in self.problem.data.segments]
        for one, count in zip(own, self.seen, strict=True):
            one[:count] = False
        return np.concatenate([one.ravel() for one in own])

    def parts(self, residual: np.ndarray) -> list[np.ndarray]:
        """Residuals (r,) → (t, y) of what was not seen of each segment; NaN where nothing was measured."""
        every = zip(self.problem.data.segments, self.problem.by_sensor(residual), self.seen, strict=True)
        out = [np.where(segment.counts, own, np.nan)[count:] for segment, own, count in every]
        return [own for own in out if len(own)]


def residuals(ahead: list[Ahead]) -> list[np.ndarray]:
    """Residuals (t, y), in times the noise, of all simulations."""
    return [own for one in ahead for own in one.parts(one.residual)]


def rest_of(fit: Fit, whole: Data, seen: list[int]) -> list[Ahead]:
    """What follows the samples a fit saw of each segment.

    The simulation goes on from the fitted start, freely; a segment of which the fit saw nothing gets its own start.
    """
    if len(fit.problem.data.segments) != sum(count > 0 for count in seen):
        return _windows(fit, whole, seen)
    known = [i for i, count in enumerate(seen) if count]
    data = replace(whole, segments=tuple(whole.segments[i] for i in known))
    problem = replace(fit.problem, data=data, anchors=None)
    v = problem.pack(fit.values, fit.starts)
    out = [Ahead(problem, v, problem.residuals(v[None])[0], tuple(seen[i] for i in known), True)]
    unseen = tuple(segment for segment, count in zip(whole.segments, seen, strict=True) if not count)
    return out + (elsewhere(fit, replace(whole, segments=unseen)) if unseen else [])


def _windows(fit: Fit, whole: Data, seen: list[int]) -> list[Ahead]:
    """The same for a fit over short windows: what it did not see is cut into windows as long."""
    length = max(len(segment.time) for segment in fit.problem.data.segments)
    cuts = []
    for segment, count in zip(whole.segments, seen, strict=True):
        pieces = round((len(segment.time) - count) / length)
        if count >= len(segment.time):
            continue
        edges = np.linspace(count, len(segment.time), max(pieces, 1) + 1).astype(int)
        cuts += [segment.part(int(a), int(b)) for a, b in pairwise(edges)]
    return elsewhere(fit, replace(whole, segments=tuple(cuts)))


def rest_segments(fit: Fit, whole: Data, seen: list[int]) -> list[Segment]:
    """The stretches of data on which ``rest_of`` gives residuals, in its order."""
    rests = unseen_segments(whole, seen)
    if len(fit.problem.data.segments) != sum(count > 0 for count in seen):
        return [rest for rest in rests if len(rest.time)]
    known = [rest for rest, count in zip(rests, seen, strict=True) if count and len(rest.time)]
    return known + [rest for rest, count in zip(rests, seen, strict=True) if not count]


def unseen_segments(whole: Data, seen: list[int]) -> list[Segment]:
    """What follows the samples a fit saw of each segment; empty where it saw all."""
    return [segment.part(count, len(segment.time)) for segment, count in zip(whole.segments, seen, strict=True)]


def elsewhere(fit: Fit, data: Data) -> list[Ahead]:
    """Other recordings: parameters as fitted, only the start states are found."""
    problem = fit.problem
    system = problem.system.with_values(
        {name: value for name, value in fit.values.items() if name in problem.system.parameters}
    )
    fixed = Problem(system, data, {}, problem.steps, problem.stick)
    starts = [first_state(system, fixed.model, data, i) for i in range(len(data.segments))]
    found = solve(fixed, fixed.pack({}, starts), None, 30)
    open_ = replace(problem, data=data, anchors=None)
    return [Ahead(open_, open_.pack(fit.values, found.starts), found.residual, (0,) * len(data.segments), False)]


def ratios(residuals: list[np.ndarray]) -> np.ndarray:
    """Root mean square (y,) in times the noise; NaN for a sensor without readings."""
    total = np.concatenate(residuals)
    count = np.isfinite(total).sum(axis=0)
    with np.errstate(invalid="ignore"):
        return np.where(count, np.sqrt(np.nansum(total**2, axis=0) / np.maximum(count, 1)), np.nan)
