"""The search: many starts, the best solved again tightly.

Starts are not trusted that agree on a place where the loop has no root near a target mode any more.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Sequence
from dataclasses import replace
from itertools import chain, islice

from matching.executors import executor_of
from matching.frequency.programme.problem import Problem
from matching.frequency.solver.blind import blind_draws
from matching.frequency.solver.continuation import continued_starts, follows_targets
from matching.frequency.solver.ends import End, stable_ends
from matching.frequency.solver.finish import finish, first_that_holds
from matching.frequency.solver.given_point import from_given, given_end, never_worse
from matching.frequency.solver.least_change import AS_GOOD, SAME_ERROR, as_good_as, least_change
from matching.frequency.solver.perturbed import improved
from matching.frequency.solver.starts import gentler, numbered_start, start, start_at
from matching.frequency.solver.task import AGREEMENT, Near, NoBetter, Solution, TuningTask
from matching.studies import finished

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

    Raises
    ------
    NoBetter
        If those lead to nothing better.
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
