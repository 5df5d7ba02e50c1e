"""What would do: relaxations that were solved and verified. What is not found here is not named to anybody."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from matching.frequency.case.case import Case, Move
from matching.frequency.case.tuned import apply
from matching.frequency.search.infeasible_limits import DeadTimeTrial, shorter_dead_times, wider_bounds
from matching.frequency.search.question import Question
from matching.frequency.search.result import TargetResult
from matching.frequency.search.solve_and_verify import VerifiedSolution, task_of
from matching.frequency.search.targets_met import target_results
from matching.frequency.solver.solve import warm
from matching.frequency.verification.verify import verify
from modelling.bed.structures.model_based import ModelBased

LIMIT_RESERVE = 1.02  # on the least demand of a limit: the simulated manoeuvre takes a little more than the vehicle's


@dataclass(frozen=True)
class Relaxations:
    """Relaxations with which the case was solved again.

    Attributes
    ----------
    dead_time : DeadTimeTrial or None
        None where no shorter one was tried.
    limits : dict of str to float
        Values, SI, of the limits that no setting keeps, with all of which together every target is met.
    structure : str
        Control structure with which the values as tuned meet every target, all torques on the rig measured.
    bounds : tuple of (Move, float)
        Quantities at a bound, each with the value (SI) beyond it with all of which together every target is met.
    """

    dead_time: DeadTimeTrial | None = None
    limits: Mapping[str, float] = field(default_factory=dict)
    structure: str = ""
    bounds: tuple[tuple[Move, float], ...] = ()


def relaxations(question: Question, solution: VerifiedSolution, targets: Sequence[TargetResult]) -> Relaxations:
    """Try what may help: larger limits where no setting keeps them, wider bounds, less dead time, measured torques."""
    case, missed = question.case, any(not target.met for target in targets)
    by_feedback = not case.loop.structure.has_feed_forward and not case.loop.torqueless and solution.solution.feasible
    if not missed or not by_feedback:
        return Relaxations(limits=_larger_limits(question, solution))
    trial = shorter_dead_times(solution.task, solution.solution, question.targets)
    if trial is not None and trial.sufficient is not None and not _with_dead_time(question, solution, trial.sufficient):
        trial = DeadTimeTrial(trial.shortest, None)
    bounds = wider_bounds(
        solution.task, solution.solution, lambda wider: _meets_all(question, apply(case, wider.values))
    )
    return Relaxations(trial, _larger_limits(question, solution), _with_feed_forward(question, solution), bounds)


def _meets_all(question: Question, tuned: Case) -> bool:
    checked = verify(tuned, question.case.rig, deviations=False)
    return (
        checked.stable and not checked.violations
        and all(target.met for target in target_results(question, checked))
    )  # fmt: skip


def _larger_limits(question: Question, solution: VerifiedSolution) -> dict[str, float]:
    """Limits that no setting keeps, as large as their least demand; none where the targets are missed even so."""
    least: dict[str, float] = {}
    for exceeded in solution.beyond:
        least[exceeded.limit] = max(LIMIT_RESERVE * exceeded.demand, least.get(exceeded.limit, 0.0))
    if not least:
        return {}
    case = replace(question.case, limits={**question.case.limits, **least})
    demands = replace(question.demands, limits={**question.demands.limits, **least})
    solved = warm(task_of(replace(question, case=case, demands=demands), solution.task.moves), solution.solution)
    return least if solved is not None and _meets_all(question, apply(case, solved.values)) else {}


def _with_dead_time(question: Question, solution: VerifiedSolution, dead_time: float) -> bool:
    case = replace(question.case, loop=question.case.loop.with_values({"dead_time": dead_time}))
    solved = warm(replace(solution.task, case=case), solution.solution)
    return solved is not None and _meets_all(question, apply(case, solved.values))


def _with_feed_forward(question: Question, solution: VerifiedSolution) -> str:
    """The structure with a feed-forward, if the same values meet the targets with it; its feedback has to take them."""
    if not ModelBased.quantities.keys() <= solution.tuned.loop.values.keys():
        return ""
    driven = {dynamometer.torque_input for dynamometer in question.case.loop.dynamometers}
    measured = tuple(part.name for part in question.case.rig.inputs if part.name not in driven)
    loop = replace(solution.tuned.loop, structure=ModelBased(), measured=measured)
    return ModelBased.name if _meets_all(question, replace(solution.tuned, loop=loop)) else ""
