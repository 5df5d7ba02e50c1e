"""The search: many starts, the best solved again tightly.

Starts are not trusted that agree on a place where the loop has no root near a target mode any more.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import chain, islice
from typing import NamedTuple

import numpy as np
import scipy

from matching.match.case import Case, Demands, Goal, Move, apply, scaled
from matching.match.loop import closed_poles, feedback_on, linear_bed, side_by_side
from matching.match.loop_modes import inside_unit_circle, neutral_motions
from matching.match.programme import SLOTS, SURVEY_HZ, Objective, Problem, build, eigenpairs, solved
from matching.studies import finished
from matching.worker_pool import executor_of
from modelling.modal.modes import modes
from modelling.resources import restore_floating_point

# --- Ends of the local search: IPOPT run once, its end checked for feasibility and stability.

LARGEST_VIOLATION = 1e-5  # largest violation of a scaled constraint
MARGIN_REFINEMENTS = 6  # of the grid about the lowest minima of the margin


class End(NamedTuple):
    """Where IPOPT ended: objective, decision vector (v,), and whether it is a minimum to six digits by its word.

    With the modulus margin and where it is (Hz), once it was checked.
    """

    objective: float
    v: np.ndarray
    converged: bool
    margin: float = float("nan")
    margin_frequency: float = float("nan")


def stable_ends(problem: Problem, begins: Sequence[np.ndarray], extra: np.ndarray | tuple[()] = ()) -> Iterator[End]:
    """The feasible and stable ends from several starts (v,), each sought when it is asked for."""
    for begin in begins:
        end = run_from(problem, begin, extra)
        if end:
            margin, frequency, stable = check(problem, end.v)
            if stable:
                yield end._replace(margin=margin, margin_frequency=frequency)


def run_from(problem: Problem, v: np.ndarray, extra: np.ndarray | tuple[()] = ()) -> End | None:
    """IPOPT from a start (v,); the end if it is finite and within bounds and constraints, else None.

    What IPOPT itself reports is not used. ``extra``: frequencies in Hz at which the margin is to hold beside the grid.
    """
    p, bounds = problem.extra(extra), {"lbg": problem.g_lower, "ubg": problem.g_upper}
    solution = solved(problem.solver, x0=v, p=p, lbx=problem.lower, ubx=problem.upper, **bounds)
    restore_floating_point()  # the solver's libraries may leave it changed
    x = np.clip(solution["x"].full().ravel(), problem.lower, problem.upper)
    f, g = (part.full().ravel() for part in problem.objective(x, p))
    if not (np.isfinite(x).all() and np.isfinite(f).all() and np.isfinite(g).all()):
        return None
    converged = problem.tight and bool(problem.solver.stats()["success"])
    return End(float(f[0]), x, converged) if problem.violation(g) <= LARGEST_VIOLATION else None


def check(problem: Problem, v: np.ndarray) -> tuple[float, float, bool]:
    """Modulus margin of the programme's loop, where (Hz), and stability of the sampled loop, of decisions (v,)."""
    bed = linear_bed(apply(problem.case, problem.values(v)))
    poles = closed_poles(side_by_side([bed.bed]), feedback_on(bed))[0]
    return *_margin(problem, v), inside_unit_circle(poles, neutral_motions(bed))


def _parameters(problem: Problem, v: np.ndarray) -> np.ndarray:
    """p (p,) of the programme's loop at decisions (v,)."""
    values = problem.values(v)
    return problem.vector({move.name: values[move.name] for move in problem.moves})


