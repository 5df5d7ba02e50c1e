"""The main job: from a case to a verified rig that reproduces the vehicle's response, or to what prevents it."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from matching.match.bounds import curves_of, emulating_the_whole, errors_with_bounds, lower_bound
from matching.match.case import Case, Move, apply, scaled
from matching.match.driving import driving
from matching.match.free_play import lashes
from matching.match.in_time import simulate_deviations
from matching.match.limits import (
    Relaxations,
    Solution,
    SolvedAgain,
    led_by_dead_time,
    limits,
    missing_measurement,
    relaxations,
)
from matching.match.loop import linear_bed
from matching.match.minutes import minutes_of, minutes_without
from matching.match.objective import search_for
from matching.match.operating_range import at_speed, ends_of
from matching.match.order import Fresh, Ordered, contributions, ordered, planned_unless_better
from matching.match.problem import (
    MatchProblem,
    Progress,
    check_sliding,
    differing_components,
    long_sample,
    opened_lashes,
    problem_of,
    standstill,
    target_results,
    unloaded_lashes,
)
from matching.match.range_search import RangeSearch
from matching.match.requirements import OPENED_SHAFTS
from matching.match.responses import ComparedBed, ResponseError, SimpleVehicle, fitted_simple_vehicle
from matching.match.result import MatchResult, ParameterResult
from matching.match.robustness import not_kept, noted, swings_on
from matching.match.search import solve
from matching.match.targets import LEAST_SHARE_TO_MOVE, change_weight
from matching.match.variables import CONTROLLER, RESIDUAL, RIG, SearchSettings
from matching.match.verify import verify
from matching.worker_pool import SideProcesses
from modelling.modal.modes import damped_modes

SHORT = SearchSettings(
    drawn=8,
    pool=16,
    rounds=1,
    steps=5,
    most_steps=20,
    joint_rounds=1,
    restarts=0,
    opened=False,
    scenarios=0,
    blind=16,
    followed=1,
    fresh=40,
    emulated=0.0,
)
LARGEST_UNMOVED = 0.005  # of a quantity's range: what ends so near its start stayed there
# Relative, above the error that was found, of the tolerances that are tried: each is a whole match. The search keeps
# the first one by its reserve; where it ends elsewhere, three per cent more are no other bed to an engineer.
ABOVE_THE_ERROR = (0.01, 0.03)
NOTHING_MOVED = "matched at the values the case began with: nothing had to move by more than 0.5 % of its range"


@dataclass(frozen=True)
class Attempt:
    """A case that was searched and not yet judged.

    Attributes
    ----------
    problem : MatchProblem
    simple : SimpleVehicle or None
        The case's own residual vehicle as fitted.
    settings : SearchSettings
        The effort that the case is worth, and ``short``, what is to be said of it.
    solution : Solution
        Not verified.
    settled : Ordered
    fresh : Fresh
        The beds that judge it.
    begun : float
        When it began, by :func:`time.perf_counter`.
    """

    problem: MatchProblem
    simple: SimpleVehicle | None
    settings: SearchSettings
    short: list[str]
    solution: Solution
    settled: Ordered
    fresh: Fresh
    begun: float


@threadpool_limits.wrap(limits=1, user_api="blas")
def attempt(
    case: Case, seed: int = 0, starts: int | None = None, progress: Progress | None = None, *, beds: int | None = None,
    aside: SideProcesses | None = None, ordering: bool = True, begins: Sequence[Mapping[str, float]] = (),
    settings: SearchSettings | None = None,
) -> Attempt:  # fmt: skip
    """The search of :func:`match` alone, whose parameters it has."""
    begun = time.perf_counter()
    tell = progress or (lambda _: None)
    check_sliding(case)
    case, simple = fitted_simple_vehicle(case)
    problem = problem_of(case)
    tell("vehicle, rig and manoeuvre")
    if aside is not None:
        aside.start()
    settings, short = _effort(case, settings or SearchSettings(), simple)
    settings = settings if starts is None else replace(settings, starts=min(starts, settings.starts))
    fresh = Fresh(settings.fresh if beds is None else beds, seed)
    solution, settled = _solved(problem, settings, fresh, tell, ordering, begins)
    return Attempt(problem, simple, settings, short, solution, settled, fresh, begun)


@threadpool_limits.wrap(limits=1, user_api="blas")
def match(
    case: Case, seed: int = 0, starts: int | None = None, progress: Progress | None = None, *, beds: int | None = None,
    aside: SideProcesses | None = None, ordering: bool = True, begins: Sequence[Mapping[str, float]] = (),
    settings: SearchSettings | None = None,
) -> MatchResult:  # fmt: skip
    """Match a rig to its vehicle.

    Parameters
    ----------
    case : Case
        From :func:`matching.match.case_file.load_case`.
    seed : int
        Of the fresh beds that judge the result; the search does not depend on it.
    starts : int, optional
        Starts of the search at most; the first is the case's own.
    progress : callable, optional
        Called with a word on what was just done.
    beds : int, optional
        Fresh beds drawn from the case's box that judge the result; 200 unless given.
    ordering : bool
        Have adapters stay as planned that gain nothing, and work out what each gains; without it they are as the search
        has them, as a map compares its points.
    aside : SideProcesses, optional
        Works out ``in_time`` during the verification; without it only where somebody asks for it.
    begins : sequence of mapping
        Values by name, SI, from which the search begins instead, as a map begins from its neighbours.
    settings : SearchSettings, optional

    Returns
    -------
    MatchResult
        ``status`` is ``matched`` only if every target is met, in the closed loop and in the simulation, every limit is
        kept, every bed is stable and damped, and every check of stability agrees.
    """
    found = attempt(
        case, seed, starts, progress, beds=beds, aside=aside, ordering=ordering, begins=begins, settings=settings
    )
    return judged(found, progress, aside=aside, ordering=ordering)


@threadpool_limits.wrap(limits=1, user_api="blas")
def judged(
    found: Attempt, progress: Progress | None = None, *, aside: SideProcesses | None = None, ordering: bool = True
) -> MatchResult:
    """The rest of :func:`match`: a search's end verified, judged on fresh beds and in time, with what limits it."""
    tell = progress or (lambda _: None)
    problem, simple, settings, short = found.problem, found.simple, found.settings, found.short
    solution, settled, count, seed = found.solution, found.settled, found.fresh.count, found.fresh.seed
    case, tuned = problem.case, solution.tuned
    in_time = None if aside is None else aside.begin(simulate_deviations, tuned, seed)
    standing = (
        (aside or SideProcesses()).begin(minutes_of, tuned, settings.emulated, seed) if settings.emulated else None
    )
    checked = verify(tuned, case.rig, beds=count, seed=seed)
    play = lashes(tuned, seed) if settings.emulated or checked.required.opened_shafts else None
    over_range = driving(tuned, seed) if case.operating_range is not None and settings.emulated else None
    tell("verification on fresh beds")
    solution = replace(solution, checked=checked)
    targets = target_results(problem, checked)
    error = errors_with_bounds(tuned, checked.errors)
    missed = any(not target.met for target in targets)
    unseen = error.unmeasured > case.unmeasured_tolerance >= error.bound
    asked = ordering and settings.remedies and (missed or bool(problem.beyond) or unseen)
    relaxed = relaxations(problem, solution, SolvedAgain(problem, settings)) if asked else Relaxations()
    stands = limits(problem, solution, targets, relaxed)
    run = standing.result() if standing is not None and checked.stable else minutes_without("it was not asked for")
    stands = [
        *stands,
        *not_kept(case, checked, play),
        *missing_measurement(relaxed, case),
        *run.sentences(),
        *(over_range.sentences(min(case.limits_of("torque"))) if over_range is not None else ()),
        *unloaded_lashes(case),
    ]
    stands = led_by_dead_time(stands, case, error)
    tell("bound and curves")
    result = MatchResult(
        status="limited" if stands else "matched",
        limits=tuple(stands),
        notes=(
            *differing_components(case),
            *case.notes,
            *standstill(case),
            *long_sample(case),
            *short,
            *opened_lashes(tuned, checked.traces),
            *_notes(problem, solution, bool(stands)),
            *noted(case, checked, play),
            *checked.notes,
            *run.notes(),
        ),
        case=case,
        tuned=tuned,
        vehicle_modes=tuple(damped_modes(case.vehicle)),
        rig_modes=tuple(damped_modes(case.rig)),
        matched_modes=checked.modes,
        targets=targets,
        parameters=_parameters(problem, solution),
        response_error=error,
        curves=curves_of(ComparedBed(tuned, linear_bed(tuned, untuned=case.rig))),
        verification=checked,
        objective=solution.cost,
        starts=solution.starts,
        failures=solution.failures,
        adapters=settled.trades,
        contributions=settled.contributions,
        minutes=run,
        lash=play,
        driving=over_range,
        simulated_in_time=None if in_time is None else in_time.result(),
        seconds=time.perf_counter() - found.begun,
    )
    # where adapters are ordered as well, a whole match more takes too long for a sentence; where something else is
    # missed too, robustness has come before the errors already, and larger tolerances do not help
    of_rig = any(move.name.startswith(RIG) for move in problem.moves)
    alone = solution.keeps_all and not missed and checked.stable and not run.sentences()
    if ordering and settings.remedies and not short and not of_rig and alone and any(too_large(case, error)):
        given = replace(settings, remedies=False, decides=True)
        limited = replace(case, limits={**case.limits, **relaxed.limits})
        said = _with_larger_tolerances(limited, result, lambda one: match(one, seed, beds=count, settings=given))
        tell("larger tolerances")
        result = replace(result, limits=(*result.limits, *said), seconds=time.perf_counter() - found.begun)
    return with_simple_vehicle(result, simple)


