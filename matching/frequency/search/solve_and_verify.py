"""Solving a case and verifying it; again where a limit needs a released quantity, or the simulation takes more."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from matching.frequency.case.case import Case, Move
from matching.frequency.case.demands import ExceededLimit
from matching.frequency.case.targets import goals
from matching.frequency.case.tuned import apply
from matching.frequency.case.weights import change_weight, released_moves
from matching.frequency.programme.objectives import REGISTERED
from matching.frequency.search.active_limits import needed_for_more, needed_to_keep
from matching.frequency.search.infeasible_limits import unkept
from matching.frequency.search.question import Question, SearchEffort
from matching.frequency.solver.solve import solve
from matching.frequency.solver.task import Solution, TuningTask
from matching.frequency.verification.verify import Verification, verify

LIMIT_RESERVE = 1.01  # on a limit that the simulation overran, when it is solved again


@dataclass(frozen=True)
class VerifiedSolution:
    """A solution with what it solves, and its verification.

    ``beyond`` are limits that no setting keeps, ``released`` the quantities that move for a limit's sake, with it.
    """

    task: TuningTask
    solution: Solution
    beyond: list[ExceededLimit]
    released: Mapping[str, str]
    tuned: Case
    checked: Verification


def solve_and_verify(question: Question, effort: SearchEffort) -> VerifiedSolution:
    """Solve and verify; a second time, with the limits drawn in, where the simulated manoeuvre overruns some.

    The programme takes the vehicle's torques for the rig's, and an optimum likes to lie on a limit: the rig, which
    answers a little otherwise, may then overrun it by as little.
    """
    first, asked = _verified(question, effort), question.demands
    effort.tell("verification")
    over = {
        violation.limit: violation.value / violation.allowed
        for violation in first.checked.violations
        if asked.quantities(violation.limit)
    }
    if first.beyond or not first.checked.stable or not over or len(over) < len(first.checked.violations):
        return first
    drawn_in = {name: asked.limits[name] / (LIMIT_RESERVE * excess) for name, excess in over.items()}
    second = _verified(replace(question, demands=replace(asked, limits={**asked.limits, **drawn_in})), effort)
    effort.tell("verification with limits drawn in")
    return first if second.beyond or second.checked.violations or not second.checked.stable else second


def _verified(question: Question, effort: SearchEffort) -> VerifiedSolution:
    """Solved again where a limit that shapes the solution depends on a fixed quantity; then verified."""
    case, asked = question.case, question.demands
    moving = released_moves(case, question.shares)
    released = needed_to_keep(case, moving, asked)
    while True:
        moves = [move for move in case.moves if move in moving or move.name in released]
        task, beyond = task_of(question, moves), unkept(case, moves, asked)
        if beyond:  # no setting keeps them: the best that keeps the rest is worth more than none
            task = replace(task, demands=replace(asked, limits={}))
        solution = Solution({}, 0.0, (), True)
        if moves:
            solution = solve(task, effort.seed, effort.starts, effort.workers, effort.tell, effort.near)
        tuned = apply(case, solution.values)
        more = needed_for_more(case, moves, asked, tuned) if not beyond and solution.feasible else {}
        if not more:
            return VerifiedSolution(task, solution, beyond, released, tuned, verify(tuned, case.rig))
        released |= more


def task_of(question: Question, moves: Sequence[Move]) -> TuningTask:
    """The programme of a question in which ``moves`` move."""
    case = question.case
    weights = [change_weight(part) for move, part in zip(case.moves, question.shares, strict=True) if move in moves]
    objective = REGISTERED[case.objective].of(case)
    tracked = goals(case, question.targets) if objective.tracks_modes else ()
    return TuningTask(case, tuple(moves), np.array(weights), tracked, objective, question.demands)
