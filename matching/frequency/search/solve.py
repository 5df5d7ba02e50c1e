"""Many starts, the best solved again tightly.

Where starts do not agree, as with feedback alone across a long dead time, some begin at a shorter dead time and are led
to the case's own in steps: good optima are reached that way that no start at the full dead time finds. Nor are starts
trusted that agree on a place where the loop has no root near a target mode any more.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cache
from itertools import chain, islice
from multiprocessing import get_context
from typing import NamedTuple

import numpy as np

from matching.frequency.case.case import Case, Move
from matching.frequency.case.demands import Demands
from matching.frequency.case.targets import Goal
from matching.frequency.case.tuned import apply
from matching.frequency.loop.encirclements import encirclements
from matching.frequency.loop.parts import parts_of
from matching.frequency.programme.build import build
from matching.frequency.programme.margin_grid import SLOTS
from matching.frequency.programme.objective import Objective
from matching.frequency.programme.problem import Problem, eigenpairs
from matching.frequency.programme.scaling import scaled
from modelling.common import floating_point

FEASIBLE = 1e-5  # largest violation of a scaled constraint
AGREE = 5e-3  # relative: starts that end so close count as one optimum
ENOUGH = 3  # starts that agree on the best before the search ends
MINORITY = 3  # one in so many starts at least has to agree: where most fail, few that agree may do so on little
DRAWS = 12  # of which a random start is the most promising: far fewer of those end nowhere
MISSING = 10.0  # price of a missed constraint, scaled, in choosing it
FIRST = 5  # starts before those that are led
FAR = 2.0  # times the frequency of a target mode
LED = 4  # starts at a shorter dead time where the others do not agree
WAYS = (np.geomspace(0.25, 1, 14), np.linspace(0.4, 1, 9))  # in parts of the dead time; the second where one fails
LOST = 2  # steps in a row that end infeasible or unstable: it is not led this way any further
WORTH_A_PROCESS = 4.0  # s that a start takes
TRIED = 3  # ends that are tried for one that holds the margin between the grid as well
ROUNDS = 8  # of putting frequencies where the margin is missed between the grid
AROUND = 0.015  # about such a frequency more are held, as it moves when it is held; a third of it the next time


class End(NamedTuple):
    """Where IPOPT ended: objective, decision vector (v,), and whether it is a minimum to six digits by its word.

    With the modulus margin and where it is (Hz), once it was checked.
    """

    objective: float
    v: np.ndarray
    converged: bool
    margin: float = float("nan")
    margin_frequency: float = float("nan")


@dataclass(frozen=True)
class Solution:
    """Tuned values by name (SI), the objective there and that of every start (None: infeasible or unstable).

    ``holds`` is whether the modulus margin is kept between the frequencies of the grid, too, and ``added`` are those
    (Hz) at which it was asked for beside the grid. ``pairs`` are the goals' eigenpairs as the decision vector has them.
    """

    values: dict[str, float]
    objective: float
    starts: tuple[float | None, ...]
    feasible: bool
    holds: bool = True
    added: tuple[float, ...] = ()
    pairs: tuple[float, ...] = ()


@dataclass(frozen=True)
class Near:
    """Solutions of like cases to start from, in place of starts of its own.

    Each is its tuned values by name (SI) and its eigenpairs as :class:`Solution` has them. ``below`` is the objective
    that has to be beaten, None where there is none yet.
    """

    solutions: tuple[tuple[Mapping[str, float], Sequence[float]], ...]
    below: float | None = None

    def beaten_by(self, objective: float) -> bool:
        """Whether an objective is lower by more than ends of one optimum differ."""
        return self.below is None or objective < self.below - AGREE * abs(self.below)


class NoBetter(Exception):
    """Nothing below the objective that had to be beaten."""


@dataclass(frozen=True)
class Task:
    """The programme to solve, as :func:`matching.frequency.programme.build.build` takes it."""

    case: Case
    moves: tuple[Move, ...]
    weights: np.ndarray
    goals: tuple[Goal, ...]
    objective: Objective
    demands: Demands

    def build(self, tight: bool = False, exact: bool = False, slots: int = 0, compiled: bool = True) -> Problem:
        """The programme."""
        return build(
            self.case, self.moves, self.weights, self.goals, self.objective, self.demands,
            tight=tight, exact=exact, slots=slots, compiled=compiled,
        )  # fmt: skip


def solve(
    task: Task, seed: int = 0, starts: int = 14, workers: int = 1, progress: Callable[[str], None] | None = None,
    near: Near | None = None,
) -> Solution:  # fmt: skip
    """Solve the programme of a case from many starts.

    Parameters
    ----------
    task : Task
    seed : int
        Of the random starts; the first is the case's own start with a gentle loop.
    starts : int
        At most; the search ends when three, and a third, agree on the best, of the first five or of those after them,
        which begin with four led ones. What has lost a target mode counts for no agreement.
    workers : int
        Processes; the outcome does not depend on how many.
    near : Near, optional
        To start from these alone.

    Raises
    ------
    NoBetter
        If those lead to nothing better.
    """
    if near is not None:
        return _from(task, near)
    ends: list[End | None] = []
    enough, led = (
        min(ENOUGH, starts),
        0 if not task.objective.tracks_modes or task.case.loop.torqueless else min(LED, starts),
    )
    plain = _ends(task, seed, starts, workers)
    for end in chain(islice(plain, FIRST), _led(task, seed, range(1, led + 1)), plain):
        ends.append(end)
        if progress:
            progress(f"start {len(ends)} of {starts + led} at most")
        best = min((end for end in ends if end), key=lambda end: end.objective, default=None)
        agreeing = sum(end.objective <= best.objective * (1 + AGREE) for end in ends if best and end)
        tried = len(ends) - (FIRST if len(ends) > FIRST else 0)  # plain ones that fail say little about those led
        if best and _follows(task, best) and agreeing >= max(enough, tried / MINORITY):
            break
    kept = [end for end in ends if end]
    values = tuple(None if end is None else end.objective for end in ends)
    if not kept:
        problem = task.build()
        return Solution(problem.values(_start(problem, None)), float("nan"), values, False, False)
    return _first_that_holds(task, kept, values)


def _ends(task: Task, seed: int, starts: int, workers: int) -> Iterator[End | None]:
    """The ends of the starts, in order; in other processes only where one takes longer than they take to begin."""
    problem, began = task.build(), time.monotonic()
    yield _one(problem, seed, 0)
    if workers < 2 or time.monotonic() - began < WORTH_A_PROCESS:
        for number in range(1, starts):
            yield _one(problem, seed, number)
        return
    with ProcessPoolExecutor(workers, get_context("spawn"), _prepare, (task,)) as pool:
        waiting = [pool.submit(_one_prepared, seed, number) for number in range(1, starts)]
        try:
            for future in waiting:
                yield future.result()
        finally:
            for future in waiting:
                future.cancel()


_prepared: list[Problem] = []


def _prepare(task: Task) -> None:
    """Build the programme once a process."""
    _prepared[:] = [task.build()]


def _one_prepared(seed: int, number: int) -> End | None:
    return _one(_prepared[0], seed, number)


def _one(problem: Problem, seed: int, number: int) -> End | None:
    """One start, or None if it ends infeasible or unstable."""
    return next(_stable(problem.oscillating(), [_numbered(problem, seed, number)]), None)


def _led(task: Task, seed: int, numbers: Sequence[int]) -> Iterator[End | None]:
    """Starts at a shorter dead time, led to the case's own; None if no way leads there."""
    loop = task.case.loop

    @cache  # every start passes there
    def at(part: float, tight: bool) -> Problem:
        shorter = replace(task.case, loop=loop.with_values({"dead_time": part * loop["dead_time"]}))
        return replace(task, case=shorter).build(tight=tight)

    for number in numbers:
        yield next((end for way in WAYS if (end := _along(task, way, at, seed, number))), None)