def _margin(problem: Problem, v: np.ndarray) -> tuple[float, float]:
    """Least singular value of I + L(jω), and where, Hz: the lowest minima of a grid, refined."""
    p, grid = _parameters(problem, v), SURVEY_HZ
    near = [mode.frequency for mode in modes(problem.case.rig) if 0 < mode.frequency < SURVEY_HZ[-1]]
    grid = np.union1d(grid, np.outer(near, np.linspace(0.95, 1.05, 21)))
    function = problem.loop.difference
    for _ in range(MARGIN_REFINEMENTS):
        omega, f = 2 * np.pi * grid, len(grid)
        parts = function.map(f)(np.zeros((1, f)), omega[None], np.tile(p[:, None], f))
        values = parts[0].full().T + 1j * parts[1].full().T
        k = round(values.shape[1] ** 0.5)
        sizes = np.linalg.svd(values.reshape(f, k, k), compute_uv=False)[:, -1]
        padded = np.concatenate([[np.inf], sizes, [np.inf]])
        minima = np.flatnonzero((sizes <= padded[:-2]) & (sizes <= padded[2:]))
        lowest = minima[np.argsort(sizes[minima])][:5]
        found = float(sizes[lowest[0]]), float(grid[lowest[0]])
        ends = [(grid[max(i - 1, 0)], grid[min(i + 1, f - 1)]) for i in lowest]
        grid = np.unique(np.concatenate([np.geomspace(*pair, 17) for pair in ends]))
    return found


# --- Starts of the local search.

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


# --- Settings drawn evenly over the bounds, where no start led anywhere: which of them are stable, as starts.

DRAWS = 512  # where one in a hundred is stable, some of so many are with 99.4 %
ENOUGH = 8  # stable ones, after which no more are drawn


@dataclass(frozen=True)
class BlindDraws:
    """How many settings were drawn, and the stable ones among them as starts (v,), largest modulus margin first."""

    drawn: int
    stable: tuple[np.ndarray, ...]


def blind_draws(problem: Problem, seed: int, draws: int = DRAWS) -> BlindDraws:
    """Draw settings by a Sobol sequence until enough are stable: by the poles of the sampled loop."""
    size, stable_starts = len(problem.moves), list[tuple[float, np.ndarray]]()
    eigenpairs = start(problem, None)[size:]
    points = scipy.stats.qmc.Sobol(size, seed=np.random.default_rng([seed, draws])).random_base2(
        (draws - 1).bit_length()
    )
    drawn = 0
    for point in points[:draws]:
        drawn += 1
        v = np.concatenate([point, eigenpairs])
        margin, _, stable = check(problem, v)
        stable_starts += [(margin, v)] if stable else []
        if len(stable_starts) == ENOUGH:
            break
    stable_starts.sort(key=lambda pair: -pair[0])
    return BlindDraws(drawn, tuple(v for _, v in stable_starts))


# --- The programme of a match as a task for the search, and what the search gives back.

AGREEMENT = 5e-3  # relative: starts that end so close count as one optimum


@dataclass(frozen=True)
class Solution:
    """Tuned values by name (SI), the objective there and that of every start (None: infeasible or unstable).

    ``holds`` is whether the modulus margin is kept between the frequencies of the grid, too, and ``added`` are those
    (Hz) at which it was asked for beside the grid. ``pairs`` are the goals' eigenpairs as the decision vector has them.
    ``blind`` is how many settings were drawn over the bounds where no start led to a stable loop, and how many of them
    are stable. ``as_good_to`` is the largest objective that counts as good as the best one.
    """

    values: dict[str, float]
    objective: float
    starts: tuple[float | None, ...]
    feasible: bool
    holds: bool = True
    added: tuple[float, ...] = ()
    pairs: tuple[float, ...] = ()
    blind: tuple[int, int] | None = None
    as_good_to: float = float("nan")


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
        return self.below is None or objective < self.below - AGREEMENT * abs(self.below)


class NoBetter(Exception):
    """Nothing below the objective that had to be beaten."""


@dataclass(frozen=True)
class TuningTask:
    """The programme to solve, as :func:`matching.match.programme.build` takes it; ``weights`` (moves,).

    With ``error_limit`` the change is minimised subject to it, else the error.
    """

    case: Case
    moves: tuple[Move, ...]
    weights: np.ndarray
    goals: tuple[Goal, ...]
    objective: Objective
    demands: Demands
    error_limit: float | None = None

    def build(self, tight: bool = False, exact: bool = False, slots: int = 0, compiled: bool = True) -> Problem:
        """The programme."""
        return build(
            self.case, self.moves, self.weights, self.goals, self.objective, self.demands,
            tight=tight, exact=exact, slots=slots, compiled=compiled,
            error_limit=self.error_limit,
        )  # fmt: skip


