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
from itertools import pairwise

import numpy as np

from matching.diagnosis.data import FitData, Segment
from matching.diagnosis.descent import Fit, FitOptions, Quadratic, solve
from matching.diagnosis.holdout import without_memory
from matching.diagnosis.hypotheses import Hypothesis
from matching.diagnosis.problem import FitProblem
from matching.diagnosis.settings import DiagnosisSettings
from matching.diagnosis.simulation import simulate_states
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


def recordings_of(data: FitData) -> Blocks:
    """Whole recordings as blocks."""
    names = dict.fromkeys((segment.name, segment.recording) for segment in data.segments)
    return Blocks(len(names), {name: np.empty(0) for name in names})


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
STEPS = 3  # Gauss–Newton steps with the Jacobian of the fit; each is a simulation for every block
ENOUGH, ENOUGH_SHARE = 3.0, 3e-3  # χ² of the other blocks, and share of it, that is worth no further step
ITERATIONS = 8  # of a refit
FEWEST_OF_PIECE = 16  # samples of a block in a segment: fewer are met from some start state, whatever the model
RESTART_ITERATIONS = 4  # of the fit of the state with which a block begins, nearly linear


def unseen_errors(fit: Fit, blocks: Blocks) -> list[np.ndarray]:
    """(measured − simulated)/noise (t, y) of every segment, each block by the model fitted to the others; NaN where
    nothing was measured.

    Only the state with which the block begins is fitted to the block itself, as to a recording of its own: else an
    error of the speed long before would speak against what is right within the block.
    """
    number = [_in_pieces(blocks.of(segment)) for segment in fit.problem.data.segments]
    return _restarted(fit.problem, number, _values_without(fit, number, blocks.count))


def _in_pieces(number: np.ndarray) -> np.ndarray:
    """Numbers of blocks (t,) without pieces of a few samples, which join a neighbour: a window may end with the first
    samples of the next block."""
    out = number.copy()
    edges = [0, *(np.flatnonzero(np.diff(out)) + 1).tolist(), len(out)]
    for first, last in pairwise(edges):
        if last - first < FEWEST_OF_PIECE and last - first < len(out):
            out[first:last] = out[first - 1] if first else out[last]
    return out


def _values_without(fit: Fit, number: Sequence[np.ndarray], count: int) -> np.ndarray:
    """Variables (b, v) fitted to all blocks but one, for each block; where torques jump, χ² has kinks and the steps
    are taken only as far as they lower it."""
    left_out = _LeftOut(fit, number, count)
    v, costs, gradients = np.repeat(fit.v[None], count, axis=0), *left_out.at_fit()
    worth = np.zeros(count, bool)  # blocks without which the fit would be another
    for number_of_step in range(STEPS):
        steps, promised = left_out.steps(v, gradients)
        more = promised > np.maximum(ENOUGH, ENOUGH_SHARE * costs)
        if number_of_step and (not more.any() or time_is_over()):
            break
        worth |= more
        moved = np.clip(v + steps, fit.problem.lower, fit.problem.upper)
        costs_there, gradients_there = left_out.costs(moved)
        taken = costs_there < costs + ENOUGH
        v[taken], costs[taken], gradients[:, taken] = moved[taken], costs_there[taken], gradients_there[:, taken]
        if not taken.any():
            break
    for block in np.flatnonzero((v == fit.v).all(axis=1) & worth):  # no step leads to the fit without the block
        v[block] = _refitted(fit, number, int(block))
    return v