def _along(task: Task, way: np.ndarray, at: Callable[[float, bool], Problem], seed: int, number: int) -> End | None:
    """One start on one way; None if the last step or two in a row end nowhere."""
    v, end, failed = None, None, 0
    for part in way:
        problem = at(part, v is not None)
        if v is None:
            problem = problem.oscillating()
            v = _numbered(problem, seed, number)
        end = next((end for end in _stable(problem, [v, *_gentler(problem, v)]) if _follows(task, end)), None)
        v, failed = (v, failed + 1) if end is None else (end.v, 0)
        if failed == LOST:
            return None
    return end


def _follows(task: Task, end: End) -> bool:
    """Whether the eigenvalues tracked are not roots far above the modes they were to follow."""
    pairs = eigenpairs(end.v, len(task.moves), task.case)
    return bool((np.hypot(pairs[:, 0], pairs[:, 1]) < FAR).all())


def _first_that_holds(task: Task, ends: list[End], starts: tuple[float | None, ...]) -> Solution:
    """The best end that can be made to hold the margin between the grid as well; the best of all if none can."""
    found: list[Solution] = []
    last = -np.inf
    for end in sorted(ends, key=lambda end: end.objective):
        if end.objective <= last + AGREE * abs(last):  # the one before again
            continue
        last = end.objective
        found.append(_tight(task, end, starts))
        if found[-1].holds or len(found) == TRIED:
            break
    return next((one for one in found if one.holds), found[0])