# --- Starts by continuation in dead time: begun at a shorter dead time and led to the case's own in steps.
#
# Where starts do not agree, as with feedback alone across a long dead time, good optima are reached that way that no
# start at the full dead time reaches.

RUNAWAY_FREQUENCY = 2.0  # times the frequency of a target mode
DEAD_TIME_STEPS = (
    np.geomspace(0.25, 1, 14),
    np.linspace(0.4, 1, 9),
)  # in parts of the dead time; the second where one fails
STEPS_LOST = 2  # steps in a row that end infeasible or unstable: it is not led this way any further


def continued_starts(task: TuningTask, seed: int, numbers: Sequence[int]) -> Iterator[End | None]:
    """Starts at a shorter dead time, led to the case's own; None if no way leads there."""
    loop = task.case.loop

    @cache  # every start passes there
    def at(part: float, tight: bool) -> Problem:
        shorter = replace(task.case, loop=loop.with_values({"dead_time": part * loop["dead_time"]}))
        return replace(task, case=shorter).build(tight=tight)

    for number in numbers:
        yield next((end for way in DEAD_TIME_STEPS if (end := _along(task, way, at, seed, number))), None)


def _along(
    task: TuningTask, way: np.ndarray, at: Callable[[float, bool], Problem], seed: int, number: int
) -> End | None:
    """One start on one way; None if the last step or two in a row end nowhere."""
    v, end, failed = None, None, 0
    for part in way:
        problem = at(part, v is not None)
        if v is None:
            problem = problem.oscillating()
            v = numbered_start(problem, seed, number)
        end = next((end for end in stable_ends(problem, [v, *gentler(problem, v)]) if follows_targets(task, end)), None)
        v, failed = (v, failed + 1) if end is None else (end.v, 0)
        if failed == STEPS_LOST:
            return None
    return end


def follows_targets(task: TuningTask, end: End) -> bool:
    """Whether the eigenvalues tracked are not roots far above the modes they were to follow."""
    pairs = eigenpairs(end.v, len(task.moves), task.case)
    return bool((np.hypot(pairs[:, 0], pairs[:, 1]) < RUNAWAY_FREQUENCY).all())


# --- The best ends solved again to more digits, with the margin held between the grid as well.

ENDS_FINISHED = 3  # ends that are tried for one that holds the margin between the grid as well
MARGIN_ROUNDS = 8  # of putting frequencies where the margin is missed between the grid
FREQUENCIES_AROUND = (
    0.015  # about such a frequency more are held, as it moves when it is held; a third of it the next time
)
SMALL_STEP = 0.02  # of each quantity's range, which no quantity leaves where the whole range leads to no stable loop


def first_that_holds(task: TuningTask, ends: list[End], starts: tuple[float | None, ...]) -> Solution:
    """The best end that can be made to hold the margin between the grid as well; the best of all if none can.

    Keeping the margin may raise the objective of an end above that of the next one: ends below it are tried as well.
    """
    candidates: list[Solution] = []
    last, least = -np.inf, np.inf
    for end in sorted(ends, key=lambda end: end.objective):
        if end.objective <= last + AGREEMENT * abs(last):  # the one before again
            continue
        last = end.objective
        if last >= least - AGREEMENT * abs(least) or len(candidates) == ENDS_FINISHED:
            break
        candidates.append(finish(task, end, starts))
        least = min((candidate.objective for candidate in candidates if candidate.holds), default=np.inf)
    holding = [candidate for candidate in candidates if candidate.holds]
    return min(holding, key=lambda candidate: candidate.objective) if holding else candidates[0]