def _restarted(problem: FitProblem, number: Sequence[np.ndarray], v: np.ndarray) -> list[np.ndarray]:
    """Errors (t, y) of every segment, each block with its row of variables (b, v) and the state with which it begins
    fitted to it; NaN where nothing was measured. The zero of an angle sensor is that of the blocks that are seen, where
    the segment has any."""
    segments = problem.data.segments
    out = [np.full(segment.readings.shape, np.nan) for segment in segments]
    plain = without_memory(problem)
    for block, variables in enumerate(v):
        there = [i for i, own in enumerate(number) if (own == block).any()]
        if not there:
            continue
        p, starts = problem.unpack(variables)
        states = simulate_states(
            problem.model, [segments[i] for i in there], p, [starts[i] for i in there], problem.steps_per_second
        )
        pieces: list[tuple[int, int, int]] = []
        begins: list[np.ndarray] = []
        for i, motion in zip(there, states, strict=True):
            edges = np.flatnonzero(np.diff(np.concatenate([[False], number[i] == block, [False]]).astype(int)))
            for first, last in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
                pieces.append((i, first, last))
                begins.append(motion[first])
        k = len(problem.free)
        values = dict(zip(problem.free, variables[:k].tolist(), strict=True))
        part = replace(
            plain,
            system=plain.system.with_values({n: x for n, x in values.items() if n in plain.system.parameters}),
            data=replace(problem.data, segments=tuple(segments[i].part(a, b) for i, a, b in pieces)),
            bounds={}, held_states=begins,
        )  # fmt: skip
        zeros = _zeros(problem, variables, [own == block for own in number]) if problem.with_zero else {}
        for (i, a, b), errors in zip(pieces, _errors_from(part, begins), strict=True):
            out[i][a:b] = np.where(segments[i].measured[a:b], errors, np.nan)
            for j in problem.with_zero:
                out[i][a:b, j] -= zeros[i, j]
    return out


def _zeros(problem: FitProblem, v: np.ndarray, left_out: Sequence[np.ndarray]) -> dict[tuple[int, int], float]:
    """By segment and sensor, the zero of each angle sensor, in times its noise, from the samples that are seen."""
    out = {}
    for i, errors in enumerate(problem.deviations(v[None])):
        measured = problem.data.segments[i].measured
        for j in problem.with_zero:
            known = measured[:, j] & ~left_out[i]
            known = known if known.any() else measured[:, j]
            out[i, j] = float(errors[0][known, j].mean()) if known.any() else 0.0
    return out


def _errors_from(problem: FitProblem, begins: list[np.ndarray]) -> list[np.ndarray]:
    """Errors (t, y) of every segment, the start states fitted from those given (x,), zeros not taken off; infinite
    where that does not simulate."""
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            fit = solve(problem, problem.pack({}, begins), None, FitOptions(RESTART_ITERATIONS, timed=False))
            return [errors[0] for errors in problem.deviations(fit.v[None])]
    except FitError:
        return [np.full(segment.readings.shape, np.inf) for segment in problem.data.segments]