def _tight(task: Task, best: End, starts: tuple[float | None, ...]) -> Solution:
    """Solve again to more digits, and ask for the margin where it is missed between the grid, until it holds.

    What IPOPT then does not call a minimum is solved once more with the exact Hessian.
    """
    problem, extra = task.build(tight=True, slots=SLOTS), np.zeros(0)
    least = task.case.limits["modulus_margin"]
    for number in range(ROUNDS):
        if best.margin < least:
            missed = np.append(problem.missed(best.v), best.margin_frequency)
            apart = AROUND / 3**number
            extra = np.concatenate([extra, *(missed * part for part in (1 - apart, 1 + apart, 1.0))])
        end = next(_stable(problem, [best.v, *_gentler(problem, best.v)], extra), None)
        if end is None:
            break
        best = end
        if best.margin >= least:
            break
    if not best.converged:
        exact = task.build(tight=True, exact=True, slots=SLOTS)
        end = next(_stable(exact, [best.v], extra), None)
        if end and end.objective < best.objective and end.margin >= least:
            best = end
    holds, pairs = best.margin >= least, best.v[len(problem.moves) :]
    values = problem.values(best.v)
    return Solution(values, best.objective, starts, True, holds, tuple(extra.tolist()), tuple(pairs.tolist()))


def _from(task: Task, near: Near) -> Solution:
    """The best end from the solutions of like cases, with their eigenpairs and with those on their targets."""
    problem = task.build()
    begins = [_begin(problem, values, own) for values, pairs in near.solutions for own in (pairs, ())]
    ends = list(_stable(problem, begins))
    if not any(near.beaten_by(end.objective) for end in ends):
        raise NoBetter
    found = _first_that_holds(task, ends, tuple(end.objective for end in ends))
    if not near.beaten_by(found.objective):
        raise NoBetter
    return found


def _begin(problem: Problem, values: Mapping[str, float], pairs: Sequence[float] = ()) -> np.ndarray:
    """A start at given values, eigenpairs as given or on their targets."""
    begin = _start(problem, None)
    own = [scaled(values[move.name], move) for move in problem.moves]
    begin[: len(own)] = np.clip(own, 0.01, 0.99)
    if len(pairs) == len(begin) - len(own):
        begin[len(own) :] = pairs
    return begin


def warm(task: Task, near: Solution) -> dict[str, float] | None:
    """Solve a programme from the solution of a neighbouring one and from gentler loops; None if all are unstable."""
    problem = task.build()
    begin = _begin(problem, near.values)
    good = list(_stable(problem, [_begin(problem, near.values, near.pairs), begin, *_gentler(problem, begin)]))
    return _tight(task, min(good, key=lambda end: end.objective), ()).values if good else None