def finish(task: TuningTask, best: End, starts: tuple[float | None, ...], added: tuple[float, ...] = ()) -> Solution:
    """Solve again to more digits, and ask for the margin where it is missed between the grid, until it holds.

    ``added`` are frequencies, Hz, at which it is asked for from the beginning.

    What IPOPT then does not call a minimum is solved once more with the exact Hessian.
    """
    problem, extra = task.build(tight=True, slots=SLOTS), np.array(added)
    least = task.case.limits["modulus_margin"]
    for number in range(MARGIN_ROUNDS):
        if best.margin < least:
            missed = np.append(problem.missed(best.v), best.margin_frequency)
            apart = FREQUENCIES_AROUND / 3**number
            extra = np.concatenate([extra, *(missed * part for part in (1 - apart, 1 + apart, 1.0))])
        end = next(_ends_from(problem, best.v, extra), None)
        if end is None:
            break
        best = end
        if best.margin >= least:
            break
    if not best.converged:
        exact = task.build(tight=True, exact=True, slots=SLOTS)
        end = next(stable_ends(exact, [best.v], extra), None)
        if end and end.objective < best.objective and end.margin >= least:
            best = end
    holds, pairs = best.margin >= least, best.v[len(problem.moves) :]
    values = problem.values(best.v)
    return Solution(values, best.objective, starts, True, holds, tuple(extra.tolist()), tuple(pairs.tolist()))


def _ends_from(problem: Problem, v: np.ndarray, extra: np.ndarray) -> Iterator[End]:
    """Stable ends from a start (v,): over the whole ranges, by a small step, and from gentler loops.

    Where the margin is missed by far between the grid, the search leaps to a loop that is unstable, from gentler ones
    to another optimum; a small step stays.
    """
    yield from stable_ends(problem, [v], extra)
    lower, upper, size = problem.lower.copy(), problem.upper.copy(), len(problem.moves)
    lower[:size] = np.maximum(lower[:size], v[:size] - SMALL_STEP)
    upper[:size] = np.minimum(upper[:size], v[:size] + SMALL_STEP)
    yield from stable_ends(replace(problem, lower=lower, upper=upper), [v], extra)
    yield from stable_ends(problem, gentler(problem, v), extra)


# --- The closed loop's roots nearest to the targets, as eigenpairs in a decision vector.
#
# The programme tracks one root for each target from wherever its start puts it. The error counts the distance to that
# root, so a setting is judged rightly only if it is the nearest of those that move the dynamometers like the target.

LEAST_COSINE = 0.3  # cosine between a root's pattern over the dynamometers and the target's, from which it counts


def with_nearest_roots(problem: Problem, v: np.ndarray) -> np.ndarray:
    """Decisions (v,) with every eigenpair on the root nearest to its target, to the dead time's approximation."""
    v = v.copy()
    if not problem.goals:
        return v
    bed = linear_bed(apply(problem.case, problem.values(v)))
    z = closed_poles(side_by_side([bed.bed]), feedback_on(bed))[0]
    roots = np.log(z[np.abs(z) > 1e-3].astype(complex)) / bed.case.loop["sample_time"]
    roots, p = roots[roots.imag >= 0], _parameters(problem, v)

    def difference(s: complex) -> np.ndarray:
        re, im = problem.loop.difference(s.real, s.imag, p)
        k = round(re.numel() ** 0.5)
        values: np.ndarray = (re.full() + 1j * im.full()).reshape(k, k)
        return values

    for row, goal in zip(eigenpairs(v, len(problem.moves), problem.case), problem.goals, strict=True):
        size, damping, *rest = goal.numbers
        pattern = np.array(rest)
        natural = np.abs(roots) / size
        distance = (natural - 1) ** 2 + (-roots.real / np.maximum(np.abs(roots), 1e-12) - damping) ** 2
        for i in np.argsort(distance):
            x = np.linalg.svd(difference(roots[i]))[2][-1].conj()
            if abs(pattern @ x) > LEAST_COSINE:
                x = x / (pattern @ x)
                row[:] = [roots[i].real / size, roots[i].imag / size, *x.real, *x.imag]
                break
    return np.asarray(np.clip(v, problem.lower, problem.upper))


