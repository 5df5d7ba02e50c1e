"""The response error over one adapter quantity, all that may move beside it tuned for each value."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from matching.frequency.case.case import Case, Move
from matching.frequency.case.tuned import apply
from matching.frequency.programme.margin_grid import SLOTS
from matching.frequency.programme.problem import Problem
from matching.frequency.programme.scaling import scaled, unscaled
from matching.frequency.response.band import BandNodes
from matching.frequency.response.response_error import log_squares, pooled
from matching.frequency.response.responses import ComparedBed
from matching.frequency.solver.ends import End, stable_ends
from matching.frequency.solver.least_change import AS_GOOD, vector_of
from matching.frequency.solver.starts import gentler
from matching.frequency.solver.task import Solution, TuningTask

PLACES = np.linspace(0, 1, 5)  # of the range between the bounds, at which the error is worked out
MARGIN_ROUNDS, AROUND = 4, 0.015  # of asking for a margin missed between the grid, and how far about it, relative
JUMP = 1.1  # times a neighbour's objective, above which a value is taken to lie at a poorer optimum than that
FOLLOWING_STEPS = 5  # in which a neighbour's optimum is followed to such a value
HALVINGS = 2  # of the way between a value that is as good and one that is not, in looking for the end of the range


def feedback_error(tuned: Case, nodes: BandNodes) -> float:
    """Response error of the feedback alone, over the band."""
    bed = ComparedBed(tuned).at(nodes.frequencies)
    return pooled(nodes.root_mean(log_squares(bed.unmeasured, bed.vehicle)))


@dataclass
class Retuning:
    """The answer about one adapter quantity, number ``moved`` of the task's, with others ``held`` at scaled values.

    ``ends`` are the best settings by the quantity's scaled value; None where no loop was found that keeps the limits.
    """

    task: TuningTask
    solution: Solution
    moved: int
    held: Mapping[int, float]
    ends: dict[float, End | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.problem: Problem = self.task.build(slots=SLOTS)
        self.begin = vector_of(self.task, self.solution)
        self.ordered = float(self.begin[self.moved])

    def survey(self, *more: float) -> None:
        """Work out the error at :data:`PLACES`, at the ordered and at more values, from the ordered one outwards."""
        places = sorted({*PLACES.tolist(), *more, self.ordered})
        at = places.index(self.ordered)
        for way in (places[at:], places[:at][::-1]):
            for place in way:
                self.as_good(place)

    def follow_neighbours(self) -> None:
        """Where the error jumps between neighbouring values, follow the better optimum to the other, in small steps.

        Each value is tuned from one neighbour. A large step may leave that optimum for a poorer one, or for none.
        """
        places = sorted(self.ends)
        for way in (places, places[::-1]):
            for near, place in pairwise(way):
                better, end = self.ends[near], self.ends[place]
                if better is None or (end is not None and end.objective <= JUMP * better.objective):
                    continue
                followed = self._followed(better, near, place)
                if followed is not None and (end is None or followed.objective < end.objective):
                    self.ends[place] = followed

    def as_good(self, place: float) -> bool:
        """Whether a value is as good as the best, all else tuned for it."""
        if place not in self.ends:
            self.ends[place] = self._tuned(place)
        end = self.ends[place]
        return end is not None and end.objective <= self.solution.as_good_to

    def as_good_between(self) -> tuple[float, float]:
        """Ends of the range about the ordered value in which every value tried is as good; each is one that is."""
        places = sorted(self.ends)
        at = places.index(self.ordered)
        lower, upper = (self._last_good(way) for way in (places[: at + 1][::-1], places[at:]))
        return lower, upper

    def curve(self, nodes: BandNodes) -> list[tuple[float, float]]:
        """Values, SI, and the response error there; what keeps no limits is left out."""
        move, points = self.task.moves[self.moved], []
        for place, end in sorted(self.ends.items()):
            if end is not None:
                tuned = apply(self.task.case, self.problem.values(end.v))
                points.append((float(unscaled(place, move)), feedback_error(tuned, nodes)))
        return points

    def _last_good(self, way: list[float]) -> float:
        good = way[0]
        for place in way[1:]:
            if self.as_good(place):
                good = place
                continue
            for _ in range(HALVINGS):
                middle = (good + place) / 2
                good, place = (middle, place) if self.as_good(middle) else (good, middle)
            break
        return float(np.clip(good, 0, 1))

    def _tuned(self, place: float) -> End | None:
        """From the nearest value that was solved, and from the answer itself where that is not as good.

        A neighbour may lie at another local optimum, which every value after it would inherit.
        """
        known = {other: end.v for other, end in self.ends.items() if end is not None}
        near = known[min(known, key=lambda other: abs(other - place))] if known else self.begin
        best = self._tuned_from(near, place)
        if near is self.begin or (best is not None and best.objective <= self.solution.as_good_to):
            return best
        ends = (end for end in (best, self._tuned_from(self.begin, place)) if end is not None)
        return min(ends, key=lambda end: end.objective, default=None)

    def _followed(self, end: End, near: float, place: float) -> End | None:
        """The end at one value, followed to another; None where it is lost on the way."""
        followed: End | None = end
        for step in np.linspace(near, place, FOLLOWING_STEPS + 1)[1:]:
            followed = None if followed is None else self._tuned_from(followed.v, float(step))
        return followed

    def _tuned_from(self, start: np.ndarray, place: float) -> End | None:
        lower, upper = self.problem.lower.copy(), self.problem.upper.copy()
        v = start.copy()
        for i, value in {**self.held, self.moved: place}.items():
            v[i] = lower[i] = upper[i] = value
        problem = replace(self.problem, lower=lower, upper=upper)
        least, extra = (1 - AS_GOOD) * self.task.case.limits["modulus_margin"], list(self.solution.added)
        for _ in range(MARGIN_ROUNDS):
            end = next(stable_ends(problem, [v, *gentler(problem, v)], np.array(extra)), None)
            if end is None or end.margin >= least:
                return end
            v = end.v
            extra += [end.margin_frequency * part for part in (1 - AROUND, 1 + AROUND, 1.0)]
        return None


def some_as_planned(task: TuningTask, solution: Solution, planned: Sequence[Move]) -> Solution | None:
    """The answer with some quantities held as planned, from the answer that moves them; None where no limits are kept.

    Parameters
    ----------
    planned : sequence of Move
        At least one of the task's.
    """
    held = {task.moves.index(move): scaled(move.planned, move) for move in planned}
    moved = next(iter(held))
    retuning = Retuning(task, solution, moved, held)
    retuning.as_good(held[moved])
    end = retuning.ends[held[moved]]
    if end is None:
        return None
    pairs = tuple(end.v[len(task.moves) :].tolist())
    return Solution(retuning.problem.values(end.v), end.objective, (), True, pairs=pairs)