def too_large(case: Case, error: ResponseError) -> tuple[bool, bool]:
    """Whether the errors to measured and to unmeasured torques are larger than the case allows."""
    return error.after > case.tolerance, error.unmeasured > case.unmeasured_tolerance


def _with_larger_tolerances(case: Case, result: MatchResult, again: Callable[[Case], MatchResult]) -> list[str]:
    """The tolerances with which the case is matched, tried by matching it anew; free play waived where it limits too.

    A search with other tolerances ends elsewhere: where it leaves a larger error than the one before, that is tried.
    """
    play = swings_on(result.verification, result.lash)
    case = replace(case, limits={**case.limits, OPENED_SHAFTS: False}) if play else case
    said = {key: f"response.{key}" for key in ("tolerance", "unmeasured_tolerance")}
    stated: dict[str, float] = {}
    for above in ABOVE_THE_ERROR:
        error = result.response_error
        for key, value, large in zip(said, (error.after, error.unmeasured), too_large(case, error), strict=True):
            if large:
                stated[key] = _rounded_up(value * (1 + above))
        case = replace(
            case, tolerance=stated.get("tolerance", case.tolerance),
            unmeasured_tolerance=stated.get("unmeasured_tolerance", case.unmeasured_tolerance),
        )  # fmt: skip
        result = again(case)
        if result.status == "matched":
            words = [f"{said[key]} = {value:g}" for key, value in stated.items()]
            words += ["limits.opened_shafts = false"] if play else []
            return [f"matched anew with {' and '.join(words)}, the match is good"]
        if not any(too_large(case, result.response_error)):
            break
    return []


