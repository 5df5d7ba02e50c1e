"""The main job: from a case to a verified rig that reproduces the vehicle's response, or to what prevents it."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from matching.match.adapters import curves_of, emulating_the_whole, errors_with_bounds, lower_bound, settle_adapters
from matching.match.attempt import (
    Progress,
    Question,
    SearchEffort,
    VerifiedSolution,
    check_sliding,
    differing_components,
    opened_lashes,
    question_of,
    solve_and_verify,
    standstill,
    target_results,
    unloaded_lashes,
)
from matching.match.case import LEAST_SHARE_TO_MOVE, Case, Move, apply, change_weight, scaled
from matching.match.in_time import truth_of
from matching.match.limits import Relaxations, led_by_dead_time, limits, relaxations
from matching.match.loop import linear_bed
from matching.match.objectives import REGISTERED
from matching.match.responses import ComparedBed, SimpleVehicle, fitted_simple_vehicle
from matching.match.result import MatchResult, ParameterResult, ResponseError, TargetResult
from matching.match.robustness import not_kept, noted, of_beds, on_drawn_beds, over_beds
from matching.match.solve import Near, Solution, TuningTask
from matching.match.tune_observer import TuningEffort, tuned_weights, tuner
from matching.match.verify import Verification, verify
from matching.worker_pool import SideProcesses
from modelling.modal.modes import damped_modes

# --- A match with an observer: its weights tuned over drawn beds, verified on fresh ones.

SHORT_EFFORT = TuningEffort(drawn=8, pool=16, rounds=1, steps=5, most_steps=20, scenarios=0, blind=0, fresh=40)
AS_CUT = "the residual vehicle stays as it is cut from the vehicle: the observer needs no other"


def match_with_observer(
    question: Question, seed: int, tell: Progress, effort: TuningEffort | None, aside: SideProcesses | None = None
) -> MatchResult:
    """Tune the weights of an observer over drawn beds and judge the result on fresh ones."""
    begin, case = time.perf_counter(), question.case
    effort, short = _effort(case, effort)
    search = tuner(case, effort.drawn, effort.pool)
    tell("drawn beds")
    weights, cost = tuned_weights(search, effort)
    tell("weights")
    tuned = apply(case, {f"loop.{name}": value for name, value in weights.items()})
    in_time = None if aside is None else aside.begin(truth_of, tuned)
    checked = verify(tuned, case.rig, beds=effort.fresh, seed=seed)
    tell("verification on fresh beds")
    results = target_results(question, checked)
    error = errors_with_bounds(tuned, checked.errors)
    stands = limits(question, _found(question, cost, tuned, checked), results, Relaxations())
    stands = led_by_dead_time([*stands, *not_kept(case, checked), *unloaded_lashes(case)], case, error)
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
            *noted(case, checked),
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
        curves=curves_of(ComparedBed(tuned, linear_bed(tuned, untuned=case.rig))),
        verification=checked,
        objective=cost,
        simulated_in_time=None if in_time is None else in_time.result(),
        seconds=time.perf_counter() - begin,
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


# --- Match

LARGEST_UNMOVED = 0.005  # of a quantity's range: what ends so near its start stayed there
RESIDUAL = "residual_vehicle."
NOTHING_MOVED = "matched at the values the case began with: nothing had to move by more than 0.5 % of its range"


# more than six parameters: what the options of the command say, the map's start, and a process beside this one
def match(
    case: Case, seed: int = 0, starts: int = 14, progress: Progress | None = None, workers: int = 1,
    near: Near | None = None, beds: int | None = None, aside: SideProcesses | None = None, ordering: bool = True,
) -> MatchResult:  # fmt: skip
    """Match a rig to its vehicle.

    Parameters
    ----------
    case : Case
        From :func:`matching.match.case_file.load_case`.
    seed : int
        Of the random starts.
    starts : int
        At most; fewer when three agree on the best.
    progress : callable, optional
        Called with a word on what was just done.
    workers : int
        Processes for the starts; the result does not depend on how many.
    near : Near, optional
        Solutions of like cases, to start from these alone.
    beds : int, optional
        Fresh beds drawn from the case's box that judge the result; 200 of an observer unless given, none of a feedback
        law.
    ordering : bool
        Have adapters stay as planned that gain nothing; without it they are as the least error has them, as a map
        compares its points. Never with ``near``.
    aside : SideProcesses, optional
        Works out ``in_time`` beside the verification; without it only where somebody asks for it.

    Returns
    -------
    MatchResult
        ``status`` is ``matched`` only if every target is met, in the closed loop and in the simulation, every limit is
        kept and every check of stability agrees.
    """
    begin = time.perf_counter()
    tell = progress or (lambda _: None)
    check_sliding(case)
    case, simple = fitted_simple_vehicle(case)
    question = question_of(case)
    tell("vehicle, rig and manoeuvre")
    if aside is not None:
        aside.start()
    if case.loop.structure.is_observer:
        effort = None if beds is None else TuningEffort(fresh=beds)
        return with_simple_vehicle(match_with_observer(question, seed, tell, effort, aside), simple)
    result = _match_with_feedback(question, SearchEffort(seed, starts, workers, tell, near, ordering), beds, aside)
    return with_simple_vehicle(replace(result, seconds=time.perf_counter() - begin), simple)


def _match_with_feedback(
    question: Question, effort: SearchEffort, beds: int | None, aside: SideProcesses | None
) -> MatchResult:
    verified = solve_and_verify(question, effort)
    verified, adapters = settle_adapters(question, verified) if effort.ordering and not effort.near else (verified, ())
    robust = None if beds is None else on_drawn_beds(verified.tuned, verified.checked, beds, effort.seed)
    further: list[str] = []
    if robust is not None and not effort.near:
        verified, robust, further = _over_beds(question, verified, robust, effort)
    if robust is not None:
        verified = replace(verified, checked=robust)
    in_time = None if aside is None else aside.begin(truth_of, verified.tuned)
    targets = target_results(question, verified.checked)
    relaxed = Relaxations() if effort.near else relaxations(question, verified, targets)
    stands = [*limits(question, verified, targets, relaxed), *unloaded_lashes(question.case)]
    errors = errors_with_bounds(verified.tuned, verified.checked.errors)
    stands += [] if robust is None else not_kept(question.case, robust)
    stands = led_by_dead_time(stands, question.case, errors)
    effort.tell("bound and curves")
    result = _result(question, verified, targets, stands, errors)
    notes = (*result.notes, *([] if robust is None else noted(question.case, robust)), *further)
    simulated = None if in_time is None else in_time.result()
    return replace(result, notes=notes, adapters=adapters, simulated_in_time=simulated)


def _over_beds(
    question: Question, verified: VerifiedSolution, robust: Verification, effort: SearchEffort
) -> tuple[VerifiedSolution, Verification, list[str]]:
    """The gains tuned over drawn beds where those found miss something and that gains; with what to note."""
    case, count = question.case, of_beds(robust).drawn
    if not count or not [*not_kept(case, robust), *noted(case, robust)]:
        return verified, robust, []
    better = over_beds(verified.tuned, case.rig, verified.task.moves, count, effort.seed)
    effort.tell("gains over drawn beds")
    if better is None or not _missed(question, better.robust) < _missed(question, robust):
        return verified, robust, []
    solution = replace(verified.solution, values={**verified.solution.values, **better.values}, feasible=True)
    return (
        replace(verified, solution=solution, tuned=better.tuned, checked=better.robust),
        better.robust,
        [better.sentence()],
    )


def _missed(question: Question, robust: Verification) -> tuple[float, ...]:
    """What a tuned law misses, what weighs most first: targets, limits, stability and damping of beds, the rest."""
    checked, beds, case = robust, of_beds(robust), question.case
    every = [*not_kept(case, robust), *noted(case, robust)]
    error = float(np.median(beds.unmeasured)) if beds.unmeasured else np.inf
    targets = sum(not target.met for target in target_results(question, checked))
    missed = (not checked.stable) + len(checked.violations)
    return targets, missed, beds.drawn - beds.stable, beds.drawn - beds.damped, len(every), error


def with_simple_vehicle(result: MatchResult, simple: SimpleVehicle | None) -> MatchResult:
    """The result with what the case's own residual vehicle lacks: the first reason where that alone is too much."""
    if simple is None:
        return result
    if result.limits and simple.fitted > result.case.tolerance:
        return replace(result, simple_vehicle=simple, limits=(simple.sentence(), *result.limits))
    return replace(result, simple_vehicle=simple, notes=(simple.sentence(), *result.notes))


