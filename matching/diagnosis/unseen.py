"""Unseen data: blocks of the recordings, each predicted by a fit to the others (blocked cross-validation).

A parameter may take from the fitted data what belongs to the error of the model, which does not repeat. A cause is
therefore judged where it was not fitted. Blocks are at least as long as the residual remembers: neighbours of a sample
that was left out would tell it (Roberts et al., Ecography 40, 2017; Bergmeir, Hyndman and Koo, CSDA 120, 2018).

A fit to the other blocks is one Gauss–Newton step away from that to all of them; its block is then simulated with the
values found, and where the step does not lower χ² of the other blocks as promised, they are fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from matching.diagnosis.data import FitData, Segment
from matching.diagnosis.descent import Fit, FitOptions, Quadratic, solve
from matching.diagnosis.hypotheses import Hypothesis
from matching.diagnosis.settings import DiagnosisSettings
from matching.diagnosis.statistics import effective_share, mean_square, shares_of_ranges
from modelling.errors import FitError
from modelling.resources import time_is_over

# --- The blocks.


@dataclass(frozen=True)
class Blocks:
    """Which block every sample belongs to: each recording is cut into ``count`` pieces of equal length, and the first
    piece of the next recording belongs to the next block.

    Attributes
    ----------
    count : int
    edges : dict of (str, int) to ndarray (count − 1,)
        By name and number of the recording: times between its pieces, s.
    """

    count: int
    edges: dict[tuple[str, int], np.ndarray]

    def of(self, segment: Segment) -> np.ndarray:
        """(t,) number of the block of every sample; the segment may be a window of those that were cut."""
        turn = list(self.edges).index((segment.name, segment.recording))
        pieces = np.searchsorted(self.edges[segment.name, segment.recording], segment.time, side="right")
        return (pieces + turn) % self.count


def cut(data: FitData, count: int) -> Blocks:
    """Blocks of data."""
    times: dict[tuple[str, int], list[np.ndarray]] = {}
    for segment in data.segments:
        times.setdefault((segment.name, segment.recording), []).append(segment.time)
    shares = np.arange(1, count) / count
    return Blocks(
        count,
        {
            name: (every := np.sort(np.concatenate(parts)))[(shares * len(every)).astype(int)]
            for name, parts in times.items()
        },
    )


def blocks_for(fit: Fit, settings: DiagnosisSettings) -> Blocks:
    """Blocks of the data of a fit, as many as its residual's memory allows."""
    data = fit.problem.data
    memory = 0.0
    for segment, errors in zip(data.segments, fit.errors, strict=True):
        step = float(np.median(np.diff(segment.time)))
        for j in np.flatnonzero(segment.measured.any(axis=0)):
            memory = max(memory, step / effective_share(errors[segment.measured[:, j], j]))
    longest = sum(float(np.ptp(segment.time)) for segment in data.segments)
    most = longest / (settings.block_memories * memory) if memory else np.inf
    return cut(data, int(np.clip(most, settings.fewest_parts, settings.parts)))


# --- The errors of a fit on blocks that it has not used.

PRIOR = 12.0  # over the square of a range: the information of a uniform distribution
AS_PROMISED = 0.5  # of the decrease of χ² that a step promises, from which it is a fit
SLIGHT, SLIGHT_SHARE = 3.0, 1e-3  # χ², and share of it, by which a step may miss that
ITERATIONS = 8


def unseen_errors(fit: Fit, blocks: Blocks) -> list[np.ndarray]:
    """(measured − simulated)/noise (t, y) of every segment, each block by the model fitted to the others; NaN where
    nothing was measured.

    The start state of a segment that begins in the block is fitted to all of it: no other reading tells it. Torques that
    jump leave no use for a step to first order, nor for a longer simulation: there the errors are those of the fit.
    """
    problem, segments = fit.problem, fit.problem.data.segments
    number = [blocks.of(segment) for segment in segments]
    if any(effect.law.abrupt for effect in problem.system.effects):
        return [np.where(s.measured, part, np.nan) for s, part in zip(segments, fit.errors, strict=True)]
    steps = _Steps(fit, number, blocks.count)
    left_out = np.array([fit.v + steps.without(block) for block in range(blocks.count)])
    out, costs = _errors(fit, number, left_out)
    for block in range(blocks.count):
        limit = steps.seen(block) - AS_PROMISED * steps.promised[block]
        if costs[block] <= limit + max(SLIGHT, SLIGHT_SHARE * steps.seen(block)):
            continue
        v = _refitted(fit, number, block)
        again, _ = _errors(fit, number, v[None], block)
        for own, part, there in zip(number, out, again, strict=True):
            part[own == block] = there[own == block]
    return out


