"""Solving a case and verifying it; again where a limit needs a released quantity, or the simulation takes more."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from matching.frequency.case.case import Case, Move
from matching.frequency.case.demands import Demands
from matching.frequency.case.targets import goals
from matching.frequency.case.tuned import apply
from matching.frequency.case.weights import change_weight, released_moves
from matching.frequency.programme.objectives import REGISTERED
from matching.frequency.search.active_limits import needed_for_more, needed_to_keep
from matching.frequency.search.infeasible_limits import Unkept, unkept
from matching.frequency.solver.solve import solve
from matching.frequency.solver.task import Near, Solution, Task
from matching.frequency.verification.verify import Verification, verify
from modelling.modal.modes import Mode

LIMIT_RESERVE = 1.01  # on a limit that the simulation overran, when it is solved again

Progress = Callable[[str], None]


@dataclass(frozen=True)
class VerifiedSolution:
    """A solution with what it solves, and its verification.

    ``beyond`` are limits that no setting keeps, ``released`` the quantities that move for a limit's sake, with it.
    """

    task: Task
    solution: Solution
    beyond: list[Unkept]
    released: Mapping[str, str]
    tuned: Case
    checked: Verification


def solve_and_verify(
    case: Case, shares: np.ndarray, targets: list[tuple[Mode, Mode]], asked: Demands,
    seed: int, starts: int, workers: int, tell: Progress, near: Near | None = None,
) -> VerifiedSolution:  # fmt: skip
    """Solve and verify; a second time, with the limits drawn in, where the simulated manoeuvre overruns some.

    The programme takes the vehicle's torques for the rig's, and an optimum likes to lie on a limit: the rig, which
    answers a little otherwise, may then overrun it by as little.
    """

    def once(asked: Demands) -> VerifiedSolution:
        return _verified(case, _solved(case, shares, targets, asked, seed, starts, workers, tell, near))

    first = once(asked)
    tell("verification")
    over = {own.limit: own.value / own.allowed for own in first.checked.violations if asked.quantities(own.limit)}
    if first.beyond or not first.checked.stable or not over or len(over) < len(first.checked.violations):
        return first
    drawn_in = {name: asked.limits[name] / (LIMIT_RESERVE * excess) for name, excess in over.items()}
    second = once(replace(asked, limits={**asked.limits, **drawn_in}))
    tell("verification with limits drawn in")
    return first if second.beyond or second.checked.violations or not second.checked.stable else second


def _verified(case: Case, found: tuple[Task, Solution, list[Unkept], dict[str, str]]) -> VerifiedSolution:
    tuned = apply(case, found[1].values)
    return VerifiedSolution(*found, tuned, verify(tuned, case.rig))


def _solved(
    case: Case, shares: np.ndarray, targets: list[tuple[Mode, Mode]], asked: Demands,
    seed: int, starts: int, workers: int, tell: Progress, near: Near | None = None,
) -> tuple[Task, Solution, list[Unkept], dict[str, str]]:  # fmt: skip
    """Solved again where a limit that shapes the solution depends on a fixed quantity."""
    moving = released_moves(case, shares)
    released = needed_to_keep(case, moving, asked)
    while True:
        moves = [move for move in case.moves if move in moving or move.name in released]
        task, beyond = task_of(case, shares, moves, targets, asked), unkept(case, moves, asked)
        if beyond:  # no setting keeps them: the best that keeps the rest is worth more than none
            task = replace(task, demands=replace(asked, limits={}))
        solution = solve(task, seed, starts, workers, tell, near) if moves else Solution({}, 0.0, (), True)
        more = {}
        if not beyond and solution.feasible:
            more = needed_for_more(case, moves, asked, apply(case, solution.values))
        if not more:
            return task, solution, beyond, released
        released |= more


def task_of(
    case: Case, shares: np.ndarray, moves: Sequence[Move], targets: list[tuple[Mode, Mode]], asked: Demands
) -> Task:
    """The programme of a case in which ``moves`` move; ``shares`` are of all of the case's."""
    weights = np.array([change_weight(part) for move, part in zip(case.moves, shares, strict=True) if move in moves])
    objective = REGISTERED[case.objective].of(case)
    tracked = goals(case, targets) if objective.tracks_modes else ()
    return Task(case, tuple(moves), weights, tracked, objective, asked)