def _result(
    question: Question, verified: VerifiedSolution, targets: tuple[TargetResult, ...], stands: list[str],
    errors: ResponseError,
) -> MatchResult:  # fmt: skip
    case, solution, checked = question.case, verified.solution, verified.checked
    return MatchResult(
        status="limited" if stands else "matched",
        limits=tuple(stands),
        notes=(
            *differing_components(case),
            *case.notes,
            *standstill(case),
            *opened_lashes(verified.tuned, checked.traces),
            *_notes(verified.task, solution, verified.released, bool(stands)),
            *checked.notes,
        ),
        case=case,
        tuned=verified.tuned,
        vehicle_modes=tuple(damped_modes(case.vehicle)),
        rig_modes=tuple(damped_modes(case.rig)),
        matched_modes=checked.modes,
        targets=targets,
        parameters=tuple(
            _parameter(move, float(part), solution, move in verified.task.moves)
            for move, part in zip(case.moves, question.shares, strict=True)
        ),
        response_error=errors,
        curves=curves_of(ComparedBed(verified.tuned, linear_bed(verified.tuned, untuned=case.rig))),
        verification=checked,
        objective=solution.objective,
        starts=solution.starts,
        pairs=solution.pairs,
        seconds=0.0,
    )


def _notes(task: TuningTask, solution: Solution, released: Mapping[str, str], limited: bool) -> list[str]:
    """That nothing had to move, that a moved residual vehicle is no car, and what moves for a limit alone."""
    notes = []
    ends = [(move, solution.values.get(move.name, move.start)) for move in task.moves]
    if not limited and all(abs(end - move.start) <= LARGEST_UNMOVED * (move.upper - move.lower) for move, end in ends):
        notes.append(NOTHING_MOVED)
    notes += _compensation([(move, end) for move, end in ends if move.name.startswith(RESIDUAL)])
    notes += [
        f"{name} holds under {LEAST_SHARE_TO_MOVE:.0%} of every target mode's energy "
        f"and moves for the limit {limit} alone"
        for name, limit in released.items()
    ]
    return notes


def _compensation(ends: Sequence[tuple[Move, float]]) -> list[str]:
    """That a residual vehicle that was cut from the vehicle and moved is no longer the car, and by how much."""
    moved = [
        f"{move.name.removeprefix(RESIDUAL)} {end / move.planned - 1:+.1%}"
        for move, end in ends
        if move.planned and abs(end - move.planned) > LARGEST_UNMOVED * (move.upper - move.lower)
    ]
    if not moved:
        return []
    return [f"the moved residual vehicle is a compensation, not the car: {', '.join(moved)} of what was cut from it"]


def _parameter(move: Move, part: float, solution: Solution, free: bool) -> ParameterResult:
    tuned, weight = solution.values.get(move.name, move.start), change_weight(part)
    cost = weight * (scaled(tuned, move) - scaled(move.planned, move)) ** 2
    return ParameterResult(
        move.name, move.start, tuned, move.unit, move.lower, move.upper, weight, part, not free, change_cost=cost
    )