def _rounded_up(value: float) -> float:
    """A value as it is printed, with three digits."""
    step = 10.0 ** (np.floor(np.log10(value)) - 2)
    return float(f"{np.ceil(value / step) * step:.3g}")


def _solved(
    problem: MatchProblem, settings: SearchSettings, fresh: Fresh, tell: Progress, ordering: bool,
    begins: Sequence[Mapping[str, float]],
) -> tuple[Solution, Ordered]:  # fmt: skip
    """The tuned case, not yet verified, and what was ordered."""
    case = problem.case
    if not problem.moves and not case.loop.tunes_observer:
        return Solution({}, case, float("nan"), (), True, problem.beyond), Ordered(np.zeros(0), True)
    asked = problem.demands if not problem.beyond else replace(problem.demands, limits={})
    search = search_for(case, problem.moves, problem.shares, asked, settings)
    if case.operating_range is not None:
        ends = [
            search_for(at_speed(case, speed), problem.moves, problem.shares, asked, settings) for speed in ends_of(case)
        ]
        search = RangeSearch([search, *ends])
    found = solve(search, tell, begins)
    settled = Ordered(found.end.x, found.keeps_all)
    worth = found.end.judged.cost <= settings.hopeless
    if ordering and worth and any(one.name.startswith("rig.") for one in search.variables):
        settled = (ordered if found.keeps_all else planned_unless_better)(search, found, fresh)
        tell("what to order")
    elif ordering and any(not one.name.startswith(CONTROLLER) for one in search.variables):
        rows = contributions(search, found, fresh, {"all": fresh.delivered(search, found.end)})
        settled = replace(settled, contributions=rows)
    values = search.values(settled.x)
    judged = search.judged(settled.x)
    return (
        Solution(
            values,
            apply(case, values),
            judged.cost,
            found.starts,
            settled.keeps_all,
            problem.beyond,
            failures=found.failures,
        ),
        settled,
    )


