"""What to order: what adapters gain over the bed as planned, and how exactly they have to be what was ordered.

The bed as planned, loop and residual vehicle tuned for it, is solved like any other. Where it is as good, nothing is
ordered.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from matching.frequency.case.case import Case, Move
from matching.frequency.case.tuned import apply
from matching.frequency.loop.encirclements import encirclements
from matching.frequency.loop.parts import parts_of
from matching.frequency.programme.scaling import scaled, unscaled
from matching.frequency.response.band import BandNodes
from matching.frequency.response.response_error import log_squares, pooled
from matching.frequency.response.responses import ComparedBed
from matching.frequency.search.question import Question
from matching.frequency.search.result import AdapterTrade
from matching.frequency.search.solve_and_verify import VerifiedSolution, task_of
from matching.frequency.search.targets_met import target_results
from matching.frequency.solver.solve import warm
from matching.frequency.verification.verify import verify

AS_GOOD = 0.02  # relative, in the response error and in the modulus margin
HALVINGS = 3  # of the way to a bound, in looking for the end of what is as good: to an eighth of it
TRADE_POINTS = 5  # between the bounds, beside those where the end of what is as good was looked for
ADAPTERS = "rig."  # the names they begin with


def settle_adapters(
    question: Question, verified: VerifiedSolution
) -> tuple[VerifiedSolution, tuple[AdapterTrade, ...]]:
    """The match with nothing ordered that gains nothing, and the trade of every adapter that was allowed to move.

    Where targets or limits are missed there is nothing to order yet, and no trade.
    """
    moves = [move for move in verified.task.moves if move.name.startswith(ADAPTERS)]
    checked = verified.checked
    matched = (
        checked.stable and not checked.violations and all(target.met for target in target_results(question, checked))
    )
    if not moves or verified.beyond or not verified.solution.feasible or not matched:
        return verified, ()
    nodes, error = checked.errors.nodes, checked.errors.unmeasured
    planned, error_planned = _as_planned(question, verified), None
    if planned is not None:
        error_planned = feedback_error(planned.tuned, nodes)
        if error_planned <= (1 + AS_GOOD) * error:
            checked = verify(planned.tuned, question.case.rig)
            met = all(target.met for target in target_results(question, checked))
            if met and checked.stable and not checked.violations:
                verified, error = replace(planned, task=verified.task, checked=checked), checked.errors.unmeasured
    return verified, tuple(_trade(question.case, verified, move, error_planned, error) for move in moves)


def feedback_error(tuned: Case, nodes: BandNodes) -> float:
    """Response error of the feedback alone, over the band."""
    bed = ComparedBed(tuned).at(nodes.frequencies)
    return pooled(nodes.root_mean(log_squares(bed.unmeasured, bed.vehicle)))


def _as_planned(question: Question, verified: VerifiedSolution) -> VerifiedSolution | None:
    """The match with every adapter as planned; None where no loop keeps its limits."""
    moves = [move for move in verified.task.moves if not move.name.startswith(ADAPTERS)]
    if not moves:
        return None
    task = task_of(question, moves)
    solution = warm(task, verified.solution)
    if solution is None or not solution.holds:
        return None
    solution = replace(solution, starts=verified.solution.starts)
    released = {name: limit for name, limit in verified.released.items() if not name.startswith(ADAPTERS)}
    return VerifiedSolution(task, solution, [], released, apply(question.case, solution.values), verified.checked)


def _trade(
    case: Case, verified: VerifiedSolution, move: Move, error_planned: float | None, error: float
) -> AdapterTrade:  # fmt: skip
    nodes, tried = verified.checked.errors.nodes, dict[float, float]()
    ordered = verified.solution.values.get(move.name, move.start)

    def as_good(part: float) -> bool:
        value = float(unscaled(part, move))
        tuned = apply(verified.tuned, dict.fromkeys(move.together, value))
        winding = encirclements(parts_of(tuned))
        if winding.unstable or not winding.clear:
            return False
        tried[value] = feedback_error(tuned, nodes)
        kept = winding.modulus_margin >= (1 - AS_GOOD) * case.limits["modulus_margin"]
        return kept and tried[value] <= (1 + AS_GOOD) * error

    ends = [float(unscaled(part, move)) for part in as_good_between(as_good, scaled(ordered, move))]
    for part in np.linspace(0, 1, TRADE_POINTS):
        as_good(part)
    tried[ordered] = error
    return AdapterTrade(
        move.name, move.unit, move.planned, ordered, (ends[0], ends[1]), error_planned, error,
        tuple(sorted(tried.items())),
    )  # fmt: skip


def as_good_between(as_good: Callable[[float], bool], at: float) -> tuple[float, float]:
    """Ends of the range about ``at``, in parts 0 … 1, within which values are as good; each end is one that is."""
    ends = []
    for bound in (0.0, 1.0):
        good, bad = at, bound
        if at != bound and as_good(bound):
            good = bound
        for _ in range(HALVINGS if good != bound else 0):
            middle = (good + bad) / 2
            good, bad = (middle, bad) if as_good(middle) else (good, middle)
        ends.append(float(np.clip(good, 0, 1)))
    return ends[0], ends[1]