class _Steps:
    """Gauss–Newton steps from a fit to those without a block, by the factors of the Jacobian of each block."""

    def __init__(self, fit: Fit, number: Sequence[np.ndarray], count: int):
        problem = fit.problem
        self.fit, k = fit, len(problem.free)
        self.begins = np.array([part[0] for part in number])  # the block in which each segment begins
        self.columns = np.split(np.arange(k, problem.size), len(number))
        width = problem.upper[:k] - problem.lower[:k]
        prior = np.zeros(problem.size)
        prior[:k] = np.where(np.isfinite(width) & (width > 0), np.sqrt(PRIOR) / np.maximum(width, 1e-300), 0.0)
        self.prior = np.diag(prior)
        rows = np.concatenate(
            [np.repeat(part, s.readings.shape[1]) for part, s in zip(number, problem.data.segments, strict=True)]
        )
        self.factors, self.gradients, self.costs = [], [], []
        for block in range(count):
            own = rows == block
            part, residual = fit.jacobian[own], fit.residual[own]
            self.factors.append(np.linalg.qr(part, mode="r") if len(part) else np.zeros((1, problem.size)))
            self.gradients.append(part.T @ residual)
            self.costs.append(float(residual @ residual))
        self.promised = np.zeros(count)

    def seen(self, block: int) -> float:
        """χ² of the other blocks."""
        return sum(self.costs) - self.costs[block]

    def without(self, block: int) -> np.ndarray:
        """The step (v,) to the fit without a block."""
        problem, v = self.fit.problem, self.fit.v
        others = [i for i in range(len(self.factors)) if i != block]
        seen = np.vstack([*(self.factors[i] for i in others), self.prior])
        gradient = np.sum([self.gradients[i] for i in others], axis=0)
        try:
            step, self.promised[block] = Quadratic(seen).step(gradient, problem.lower - v, problem.upper - v, np.inf)
        except FitError:
            return np.zeros(problem.size)
        own = [c for begin, columns in zip(self.begins, self.columns, strict=True) if begin == block for c in columns]
        if own:
            step[own] = 0.0
            factor = np.vstack(self.factors)
            toward = np.sum(self.gradients, axis=0)[own] + factor[:, own].T @ (factor @ step)
            step[own] = -np.linalg.lstsq(factor[:, own].T @ factor[:, own], toward, rcond=1e-10)[0]
        return step


def _errors(
    fit: Fit, number: Sequence[np.ndarray], batch: np.ndarray, block: int | None = None
) -> tuple[list[np.ndarray], np.ndarray]:
    """Errors (t, y) of each segment, each block by its row of variables (b, v), and χ² (b,) of the other blocks.

    The zero of an angle sensor is that of the blocks that were seen, where the segment has any.
    """
    problem, out, costs = fit.problem, [], np.zeros(len(batch))
    with np.errstate(over="ignore", invalid="ignore"):
        for i, (own, errors) in enumerate(zip(number, problem.deviations(batch), strict=True)):
            measured = problem.data.segments[i].measured
            left = np.full(measured.shape, np.nan)
            weighted = problem.counted(errors.copy(), i)
            for row, part in enumerate(errors):
                here = own == (row if block is None else block)
                costs[row] += float(np.sum(weighted[row][~here] ** 2))
                for j in problem.with_zero:
                    known = measured[:, j] & ~here
                    known = known if known.any() else measured[:, j]
                    part[:, j] -= np.mean(part[known, j]) if known.any() else 0.0
                left[here] = np.where(measured[here], part[here], np.nan)
            out.append(left)
    return out, np.where(np.isfinite(costs), costs, np.inf)


