"""Starts of the local search."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from matching.frequency.programme.problem import Problem
from matching.frequency.programme.scaling import scaled

DRAWN_FOR_A_START = 12  # of which a random start is the most promising: far fewer of those end nowhere
VIOLATION_WEIGHT = 10.0  # on a missed constraint, scaled, in choosing a start


def numbered_start(problem: Problem, seed: int, number: int) -> np.ndarray:
    """A start (v,) by its number; 0 is the case's own."""
    return start(problem, np.random.default_rng([seed, number]) if number else None)


def start(problem: Problem, random: np.random.Generator | None) -> np.ndarray:
    """A start (v,): mechanics at their start values, a loop gentle enough to be stable, eigenpairs on their targets.

    The case's own start, or the most promising of some drawn at random.
    """
    names, pairs = [move.name for move in problem.moves], [np.zeros(0)]
    loop = np.array([name.startswith("loop.") for name in names], bool)
    gentle = np.array([0.4 if "gain" in name or "time" in name else 0.3 for name in names])
    point = np.array([scaled(move.start, move) for move in problem.moves])
    for goal in problem.goals:
        s, pattern = goal.eigenvalue / abs(goal.eigenvalue), goal.pattern / np.linalg.norm(goal.pattern)
        pairs += [np.array([s.real, s.imag]), pattern, 0 * pattern]

    def begin(part: np.ndarray | float, shift: np.ndarray | float) -> np.ndarray:
        moves = np.where(loop, gentle * part, point + shift)
        return np.concatenate([np.clip(moves, 0.01, 0.99), *pairs])

    if random is None:
        return begin(0.5, 0.0)
    drawn = (begin(random.random(len(point)), 0.2 * random.normal(size=len(point))) for _ in range(DRAWN_FOR_A_START))
    return min(drawn, key=lambda v: merit(problem, v))


def merit(problem: Problem, v: np.ndarray) -> float:
    """How little a start (v,) promises: its objective and what it misses of constraints, weighted."""
    f, g = (part.full().ravel() for part in problem.objective(v, problem.extra()))
    return float(np.nan_to_num(f[0] + VIOLATION_WEIGHT * min(problem.violation(g), 1.0), nan=np.inf))


def start_at(problem: Problem, values: Mapping[str, float], pairs: Sequence[float] = ()) -> np.ndarray:
    """A start (v,) at values by name (SI), eigenpairs as passed or on their targets."""
    begin = start(problem, None)
    point = [scaled(values[move.name], move) for move in problem.moves]
    begin[: len(point)] = np.clip(point, 0.01, 0.99)
    if len(pairs) == len(begin) - len(point):
        begin[len(point) :] = pairs
    return begin


def gentler(problem: Problem, v: np.ndarray) -> list[np.ndarray]:
    """The same start (v,) with the loop's quantities turned back by a tenth and by a quarter of their ranges."""
    loop = np.array([move.name.startswith("loop.") for move in problem.moves] + [False] * (len(v) - len(problem.moves)))
    return [np.where(loop, np.clip(v - back, 0.01, 0.99), v) for back in (0.1, 0.25)]