class _LeftOut:
    """A fit without one block after the other: Gauss–Newton steps by the Jacobian of the fit, and simulations.

    Arrays have a row for every block that is left out. Gradients (2, b, v) are those of the blocks that are seen, and
    those of all.
    """

    def __init__(self, fit: Fit, number: Sequence[np.ndarray], count: int):
        problem, k = fit.problem, len(fit.problem.free)
        self.fit, self.number, self.count = fit, number, count
        begins, columns = [part[0] for part in number], np.split(np.arange(k, problem.size), len(number))
        self.own = [
            [c for begin, some in zip(begins, columns, strict=True) if begin == block for c in some]
            for block in range(count)
        ]
        width = problem.upper[:k] - problem.lower[:k]
        prior = np.zeros(problem.size)
        prior[:k] = np.where(np.isfinite(width) & (width > 0), np.sqrt(PRIOR) / np.maximum(width, 1e-300), 0.0)
        sensors = len(problem.data.noise)
        self.rows = [np.flatnonzero(np.repeat(np.concatenate(number), sensors) == block) for block in range(count)]
        factors = [np.asarray(np.linalg.qr(fit.jacobian[rows], mode="r")) for rows in self.rows]
        self.products = np.sum([factor.T @ factor for factor in factors], axis=0)
        self.models: list[Quadratic | None] = []
        for block in range(count):
            try:
                others = [factor for i, factor in enumerate(factors) if i != block]
                self.models.append(Quadratic(np.vstack([*others, np.diag(prior)])))
            except FitError:
                self.models.append(None)

    def at_fit(self) -> tuple[np.ndarray, np.ndarray]:
        """χ² (b,) of the blocks that are seen, and gradients (2, b, v), at the fit itself."""
        parts = [self.fit.residual[rows] for rows in self.rows]
        costs = np.array([float(part @ part) for part in parts])
        own = np.array([self.fit.jacobian[rows].T @ part for rows, part in zip(self.rows, parts, strict=True)])
        every = np.repeat(own.sum(axis=0)[None], self.count, axis=0)
        return costs.sum() - costs, np.array([every - own, every])

    def steps(self, v: np.ndarray, gradients: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Steps (b, v) from variables (b, v), and the decrease (b,) of χ² that they promise."""
        problem, steps, promised = self.fit.problem, np.zeros_like(v), np.zeros(len(v))
        for block, model in enumerate(self.models):
            if model is None:
                continue
            low, high = problem.lower - v[block], problem.upper - v[block]
            step, promised[block] = model.step(gradients[0, block], low, high, np.inf)
            if own := self.own[block]:
                step[own] = 0.0
                toward = gradients[1, block][own] + self.products[own] @ step
                step[own] = -np.linalg.lstsq(self.products[np.ix_(own, own)], toward, rcond=1e-10)[0]
            steps[block] = step
        return steps, promised

    def costs(self, batch: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of rows of variables (b, v), each without its block: χ² (b,) of the blocks that are seen, infinite where the
        simulation diverges, and gradients (2, b, v)."""
        with np.errstate(over="ignore", invalid="ignore"):
            residuals = self.fit.problem.residuals(batch)
            squares = np.array([[float(r[rows] @ r[rows]) for rows in self.rows] for r in residuals])
            costs = squares.sum(axis=1) - np.diag(squares)
            every = residuals @ self.fit.jacobian
            inside = np.array([residuals[b, rows] @ self.fit.jacobian[rows] for b, rows in enumerate(self.rows)])
        return np.where(np.isfinite(squares).all(axis=1), costs, np.inf), np.array([every - inside, every])


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
        with np.errstate(over="ignore", invalid="ignore"):  # where a step makes the simulation diverge
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
    def rms_by_sensor(self) -> np.ndarray:
        """Root mean square (y,) over the blocks, in times the noise; NaN without readings."""
        known = np.isfinite(self.blocks)
        count = known.sum(axis=0)
        return np.where(count, np.sqrt(np.nansum(self.blocks, axis=0) / np.maximum(count, 1)), np.nan)

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

    def knows(self, hypothesis: Hypothesis) -> bool:
        """Whether the errors of a hypothesis have been worked out."""
        return id(hypothesis.fit) in self._known

    def pooled(self, hypothesis: Hypothesis) -> float:
        """Root mean square over the sensors of the error over the sensor's range; infinite where it does not
        simulate."""
        error = self.error(hypothesis)
        return np.inf if error is None or np.isnan(error.pooled) else error.pooled

    def misfit(self, hypothesis: Hypothesis) -> float:
        """Root mean square of all errors, in times the noise; infinite where it does not simulate."""
        error = self.error(hypothesis)
        return np.inf if error is None else error.misfit

    def shares_explained(self, child: Hypothesis, parent: Hypothesis) -> np.ndarray:
        """Share (y,) of a hypothesis's misfit of each sensor, beyond the noise, that another one explains, at most 1; 0
        of a sensor that is at its noise."""
        after, before = self.error(child), self.error(parent)
        if after is None or before is None:
            return np.full(1, float(before is None))
        new, old = (np.nan_to_num(np.nanmean(e.blocks, axis=0), nan=1.0) for e in (after, before))
        beyond = old > AT_NOISE
        return np.where(beyond, (old - np.maximum(new, 1.0)) / np.where(beyond, old - 1.0, 1.0), 0.0)

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

    def prefers(self, hypothesis: Hypothesis, other: Hypothesis) -> bool:
        """Whether a hypothesis meets unseen data better than another, as far as the sensors say on average."""
        return bool(self._drawn(hypothesis, other)[0].mean() > 0)

    def accepts(self, child: Hypothesis, parent: Hypothesis) -> bool:
        """Whether a hypothesis meets unseen data better than another, beyond chance.

        Of every sensor the difference of the mean squares counts, over the larger of both: a sensor says as much as
        another whatever it measures, and one that is at its noise says nothing. Chance is that of the blocks of the
        data: a paired bootstrap draws them again and again, and all but a share ``chance`` of the draws have to find
        the child better.
        """
        return 1 - self.probability(child, parent) < self.settings.chance

    def probability(self, child: Hypothesis, parent: Hypothesis) -> float:
        """Share of the draws of the blocks in which a hypothesis meets unseen data better than another."""
        gain, _ = self._drawn(child, parent)
        return float(np.mean(gain > 0))

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