def _refitted(fit: Fit, number: Sequence[np.ndarray], block: int) -> np.ndarray:
    """Variables (v,) fitted to all blocks but one, from those of the fit; start states of segments that begin in it are
    kept."""
    problem = fit.problem
    if time_is_over():
        return fit.v
    segments = tuple(
        replace(s, readings=np.where((own == block)[:, None], np.nan, s.readings))
        for s, own in zip(problem.data.segments, number, strict=True)
    )
    k = len(problem.free)
    held = [c for own, columns in zip(number, np.split(np.arange(k, problem.size), len(number)), strict=True)
            if own[0] == block for c in columns]  # fmt: skip
    try:
        others = replace(problem, data=replace(problem.data, segments=segments))
        return solve(others, fit.v, None, FitOptions(ITERATIONS, exact=False, held=tuple(held))).v
    except FitError:
        return fit.v


# --- What hypotheses leave of unseen data.

DIVERGED = 1e12  # times the noise: a simulation that runs away
AT_NOISE = 1.1  # mean square in times the noise; a sensor at its noise is not worse


@dataclass(frozen=True)
class UnseenError:
    """Errors of one hypothesis on unseen data.

    Attributes
    ----------
    blocks : ndarray (b, y)
        Mean squares over blocks of the data, in times the noise; NaN without readings.
    shares : ndarray (y,)
        Root mean square error of each sensor over its range; NaN where it has no readings or never changes.
    ranges : ndarray (y,)
        Of the readings, in times the noise; NaN as above.
    independent : ndarray (y,)
        Independent readings of a block.
    """

    blocks: np.ndarray
    shares: np.ndarray
    ranges: np.ndarray
    independent: np.ndarray

    @property
    def misfit(self) -> float:
        """Root mean square over the blocks and sensors, in times the noise."""
        return float(np.sqrt(np.nanmean(self.blocks))) if np.isfinite(self.blocks).any() else np.nan

    @property
    def pooled(self) -> float:
        """Root mean square over the sensors of the error over the sensor's range; NaN without any."""
        known = self.shares[np.isfinite(self.shares)]
        return float(np.sqrt(np.mean(known**2))) if len(known) else np.nan