# --- The point that a case is given with, as an end of the search: an answer is never worse than it.


def given_end(problem: Problem) -> End | None:
    """The case's own values, eigenpairs solved for; None where they miss a constraint or are unstable."""
    size = len(problem.moves)
    v = start(problem, None)
    v[:size] = [scaled(move.start, move) for move in problem.moves]
    v = with_nearest_roots(problem, v)
    lower, upper = problem.lower.copy(), problem.upper.copy()
    lower[:size] = upper[:size] = v[:size]
    return next(stable_ends(replace(problem, lower=lower, upper=upper), [v]), None)


def from_given(problem: Problem, point: End) -> End | None:
    """The local search from the case's own values."""
    return next(stable_ends(problem, [point.v]), None)


def never_worse(task: TuningTask, solution: Solution, point: End | None) -> Solution:
    """The solution, or the given point where that keeps the margin and is better, or the solution does not keep it."""
    if point is None or point.margin < task.case.limits["modulus_margin"]:
        return solution
    if solution.holds and solution.objective <= point.objective:
        return solution
    values = {name: move.start for move in task.moves for name in move.together}
    pairs = tuple(np.asarray(point.v)[len(task.moves) :].tolist())
    return Solution(values, point.objective, solution.starts, True, True, (), pairs)


# --- Of answers that are as good, the one that changes least.
#
# The error alone decides what is best. Of answers as good, the one nearest to what was planned is taken (ε-constraint
# programming: Haimes, Lasdon and Wismer, IEEE Trans. Syst. Man Cybern. 1 (1971) 296). So no weight trades error for
# change, and a second search, from the answer of a first, comes to the same values.

AS_GOOD = 0.02  # relative, in the response error: within it nothing is ordered that can stay as planned
SAME_ERROR = 0.002  # relative, in the response error: within it settings that cost nothing stay where they were
NEGLIGIBLE_ERROR = 1e-3  # response error below which no answer is better than another
REACHED = 1e-4  # relative, of the largest objective: what IPOPT's tolerance on a constraint leaves


def as_good_as(objective: float, within: float) -> float:
    """Largest objective whose response error, its root, is as good as that of the best within a relative tolerance."""
    return float((1 + within) ** 2 * objective + NEGLIGIBLE_ERROR**2)


def least_change(task: TuningTask, best: Solution, limit: float) -> Solution:
    """The solution of least weighted change from what was planned among those with an objective up to a limit."""
    if not best.feasible or not best.holds or not task.moves:
        return best
    nearest = replace(task, error_limit=limit)
    problem, v = nearest.build(slots=SLOTS), vector_of(task, best)
    begin = _end_at(problem, v, best.added)
    end = run_from(problem, v, np.array(best.added))
    if end is not None and end.objective < begin.objective:
        margin, frequency, stable = check(problem, end.v)
        begin = end._replace(margin=margin, margin_frequency=frequency) if stable else begin
    solution = finish(nearest, begin, best.starts, best.added)
    error = float(task.build(slots=SLOTS).objective(vector_of(task, solution), problem.extra())[0])
    if not solution.holds or error > limit * (1 + REACHED):
        return best
    return replace(solution, objective=error, as_good_to=best.as_good_to, blind=best.blind)


def vector_of(task: TuningTask, solution: Solution) -> np.ndarray:
    """Decisions (v,) of a solution."""
    return np.array([*(scaled(solution.values[move.name], move) for move in task.moves), *solution.pairs])


def _end_at(problem: Problem, v: np.ndarray, added: tuple[float, ...]) -> End:
    """The decisions (v,) themselves as an end."""
    change = float(problem.objective(v, problem.extra(added))[0])
    margin, frequency, _ = check(problem, v)
    return End(change, v, False, margin, frequency)


