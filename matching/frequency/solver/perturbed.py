"""Searches from about the best end: what several starts agree on may still be a poor optimum.

Starts drawn over the whole range share what is typical of it, so that they may all end in one poor basin. Two ways lead
out. The basins of a feedback law differ by one gain mostly (integral gain at its upper bound or small, acceleration
feed-forward zero or about one), and by what goes with it (the residual vehicle's inertia): set to the other place
alone, the gain comes back. So each of the loop's quantities is held at the ends and at the middle of its range while
the rest is tuned for it, and released from there (profile of the objective over that quantity). Then all quantities are
moved by steps of random size and direction (iterated local search: Lourenço, Martin and Stützle, in Handbook of
Metaheuristics, 2003).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from matching.frequency.programme.problem import Problem
from matching.frequency.solver.continuation import follows_targets
from matching.frequency.solver.ends import End, stable_ends
from matching.frequency.solver.nearest_roots import with_nearest_roots
from matching.frequency.solver.starts import merit, start
from matching.frequency.solver.task import AGREEMENT, TuningTask

PLACES = (0.98, 0.02, 0.5)  # of its range, to which one of the loop's quantities is set
NEAR_PLACE = 0.1  # of its range: a quantity so near is there already
WORTH_RELEASING = 1.1  # times the best objective, up to which a quantity that was held is released
STEPS = (0.2, 0.4)  # standard deviations, of each quantity's range; tried in turn
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
    for end in ends_about(problem, best, random):
        least = (better_end or best).objective
        if end.objective < least - AGREEMENT * abs(least) and follows_targets(task, end):
            better_end = end
    return better_end


def ends_about(problem: Problem, best: End, random: np.random.Generator) -> Iterator[End]:
    """Ends from eigenpairs on their targets again, from one gain elsewhere, and from all a little elsewhere."""
    v, size = best.v, len(problem.moves)
    targets = start(problem, None)[size:]
    if len(v) > size:
        yield from stable_ends(problem, [with_nearest_roots(problem, v), np.concatenate([v[:size], targets])])
    for i, move in enumerate(problem.moves):
        if move.name.startswith("loop."):
            for place in PLACES:
                if abs(v[i] - place) > NEAR_PLACE:
                    yield from held_and_released(problem, best, i, place)
    drawn = [np.concatenate([random.uniform(0.01, 0.99, size), targets]) for _ in range(DRAWN_ANYWHERE)]
    begins = sorted(drawn, key=lambda begin: merit(problem, begin))[:TRIED_ANYWHERE]
    for step in STEPS:
        begin = v.copy()
        begin[:size] = np.clip(begin[:size] + step * random.normal(size=size), 0.01, 0.99)
        begins.append(begin)
    yield from stable_ends(problem, begins)


def held_and_released(problem: Problem, best: End, number: int, place: float) -> Iterator[End]:
    """The end from a quantity held at a place with the rest tuned for it; where that ends nowhere, set there only."""
    begin, lower, upper = best.v.copy(), problem.lower.copy(), problem.upper.copy()
    begin[number] = lower[number] = upper[number] = place
    held = next(stable_ends(replace(problem, lower=lower, upper=upper), [begin]), None)
    if held is None:
        yield from stable_ends(problem, [begin])
    elif held.objective <= best.objective + (WORTH_RELEASING - 1) * abs(best.objective):
        yield from stable_ends(problem, [held.v])