class UnseenData:
    """Blocks of the data, and the errors of hypotheses on each that a fit to the others leaves."""

    def __init__(self, blocks: Blocks, settings: DiagnosisSettings):
        self.blocks, self.settings = blocks, settings
        self._known: dict[int, tuple[Fit, UnseenError | None]] = {}  # with the fit: no other takes its identity

    def error(self, hypothesis: Hypothesis) -> UnseenError | None:
        """The errors of a hypothesis; None where it does not simulate the data."""
        fit = hypothesis.fit
        if id(fit) not in self._known:
            self._known[id(fit)] = fit, self._simulated(fit)
        return self._known[id(fit)][1]

    def pooled(self, hypothesis: Hypothesis) -> float:
        """Root mean square over the sensors of the error over the sensor's range; infinite where it does not
        simulate."""
        error = self.error(hypothesis)
        return np.inf if error is None or np.isnan(error.pooled) else error.pooled

    def misfit(self, hypothesis: Hypothesis) -> float:
        """Root mean square of all errors, in times the noise; infinite where it does not simulate."""
        error = self.error(hypothesis)
        return np.inf if error is None else error.misfit

    def share_explained(self, child: Hypothesis, parent: Hypothesis) -> float:
        """Share of a hypothesis's misfit on unseen data, beyond the noise, that another one explains: mean squares over
        the sensors in units of their ranges; between 0 and 1."""
        after, before = self.error(child), self.error(parent)
        if after is None or before is None:
            return float(before is None)
        known = np.isfinite(before.ranges) & (before.ranges > 0)
        floor = float(np.mean(1 / before.ranges[known] ** 2)) if known.any() else 0.0
        excess = before.pooled**2 - floor
        return float(np.clip((before.pooled**2 - after.pooled**2) / excess, 0.0, 1.0)) if excess > 0 else 0.0

    def accepts(self, child: Hypothesis, parent: Hypothesis) -> bool:
        """Whether a hypothesis meets unseen data better than another, beyond chance.

        Of every sensor the difference of the mean squares counts, over the larger of both: a sensor says as much as
        another whatever it measures, and one that is at its noise says nothing. Chance is that of the blocks of the
        data: a paired bootstrap draws them again and again, and all but a share ``chance`` of the draws have to find
        the child better.
        """
        gain, _ = self._drawn(child, parent)
        return bool(np.mean(gain <= 0) < self.settings.chance)

    def keeps(self, child: Hypothesis, parent: Hypothesis, by_sensor: bool = True) -> bool:
        """Whether a hypothesis to which nothing will be added is accepted over another, the error of all sensors in
        units of their ranges falls, and, ``by_sensor``, that of none rises beyond chance and more than slightly. Before
        the end the right cause may let an angle drift away, beside another that is still missing."""
        gain, rises = self._drawn(child, parent)
        chance, slight = self.settings.chance, self.settings.slight_rise
        worse = (np.mean(rises <= 0, axis=0) < chance) & (rises.mean(axis=0) > slight)
        lower = self.pooled(child) < self.pooled(parent)
        return bool(np.mean(gain <= 0) < chance and lower and not (by_sensor and worse.any()))

    def _drawn(self, child: Hypothesis, parent: Hypothesis) -> tuple[np.ndarray, np.ndarray]:
        """Gains and rises in draws of the blocks; certain ones where only one of both simulates the data."""
        after, before = self.error(child), self.error(parent)
        if after is None or before is None or after.blocks.shape != before.blocks.shape:
            better = 1.0 if after is not None and before is None else -1.0
            return np.full(1, better), np.full((1, 1), -better)
        return drawn_gains(after, before, self.settings.draws)

    def _simulated(self, fit: Fit) -> UnseenError | None:
        data, residuals = fit.problem.data, unseen_errors(fit, self.blocks)
        total = np.concatenate(residuals)
        if not np.isfinite(total[np.concatenate([s.measured for s in data.segments])]).all():
            return None
        if np.nanmax(np.abs(total), initial=0.0) > DIVERGED:
            return None
        readings = np.concatenate([segment.readings for segment in data.segments])
        blocks = np.array([mean_square(part) for part in np.array_split(total, min(self.settings.blocks, len(total)))])
        shares = shares_of_ranges(total, readings, data.noise)
        with np.errstate(divide="ignore", invalid="ignore"):
            ranges = np.sqrt(mean_square(total)) / shares
        count = np.isfinite(total).sum(axis=0) / len(blocks)
        independent = [effective_share(column) if np.isfinite(column).any() else 0.0 for column in total.T]
        return UnseenError(blocks, shares, ranges, count * independent)


def drawn_gains(after: UnseenError, before: UnseenError, draws: int) -> tuple[np.ndarray, np.ndarray]:
    """What one hypothesis gains over another in draws of the blocks of unseen data.

    Returns
    -------
    gain : ndarray (d,)
        Differences of the mean squares, each over the larger of both and the noise at least, summed over the sensors.
    rises : ndarray (d, y)
        Of each sensor, as a share of the larger mean square, 0 where it is at its noise.
    """
    count = len(after.blocks)
    chosen = np.random.default_rng(0).multinomial(count, np.full(count, 1 / count), size=draws).astype(float)
    known = np.isfinite(after.blocks) & np.isfinite(before.blocks)
    new, old = (chosen @ np.where(known, error.blocks, 0.0) for error in (after, before))
    number = np.maximum(chosen @ known, 1.0)
    new, old = (np.maximum(error / number, 1.0) for error in (new, old))
    rises = (new - old) / np.maximum(new, old)
    return -rises.sum(axis=1), np.where(new > AT_NOISE, rises, 0.0)
