"""A match with an observer: its weights tuned over drawn beds, verified on fresh ones."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from matching.aside import Aside
from matching.frequency.beds.tuner import tuner
from matching.frequency.case.case import Case
from matching.frequency.case.tuned import apply
from matching.frequency.in_time.table import truth_of
from matching.frequency.loop.parts import parts_of
from matching.frequency.programme.objectives import REGISTERED
from matching.frequency.response.observed import ObservedBed
from matching.frequency.search.errors import curves_of, emulating_the_whole, errors_with_bounds, lower_bound
from matching.frequency.search.limits import led_by_dead_time, limits
from matching.frequency.search.linearisation import opened_lashes, standstill, unloaded_lashes
from matching.frequency.search.question import Progress, Question, differing_components
from matching.frequency.search.relaxations import Relaxations
from matching.frequency.search.result import MatchResult, ParameterResult
from matching.frequency.search.solve_and_verify import VerifiedSolution
from matching.frequency.search.targets_met import target_results
from matching.frequency.solver.task import Solution, TuningTask
from matching.frequency.tuning.rounds import TuningEffort
from matching.frequency.tuning.tune import tuned_weights
from matching.frequency.verification.observed import controller_of, verify_observer
from matching.frequency.verification.robust_limits import not_kept, noted
from matching.frequency.verification.verify import Verification
from modelling.modal.damped_modes import damped_modes

SHORT_EFFORT = TuningEffort(drawn=8, pool=16, rounds=1, steps=5, most_steps=20, scenarios=0, blind=0, fresh=40)
AS_CUT = "the residual vehicle stays as it is cut from the vehicle: the observer needs no other"


def match_with_observer(
    question: Question, seed: int, tell: Progress, effort: TuningEffort | None, aside: Aside | None = None
) -> MatchResult:
    """Tune the weights of an observer over drawn beds and judge the result on fresh ones.

    Raises
    ------
    InputError
        If the case cannot be worked on as it stands.
    """
    begin, case = time.perf_counter(), question.case
    effort, short = _effort(case, effort)
    search = tuner(case, effort.drawn, effort.pool)
    tell("drawn beds")
    weights, cost = tuned_weights(search, effort)
    tell("weights")
    tuned = apply(case, {f"loop.{name}": value for name, value in weights.items()})
    in_time = None if aside is None else aside.begin(truth_of, tuned)
    robust = verify_observer(tuned, case.rig, seed=seed, beds=effort.fresh)
    checked = robust.verification
    tell("verification on fresh beds")
    results = target_results(question, checked)
    error = errors_with_bounds(tuned, checked.errors)
    stands = limits(question, _found(question, cost, tuned, checked), results, Relaxations())
    stands = led_by_dead_time([*stands, *not_kept(case, robust), *unloaded_lashes(case)], case, error)
    tell("bound and curves")
    moved = any(move.name.startswith("residual_vehicle.") for move in case.moves)
    return MatchResult(
        status="limited" if stands else "matched",
        limits=tuple(stands),
        notes=(
            *differing_components(case),
            *case.notes,
            *standstill(case),
            *short,
            *opened_lashes(tuned, checked.traces),
            *([AS_CUT] if moved else []),
            *noted(case, robust),
            *checked.notes,
        ),
        case=case,
        tuned=tuned,
        vehicle_modes=tuple(damped_modes(case.vehicle)),
        rig_modes=tuple(damped_modes(case.rig)),
        matched_modes=checked.modes,
        targets=results,
        parameters=_parameters(case, weights),
        response_error=error,
        curves=curves_of(ObservedBed(tuned, parts_of(tuned, untuned=case.rig), controller_of(tuned))),
        verification=checked,
        objective=cost,
        simulated_in_time=None if in_time is None else in_time.result(),
        seconds=time.perf_counter() - begin,
        robust=robust,
    )


def _effort(case: Case, asked: TuningEffort | None) -> tuple[TuningEffort, list[str]]:
    """The effort that a case is worth, and what is to be said of it; ``asked`` has the number of fresh beds.

    Where dead time and sampling alone leave more than the case allows, no weights match, and beds with so many commands
    on their way take long.
    """
    bound = lower_bound(emulating_the_whole(case), 1)
    if bound <= max(case.tolerance, case.unmeasured_tolerance):
        return asked or TuningEffort(), []
    effort = SHORT_EFFORT if asked is None else replace(SHORT_EFFORT, fresh=asked.fresh)
    return effort, [
        f"dead time and sampling alone leave a response error of {bound:.2g}, more than is allowed: the search over "
        f"the observer's weights is short, and {effort.fresh} drawn beds judge it"
    ]


def _found(question: Question, cost: float, tuned: Case, checked: Verification) -> VerifiedSolution:
    """The tuned case in the form that the sentences on limits are made from."""
    case = question.case
    task = TuningTask(case, (), np.zeros(0), (), REGISTERED[case.objective].of(case), question.demands)
    return VerifiedSolution(task, Solution({}, cost, (), True), [], {}, tuned, checked)


def _parameters(case: Case, weights: dict[str, float]) -> tuple[ParameterResult, ...]:
    """The weights; adapters stay as planned."""
    made = []
    for name, value in weights.items():
        known = case.loop.structure.quantities[name]
        start, unit = case.loop[name], known.unit
        made.append(
            ParameterResult(f"loop.{name}", start, value, unit, known.lower, known.upper, 0.0, 0.0, False, True)
        )
    return tuple(made)