def _effort(
    case: Case, settings: SearchSettings, simple: SimpleVehicle | None
) -> tuple[SearchSettings, list[str]]:  # fmt: skip
    """The effort that a case is worth, and what is to be said of it.

    Where dead time and sampling alone leave more than the case allows, or a residual vehicle of its own does, no
    controller matches, and beds with so many delayed commands take long.
    """
    if case.loop.torqueless:
        return settings, []
    if simple is not None and simple.fitted > case.tolerance and case.loop.tunes_observer:
        return SHORT, ["the residual vehicle alone leaves more than is allowed: the search is short"]
    bound = lower_bound(emulating_the_whole(case), 1)
    if bound <= max(case.tolerance, case.unmeasured_tolerance):
        return settings, []
    return SHORT, [
        f"dead time and sampling alone leave a response error of {bound:.2g}, more than is allowed: the search is short"
    ]


def with_simple_vehicle(result: MatchResult, simple: SimpleVehicle | None) -> MatchResult:
    """The result with what the case's own residual vehicle lacks: the first reason where that alone is too much."""
    if simple is None:
        return result
    if result.limits and simple.fitted > result.case.tolerance:
        return replace(result, simple_vehicle=simple, limits=(simple.sentence(), *result.limits))
    return replace(result, simple_vehicle=simple, notes=(simple.sentence(), *result.notes))


def _parameters(problem: MatchProblem, solution: Solution) -> tuple[ParameterResult, ...]:
    """The weights of an observer, then every quantity under ``[move]``."""
    case, made = problem.case, []
    if case.loop.tunes_observer:
        for name, known in case.loop.structure.quantities.items():
            full = f"{CONTROLLER}{name}"
            made.append(
                ParameterResult(
                    full, case.loop[name], solution.values.get(full, case.loop[name]), known.unit, known.lower,
                    known.upper, 0.0, 0.0, False, True,
                )
            )  # fmt: skip
    for move in case.moves:
        if case.loop.tunes_observer and move.name.startswith(CONTROLLER):
            continue
        part = problem.shares[move.name]
        tuned, weight = solution.values.get(move.name, move.start), change_weight(part)
        cost = weight * (scaled(tuned, move) - scaled(move.planned, move)) ** 2
        made.append(
            ParameterResult(
                move.name, move.start, tuned, move.unit, move.lower, move.upper, weight, part,
                move not in problem.moves, change_cost=cost,
            )
        )  # fmt: skip
    return tuple(made)


def _notes(problem: MatchProblem, solution: Solution, limited: bool) -> list[str]:
    """That nothing had to move, that a moved residual vehicle is no car, and what moves for a limit alone."""
    notes = []
    ends = [(move, solution.values.get(move.name, move.start)) for move in problem.moves]
    unmoved = [abs(end - move.start) <= LARGEST_UNMOVED * (move.upper - move.lower) for move, end in ends]
    if not limited and all(unmoved) and not problem.case.loop.tunes_observer:
        notes.append(NOTHING_MOVED)
    bound = [one.name for one in _parameters(problem, solution) if one.at_bound and one.name.startswith(CONTROLLER)]
    if bound:
        notes.append(f"weights of the controller at a bound of the search: {', '.join(bound)}")
    notes += _compensation([(move, end) for move, end in ends if move.name.startswith(RESIDUAL)])
    notes += [
        f"{name} holds under {100 * LEAST_SHARE_TO_MOVE:.0f} % of every target mode's energy "
        f"and moves for the limit {limit} alone"
        for name, limit in problem.released.items()
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