def _gentler(problem: Problem, v: np.ndarray) -> list[np.ndarray]:
    """The same with the loop's quantities turned back by a tenth and by a quarter of their ranges."""
    loop = np.array([move.name.startswith("loop.") for move in problem.moves] + [False] * (len(v) - len(problem.moves)))
    return [np.where(loop, np.clip(v - back, 0.01, 0.99), v) for back in (0.1, 0.25)]


def _numbered(problem: Problem, seed: int, number: int) -> np.ndarray:
    """A start by its number; 0 is the case's own."""
    return _start(problem, np.random.default_rng([seed, number]) if number else None)


def _start(problem: Problem, random: np.random.Generator | None) -> np.ndarray:
    """Mechanics around their own values, a loop gentle enough to be stable, eigenpairs on their targets.

    The case's own start, or the most promising of some drawn at random.
    """
    names, pairs = [move.name for move in problem.moves], [np.zeros(0)]
    loop = np.array([name.startswith("loop.") for name in names], bool)
    gentle = np.array([0.4 if "gain" in name or "time" in name else 0.3 for name in names])
    own = np.array([scaled(move.start, move) for move in problem.moves])
    for goal in problem.goals:
        s, pattern = goal.eigenvalue / abs(goal.eigenvalue), goal.pattern / np.linalg.norm(goal.pattern)
        pairs += [np.array([s.real, s.imag]), pattern, 0 * pattern]

    def begin(part: np.ndarray | float, shift: np.ndarray | float) -> np.ndarray:
        moves = np.where(loop, gentle * part, own + shift)
        return np.concatenate([np.clip(moves, 0.01, 0.99), *pairs])

    def merit(v: np.ndarray) -> float:
        f, g = (part.full().ravel() for part in problem.objective(v, problem.extra()))
        return float(np.nan_to_num(f[0] + MISSING * min(problem.violation(g), 1.0), nan=np.inf))

    if random is None:
        return begin(0.5, 0.0)
    drawn = (begin(random.random(len(own)), 0.2 * random.normal(size=len(own))) for _ in range(DRAWS))
    return min(drawn, key=merit)


def _stable(problem: Problem, begins: Sequence[np.ndarray], extra: np.ndarray | tuple[()] = ()) -> Iterator[End]:
    """The feasible and stable ends from several starts, each sought when it is asked for."""
    for begin in begins:
        end = _run(problem, begin, extra)
        if end:
            margin, frequency, stable = _check(problem, end.v)
            if stable:
                yield end._replace(margin=margin, margin_frequency=frequency)


def _run(problem: Problem, v: np.ndarray, extra: np.ndarray | tuple[()] = ()) -> End | None:
    """IPOPT from a start; its word is not taken: finite, within bounds and constraints, or None.

    ``extra`` are frequencies in Hz at which the margin is to hold beside the grid.
    """
    p, bounds = problem.extra(extra), {"lbg": problem.g_lower, "ubg": problem.g_upper}
    found = problem.solver(x0=v, p=p, lbx=problem.lower, ubx=problem.upper, **bounds)
    floating_point.restore()  # the solver's libraries may leave it changed
    x = np.clip(found["x"].full().ravel(), problem.lower, problem.upper)
    f, g = (part.full().ravel() for part in problem.objective(x, p))
    if not (np.isfinite(x).all() and np.isfinite(f).all() and np.isfinite(g).all()):
        return None
    converged = problem.tight and bool(problem.solver.stats()["success"])
    return End(float(f[0]), x, converged) if problem.violation(g) <= FEASIBLE else None


def _check(problem: Problem, v: np.ndarray) -> tuple[float, float, bool]:
    """Modulus margin, where (Hz), and stability by encirclements on the exact loop, by code of its own."""
    found = encirclements(parts_of(apply(problem.case, problem.values(v))))
    return found.modulus_margin, found.margin_frequency, found.unstable == 0 and found.clear