# --- Searches from about the best end: what several starts agree on may still be a poor optimum.
#
# Starts drawn over the whole range share what is typical of it, so that they may all end in one poor basin. Two ways
# lead
# out. The basins of a feedback law differ by one gain mostly (integral gain at its upper bound or small, acceleration
# feed-forward zero or about one), and by what goes with it (the residual vehicle's inertia): set to the other place
# alone, the gain comes back. So each of the loop's quantities is held at the ends and at the middle of its range while
# the rest is tuned for it, and released from there (profile of the objective over that quantity). Then all quantities
# are
# moved by steps of random size and direction (iterated local search: Lourenço, Martin and Stützle, in Handbook of
# Metaheuristics, 2003).

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


# --- Solve

AGREEING_STARTS = 3  # starts that agree on the best before the search ends
ONE_AGREES_OF = 3  # one in so many starts at least has to agree: where most fail, few that agree may do so on little
PLAIN_STARTS_FIRST = 5  # starts before those that are led
CONTINUED_STARTS = 4  # starts at a shorter dead time where the others do not agree
PROCESS_WORTH_SECONDS = 4.0  # s that a start takes


def solve(
    task: TuningTask, seed: int = 0, starts: int = 14, workers: int = 1, progress: Callable[[str], None] | None = None,
    near: Near | None = None,
) -> Solution:  # fmt: skip
    """Solve the programme of a case from many starts; the point it is given with counts and is kept unless beaten.

    The error alone decides; of answers as good within 0.2 % the one that changes least is taken.
    What starts agree on is left again by searches from about it, and given up for what is better. Where none is stable,
    settings drawn blindly over the bounds that are stable are starts as well.

    Parameters
    ----------
    task : TuningTask
    seed : int
        Of the random starts; the first is the case's own start with a gentle loop.
    starts : int
        At most; the search ends when three, and a third, agree on the best, of the first five or of those after them,
        which begin with four by continuation in dead time. What has lost a target mode counts for no agreement.
    workers : int
        Processes; the outcome does not depend on how many.
    near : Near, optional
        To start from these alone.
    """
    if near is not None:
        return _from(task, near)
    problem = task.build()
    point = given_end(problem)
    continued = 0
    if task.objective.tracks_modes and not task.case.loop.torqueless:
        continued = min(CONTINUED_STARTS, starts)
    ends: list[End | None] = []
    plain = _ends(task, seed, starts, workers)
    for end in chain(islice(plain, PLAIN_STARTS_FIRST), continued_starts(task, seed, range(1, continued + 1)), plain):
        ends.append(end)
        if progress:
            progress(f"start {len(ends)} of {starts + continued} at most")
        if _agree(task, ends, min(AGREEING_STARTS, starts), point):
            break
    plain.close()  # ends the processes at work on starts that are no longer needed
    objectives = tuple(None if end is None else end.objective for end in ends)
    kept = [end for end in ends if end]
    if point and (end := from_given(problem, point)):
        kept.append(end)
    if kept and not task.case.loop.torqueless:
        kept.append(improved(task, problem, min(kept, key=lambda end: end.objective), seed))
    blind = blind_draws(problem, seed) if not kept and not task.case.loop.torqueless else None
    if blind:
        kept = list(stable_ends(problem, blind.stable))
    if not kept:
        anywhere = blind.stable[0] if blind and blind.stable else start(problem, None)
        counted = (blind.drawn, len(blind.stable)) if blind else None
        nothing = Solution(problem.values(anywhere), float("nan"), objectives, False, False, blind=counted)
        return never_worse(task, nothing, point)
    best = never_worse(task, first_that_holds(task, kept, objectives), point)
    return _settled(task, _searched_again(task, problem, best, kept), point)


def _searched_again(task: TuningTask, problem: Problem, best: Solution, tried: Sequence[End]) -> Solution:
    """The best, or what a search from its values with eigenpairs on their targets leads to, as matching again would.

    An end that led to the best, or to nothing better, is not finished a second time.
    """
    if not best.holds or task.case.loop.torqueless:
        return best
    end = next(stable_ends(problem, [start_at(problem, best.values)]), None)
    if end is None or end.objective >= best.objective or not follows_targets(task, end):
        return best
    if any(abs(end.objective - other.objective) <= AGREEMENT * abs(other.objective) for other in tried):
        return best
    again = finish(task, end, best.starts)
    return again if again.holds and again.objective < best.objective else best


