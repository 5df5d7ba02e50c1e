"""What to order: which adapter quantities gain over the bed as planned, and how exactly they have to be met.

A quantity is ordered only if no answer that is as good within 2 % has it as planned, with everything else tuned for
that. Quantities are put back one after another, first the one that costs least (backward elimination), since two may
replace each other. What is left has used up the 2 %; where it then gains less than 2 % over what can still be put back,
that goes back as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from matching.frequency.case.case import Move
from matching.frequency.case.tuned import apply
from matching.frequency.programme.scaling import scaled, unscaled
from matching.frequency.response.band import BandNodes
from matching.frequency.search.question import Question
from matching.frequency.search.result import AdapterTrade
from matching.frequency.search.solve_and_verify import VerifiedSolution, task_of
from matching.frequency.search.targets_met import target_results
from matching.frequency.solver.adapter_trade import Retuning, feedback_error, some_as_planned
from matching.frequency.solver.given_point import given_end, never_worse
from matching.frequency.solver.least_change import AS_GOOD, SAME_ERROR, as_good_as, least_change
from matching.frequency.solver.solve import warm
from matching.frequency.solver.task import Solution, TuningTask
from matching.frequency.verification.verify import verify

ADAPTERS = "rig."  # the names they begin with
SAME_OBJECTIVE = 1e-3  # relative: what reruns differ by


def settle_adapters(
    question: Question, verified: VerifiedSolution
) -> tuple[VerifiedSolution, tuple[AdapterTrade, ...]]:
    """The match with nothing ordered that gains nothing, and the trade of every adapter quantity that may move.

    Where targets or limits are missed there is nothing to order yet, and no trade.
    """
    adapters = [move for move in verified.task.moves if move.name.startswith(ADAPTERS)]
    solution = verified.solution
    if not adapters or verified.beyond or not solution.feasible or not solution.holds or not _met(question, verified):
        return verified, ()
    everything = _as_planned(question, verified, adapters)
    settled = _settled(question, verified, adapters, everything)
    nodes = settled.checked.errors.nodes
    planned = None if everything is None else feedback_error(apply(question.case, everything.values), nodes)
    return settled, _of_one_bed(tuple(_trade(settled, move, adapters, planned, nodes) for move in adapters))


def _of_one_bed(trades: tuple[AdapterTrade, ...]) -> tuple[AdapterTrade, ...]:
    """The bed as planned with one error: of two searches for it, where one quantity is ordered, the better counts."""
    ordered = [trade for trade in trades if trade.ordered != trade.planned]
    if len(ordered) != 1 or ordered[0].error_as_planned is None or ordered[0].error_all_as_planned is None:
        return trades
    least = min(ordered[0].error_as_planned, ordered[0].error_all_as_planned)
    both = replace(ordered[0], error_as_planned=least)
    return tuple(replace(both if trade is ordered[0] else trade, error_all_as_planned=least) for trade in trades)


def _met(question: Question, verified: VerifiedSolution) -> bool:
    checked = verified.checked
    return checked.stable and not checked.violations and all(row.met for row in target_results(question, checked))


def _settled(
    question: Question, verified: VerifiedSolution, adapters: Sequence[Move], everything: Solution | None
) -> VerifiedSolution:
    """The match with as many adapters as planned as answers allow that are as good: as the best, then as the order."""
    limit = verified.solution.as_good_to
    back, best = _put_back(question, verified, adapters, everything, [], limit)
    settled = _with_some_as_planned(question, verified, back, best or verified.solution)
    ordered, limit = len(adapters) - len(back), as_good_as(settled.solution.objective, AS_GOOD)
    if not ordered or settled is verified:
        return settled
    more, best = _put_back(question, verified, adapters, everything, back, limit)
    if best is None:
        return settled
    solution = replace(verified.solution, as_good_to=max(verified.solution.as_good_to, best.objective))
    fewer = _with_some_as_planned(question, replace(verified, solution=solution), more, best)
    return settled if fewer.solution is solution else fewer


def _put_back(
    question: Question, verified: VerifiedSolution, adapters: Sequence[Move], everything: Solution | None,
    back: list[Move], limit: float,
) -> tuple[list[Move], Solution | None]:  # fmt: skip
    """Adapters as planned, beside those that are, up to a limit of the objective, and the answer; None if no more."""
    back, best = list(back), None
    if everything is not None and everything.objective <= limit:
        return list(adapters), everything
    while len(back) < len(adapters) - 1:  # all together were tried at first
        tried = []
        for move in adapters:
            if move not in back:
                solution = _as_planned(question, verified, [*back, move])
                if solution is not None and solution.objective <= limit:
                    tried.append((solution.objective, move, solution))
        if not tried:
            break
        _, move, best = min(tried, key=lambda trial: trial[0])
        back.append(move)
    return back, best


def _with_some_as_planned(
    question: Question, verified: VerifiedSolution, back: list[Move], best: Solution
) -> VerifiedSolution:
    """The match with some adapters as planned, the others changed least and all else tuned for them.

    As it was where that does not pass the verification; as it was given where that is better.
    """
    values = _with_least_order(question, verified, back, best)
    point = given_end(verified.task.build())
    if values is None:
        return verified
    solution = replace(values, starts=verified.solution.starts, as_good_to=verified.solution.as_good_to)
    if point is not None and point.objective < (1 - SAME_OBJECTIVE) * solution.objective:
        solution = never_worse(verified.task, solution, point)
    tuned = apply(question.case, solution.values)
    settled = replace(verified, solution=solution, tuned=tuned, checked=verify(tuned, question.case.rig))
    return settled if _met(question, settled) else verified


def _with_least_order(
    question: Question, verified: VerifiedSolution, back: list[Move], best: Solution
) -> Solution | None:
    task = _task_as_planned(question, verified, back)
    adapters = [move for move in verified.task.moves if move.name.startswith(ADAPTERS)]
    weights = np.array([weight * (move in adapters) for move, weight in zip(task.moves, task.weights, strict=True)])
    if weights.any():
        best = least_change(replace(task, weights=weights), best, verified.solution.as_good_to)
    held = {name: move.planned for move in back for name in move.together}
    held |= {name: best.values[name] for move in adapters if move not in back for name in move.together}
    rest = task_of(question, [move for move in verified.task.moves if move not in adapters])
    if not rest.moves:
        return replace(best, values=held | best.values)
    rest = replace(rest, case=apply(question.case, held))
    tuned = warm(rest, best)
    if tuned is None or not tuned.holds:
        return None
    tuned = least_change(rest, tuned, as_good_as(tuned.objective, SAME_ERROR))
    return replace(tuned, values=held | tuned.values)


def _task_as_planned(question: Question, verified: VerifiedSolution, back: Sequence[Move]) -> TuningTask:
    """The programme in which some adapters are as planned and do not move."""
    values = {name: move.planned for move in back for name in move.together}
    left = [move for move in verified.task.moves if move not in back]
    return replace(task_of(question, left), case=apply(question.case, values))


def _as_planned(question: Question, verified: VerifiedSolution, back: Sequence[Move]) -> Solution | None:
    """The best answer with some adapters as planned; None where no loop keeps its limits.

    Searched for in the programme without them, and from the answer with them held: one alone may end in a worse place.
    """
    task = _task_as_planned(question, verified, back)
    answers = [some_as_planned(verified.task, verified.solution, back)]
    if task.moves:
        answers.append(warm(task, verified.solution))
    held = [answer for answer in answers if answer is not None and answer.holds]
    if not held:
        return None
    planned = {name: move.planned for move in back for name in move.together}
    best = min(held, key=lambda answer: answer.objective)
    return replace(best, values=planned | best.values)


def _trade(
    settled: VerifiedSolution, move: Move, adapters: Sequence[Move], planned: float | None, nodes: BandNodes
) -> AdapterTrade:
    """What an adapter quantity gains, the others ordered or as planned as they are, everything else tuned for it."""
    task, values = settled.task, settled.solution.values
    number = task.moves.index(move)
    others = [other for other in adapters if other is not move and values[other.name] == other.planned]
    held = {task.moves.index(other): scaled(other.planned, other) for other in others}
    retuning = Retuning(task, settled.solution, number, held)
    as_planned = scaled(move.planned, move)
    retuning.survey(*([as_planned] if 0 <= as_planned <= 1 else []))
    retuning.follow_neighbours()
    low, high = retuning.as_good_between()
    curve = retuning.curve(nodes)
    error = next((error for value, error in curve if abs(value - move.planned) <= 1e-9 * abs(move.planned)), None)
    ends = [float(unscaled(place, move)) for place in (low, high)]
    return AdapterTrade(
        name=move.name, unit=move.unit, planned=move.planned, ordered=values[move.name], acceptable=(ends[0], ends[1]),
        error_as_planned=error, error_all_as_planned=planned, error_as_ordered=settled.checked.errors.unmeasured,
        curve=tuple(curve),
    )  # fmt: skip
