"""Searches from about the best end: what several starts agree on may still be a poor optimum.

Starts drawn over the whole range share what is typical of it, so that they may all end in one poor basin. Two ways lead
out. The basins of a feedback law differ by one gain mostly (integral gain at its upper bound or small, acceleration
feed-forward zero or about one): each of the loop's quantities is set to the ends and to the middle of its range, the
rest as it is. Then all quantities are moved by steps of random size and direction (iterated local search: Lourenço,
Martin and Stützle, in Handbook of Metaheuristics, 2003).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from matching.frequency.programme.problem import Problem
from matching.frequency.solver.continuation import follows_targets
from matching.frequency.solver.ends import End, stable_ends
from matching.frequency.solver.nearest_roots import with_nearest_roots
from matching.frequency.solver.starts import merit, start
from matching.frequency.solver.task import AGREEMENT, TuningTask

PLACES = (0.98, 0.02, 0.5)  # of its range, to which one of the loop's quantities is set
NEAR_PLACE = 0.1  # of its range: a quantity so near is there already
STEPS = (0.2, 0.4, 0.05, 0.3)  # standard deviations, of each quantity's range; tried in turn
DRAWN_ANYWHERE, TRIED_ANYWHERE = 64, 3  # settings drawn over all bounds, and the most promising that are searched from
MOST_ROUNDS = 4  # about one end after another, as far as they get better


def improved(task: TuningTask, problem: Problem, best: End, seed: int) -> End:
    """The best end that searches from about it reach; itself where a whole round gets no better."""
    random = np.random.default_rng([seed, len(problem.moves)])
    for _ in range(MOST_ROUNDS):
        end = _round(task, problem, best, random)
        if end is None:
            break
        best = end
    return best


def _round(task: TuningTask, problem: Problem, best: End, random: np.random.Generator) -> End | None:
    """The best of a round of searches about an end; None where none is better."""
    better_end = None
    for begin in begins_about(problem, best.v, random):
        end = next(stable_ends(problem, [begin]), None)
        least = (better_end or best).objective
        better = end is not None and end.objective < least - AGREEMENT * abs(least)
        if better and end is not None and follows_targets(task, end):
            better_end = end
    return better_end


def begins_about(problem: Problem, v: np.ndarray, random: np.random.Generator) -> Iterator[np.ndarray]:
    """Starts (v,) about an end: eigenpairs on their targets again, one gain elsewhere, and all a little elsewhere."""
    size = len(problem.moves)
    targets = start(problem, None)[size:]
    if len(v) > size:
        yield with_nearest_roots(problem, v)
        yield np.concatenate([v[:size], targets])
    for i, move in enumerate(problem.moves):
        if move.name.startswith("loop."):
            for place in PLACES:
                if abs(v[i] - place) > NEAR_PLACE:
                    begin = v.copy()
                    begin[i] = place
                    yield begin
    drawn = [np.concatenate([random.uniform(0.01, 0.99, size), targets]) for _ in range(DRAWN_ANYWHERE)]
    yield from sorted(drawn, key=lambda begin: merit(problem, begin))[:TRIED_ANYWHERE]
    for step in STEPS:
        begin = v.copy()
        begin[:size] = np.clip(begin[:size] + step * random.normal(size=size), 0.01, 0.99)
        yield begin