def _settled(task: TuningTask, best: Solution, point: End | None = None) -> Solution:
    """Of answers as good as the best to 0.2 %, and no worse than the given point, the one that changes least."""
    limit = as_good_as(best.objective, SAME_ERROR)
    if point is not None and point.margin >= task.case.limits["modulus_margin"]:
        limit = min(limit, max(point.objective, best.objective))
    settled = never_worse(task, least_change(task, best, limit), point)
    return replace(settled, as_good_to=as_good_as(best.objective, AS_GOOD))


def _agree(task: TuningTask, ends: list[End | None], enough: int, point: End | None) -> bool:
    """Whether enough ends agree on the best of them, and that is no worse than the given point."""
    best = min((end for end in ends if end), key=lambda end: end.objective, default=None)
    if best is None or not follows_targets(task, best):
        return False
    if point is not None and best.objective > point.objective * (1 + AGREEMENT):
        return False
    agreeing = sum(end.objective <= best.objective * (1 + AGREEMENT) for end in ends if end)
    # plain starts that fail say little about those by continuation, which come after them
    tried = len(ends) - (PLAIN_STARTS_FIRST if len(ends) > PLAIN_STARTS_FIRST else 0)
    return agreeing >= max(enough, tried / ONE_AGREES_OF)


def _ends(task: TuningTask, seed: int, starts: int, workers: int) -> Generator[End | None]:
    """The ends of the starts, in order; in other processes only where one takes longer than they take to begin."""
    problem, began = task.build(), time.monotonic()
    yield _one(problem, seed, 0)
    if workers < 2 or time.monotonic() - began < PROCESS_WORTH_SECONDS:
        for number in range(1, starts):
            yield _one(problem, seed, number)
        return
    with executor_of(workers) as executor:
        seeds = [(seed, number) for number in range(1, starts)]
        coming = finished(_one_prepared, _built, task, seeds, executor, content="match")
        ended: dict[int, End | None] = {}
        for place in range(len(seeds)):
            while place not in ended:
                ended |= [next(coming)]
            yield ended.pop(place)


def _built(task: TuningTask) -> Problem:
    """The programme, once a process."""
    return task.build()


def _one_prepared(problem: Problem, numbered: tuple[int, int]) -> End | None:
    return _one(problem, *numbered)


def _one(problem: Problem, seed: int, number: int) -> End | None:
    """One start, or None if it ends infeasible or unstable."""
    return next(stable_ends(problem.oscillating(), [numbered_start(problem, seed, number)]), None)


def _from(task: TuningTask, near: Near) -> Solution:
    """The best end from the solutions of like cases, with their eigenpairs and with those on their targets."""
    problem = task.build()
    begins = [start_at(problem, values, start_pairs) for values, pairs in near.solutions for start_pairs in (pairs, ())]
    ends = list(stable_ends(problem, begins))
    if not any(near.beaten_by(as_good_as(end.objective, SAME_ERROR)) for end in ends):
        raise NoBetter
    solution = _settled(task, first_that_holds(task, ends, tuple(end.objective for end in ends)))
    if not near.beaten_by(solution.objective):
        raise NoBetter
    return solution


def warm(task: TuningTask, near: Solution) -> Solution | None:
    """Solve a programme from the solution of a neighbouring one and from gentler loops; None if all are unstable."""
    problem = task.build()
    known = {move.name: near.values.get(move.name, move.start) for move in task.moves}
    begin = start_at(problem, known)
    good = list(stable_ends(problem, [start_at(problem, known, near.pairs), begin, *gentler(problem, begin)]))
    return finish(task, min(good, key=lambda end: end.objective), ()) if good else None
