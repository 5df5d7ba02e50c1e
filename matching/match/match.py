"""The main job: from a case to a verified rig that reproduces the vehicle's response, or to what prevents it."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from threadpoolctl import threadpool_limits

from matching.match.bounds import curves_of, emulating_the_whole, errors_with_bounds, lower_bound
from matching.match.case import Case, Move, apply, scaled, whole_loop
from matching.match.driving import DRIVING, DrivingSettings, driving, not_followed, stresses_beyond
from matching.match.findings import Finding, stated
from matching.match.firing import followed_pulses, with_pulses_of, without_pulses
from matching.match.free_play import FREE_PLAY, FreePlay, lashes
from matching.match.in_time import simulate_deviations
from matching.match.limits import (
    Relaxations,
    Solution,
    SolvedAgain,
    led_by_bound,
    limits,
    relaxations,
)
from matching.match.loop import linear_bed
from matching.match.minutes import MinuteSettings, minutes_of, minutes_without
from matching.match.objective import search_for
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
from matching.match.remedies import REMEDIES, RemedySettings, remedies_of
from matching.match.responses import ComparedBed, SimpleVehicle, error_figures, fitted_simple_vehicle
from matching.match.result import MatchResult, ParameterResult
from matching.match.robustness import DRAWN_BEDS, DrawnBedsSettings, not_kept, noted
from matching.match.search import solve
from matching.match.targets import LEAST_SHARE_TO_MOVE, change_weight
from matching.match.variables import CONTROLLER, RESIDUAL, SearchSettings
from matching.match.vehicle_check import check_vehicle
from matching.match.verify import verify
from matching.worker_pool import SideProcesses
from modelling.bed.specimen import KNOWN
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
NOTHING_MOVED = "matched at the values the case began with: nothing had to move by more than 0.5 % of its range"


@dataclass(frozen=True)
class JudgeSettings:
    """How a tuned bed is judged beside the requirements of the case; each class says what its numbers mean.

    Attributes
    ----------
    play : FreePlay
        Coming to rest with free play.
    minutes : MinuteSettings
        Standing still and staying in emulation; its ``seconds`` are ``emulated`` of the search's settings.
    driving : DrivingSettings
        A range of speeds.
    drawn_beds : DrawnBedsSettings
        What drawn beds are worth a sentence.
    remedies : RemedySettings
        What would make a limited case a match.
    """

    play: FreePlay = FREE_PLAY
    minutes: MinuteSettings = field(default_factory=MinuteSettings)
    driving: DrivingSettings = DRIVING
    drawn_beds: DrawnBedsSettings = DRAWN_BEDS
    remedies: RemedySettings = REMEDIES


JUDGING = JudgeSettings()


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
    given : SearchSettings
        As asked for, before the effort was judged.
    """

    problem: MatchProblem
    simple: SimpleVehicle | None
    settings: SearchSettings
    short: list[str]
    solution: Solution
    settled: Ordered
    fresh: Fresh
    begun: float
    given: SearchSettings


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
    given = settings or SearchSettings()
    settings, short = _effort(case, given, simple)
    settings = settings if starts is None else replace(settings, starts=min(starts, settings.starts))
    if case.vehicle_in_the_loop is not None and settings.emulated and not begins:
        short = [*short, *check_vehicle(case).remarks()]
        tell("the vehicle driven alone")
    fresh = Fresh(settings.fresh if beds is None else beds, seed)
    solution, settled = _solved(problem, settings, fresh, tell, ordering, begins)
    return Attempt(problem, simple, settings, short, solution, settled, fresh, begun, given)


@threadpool_limits.wrap(limits=1, user_api="blas")
def match(
    case: Case, seed: int = 0, starts: int | None = None, progress: Progress | None = None, *, beds: int | None = None,
    aside: SideProcesses | None = None, ordering: bool = True, begins: Sequence[Mapping[str, float]] = (),
    settings: SearchSettings | None = None, judging: JudgeSettings = JUDGING,
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
    judging : JudgeSettings, optional

    Returns
    -------
    MatchResult
        ``status`` is ``matched`` only if every target is met, in the closed loop and in the simulation, every limit is
        kept, every bed is stable and damped, and every check of stability agrees.
    """
    found = attempt(
        without_pulses(case), seed, starts, progress, beds=beds, aside=aside, ordering=ordering, begins=begins,
        settings=settings,
    )  # fmt: skip
    return _with_pulses(judged(found, progress, aside=aside, ordering=ordering, judging=judging), case, seed)


def _with_pulses(result: MatchResult, given: Case, seed: int) -> MatchResult:
    """The result with the engine's pulses of the case that was given: they are followed by a feed-forward of their own,
    which no judge of motions sees."""
    if result.driving is None or given.vehicle.effects == result.case.vehicle.effects:
        return result
    tuned = with_pulses_of(result.tuned, given)
    over_range = replace(result.driving, pulses=followed_pulses(tuned, seed))
    return replace(result, case=given, tuned=tuned, driving=over_range)


@threadpool_limits.wrap(limits=1, user_api="blas")
def judged(
    found: Attempt, progress: Progress | None = None, *, aside: SideProcesses | None = None, ordering: bool = True,
    judging: JudgeSettings = JUDGING,
) -> MatchResult:  # fmt: skip
    """The rest of :func:`match`: a search's end verified, judged on fresh beds and in time, with what limits it."""
    tell = progress or (lambda _: None)
    problem, simple, settings, short = found.problem, found.simple, found.settings, found.short
    solution, settled, count, seed = found.solution, found.settled, found.fresh.count, found.fresh.seed
    case, tuned = problem.case, solution.tuned
    in_time = None if aside is None else aside.begin(simulate_deviations, tuned, seed)
    standing = (
        (aside or SideProcesses()).begin(minutes_of, tuned, settings.emulated, seed, judging.minutes)
        if settings.emulated
        else None
    )
    checked = verify(tuned, case.rig, beds=count, seed=seed)
    play = lashes(tuned, seed, judging.play) if settings.emulated or checked.required.opened_shafts else None
    over_range = None
    if case.operating_range is not None and settings.emulated:
        over_range = driving(tuned, seed, judging.driving)
    tell("verification on fresh beds")
    solution = replace(solution, checked=checked)
    targets = target_results(problem, checked)
    error = errors_with_bounds(tuned, checked.errors)
    missed = any(not target.met for target in targets)
    known = case.loop.specimen == KNOWN  # else what helps is to know it: the errors that it leaves then are worked out
    asked = ordering and settings.remedies and known and (missed or bool(problem.beyond))
    relaxed = relaxations(problem, solution, SolvedAgain(problem, settings)) if asked else Relaxations()
    stands = limits(problem, solution, targets, relaxed)
    run = standing.result() if standing is not None and checked.stable else minutes_without("it was not asked for")
    stands += [
        *not_kept(case, checked, play),
        *run.findings,
        *stated("drive", over_range.sentences(min(case.limits_of("torque"))) if over_range is not None else ()),
        *stated("drive", stresses_beyond(tuned, over_range.drives) if over_range is not None else ()),
        *stated("open_lash", unloaded_lashes(case)),
    ]
    stands = led_by_bound(stands, case, error)
    findings = (*stands, *_both_ways(solution, case), *noted(case, checked, play, judging.drawn_beds))
    if not known and ordering:
        error = replace(error, specimen_known=_with_specimen_known(tuned, settings))
    tell("bound and curves")
    result = MatchResult(
        findings=findings,
        remarks=(
            *differing_components(case),
            *case.notes,
            *(not_followed(case) if over_range is not None else ()),
            *standstill(case),
            *long_sample(case),
            *short,
            *opened_lashes(tuned, checked.traces),
            *_notes(problem, solution, bool(stands)),
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
    result = with_simple_vehicle(result, simple)
    if result.status == "limited" and ordering and settings.remedies and not missed_on_purpose(result):
        given = replace(found.given, remedies=False, decides=True, blind=0)
        begins = [solution.values, *(way for way in (solution.play or ()) if way)] if solution.values else []

        def again(changed: Case) -> MatchResult:
            return match(changed, seed, beds=count, settings=given, ordering=False, begins=begins, judging=judging)

        result = replace(result, remedies=remedies_of(result, again, relaxed.limits, judging.remedies))
        tell("what would make it a match")
    return replace(result, seconds=time.perf_counter() - found.begun)


def _with_specimen_known(tuned: Case, settings: SearchSettings) -> tuple[float, float]:
    """Response errors to measured and unmeasured torques of the controller that knows the specimen, tuned on the same
    bed from one start: what it costs not to know it."""
    case = replace(tuned, loop=whole_loop(tuned), moves=())
    found = attempt(case, starts=1, ordering=False, settings=replace(settings, remedies=False))
    figures = error_figures(found.solution.tuned)
    return figures.after, figures.unmeasured


def missed_on_purpose(result: MatchResult) -> bool:
    """Whether no single change is tried: dynamometers without torque, laws that are tried with :mod:`.limits`, a range
    of speeds, each match of which takes a minute, a specimen that is not known."""
    loop = result.case.loop
    fixed = loop.torqueless or not loop.tunes_observer
    return fixed or result.case.operating_range is not None or loop.specimen != KNOWN


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
            play=found.play,
        ),
        settled,
    )


def _both_ways(solution: Solution, case: Case) -> list[Finding]:
    """What free play in the cut shafts costs the errors, where it does: with and without it kept at rest."""
    if solution.play is None or solution.play.kept is None:
        return []
    held, free = (error_figures(apply(case, values)) for values in (solution.play.kept, solution.play.without))
    return [
        Finding(
            "play_costs", held.unmeasured, free.unmeasured, where="unmeasured torques", limits=False,
            data={"kept": (held.after, held.unmeasured), "without": (free.after, free.unmeasured)},
        )
    ]  # fmt: skip


def _effort(
    case: Case, settings: SearchSettings, simple: SimpleVehicle | None
) -> tuple[SearchSettings, list[str]]:  # fmt: skip
    """The effort that a case is worth, and what is to be said of it.

    Where dead time, sampling and the specimen alone leave more than the case allows, or a residual vehicle of its own
    does, no controller matches, and beds with so many delayed commands take long.
    """
    if case.loop.torqueless:
        return settings, []
    if simple is not None and simple.fitted > case.tolerance and case.loop.tunes_observer:
        return SHORT, ["the residual vehicle alone leaves more than is allowed: the search is short"]
    bound = lower_bound(emulating_the_whole(case), 1)
    if bound <= max(case.tolerance, case.unmeasured_tolerance):
        return settings, []
    return SHORT, [
        f"no controller comes below a response error of {bound:.2g}, more than is allowed: the search is short"
    ]


def with_simple_vehicle(result: MatchResult, simple: SimpleVehicle | None) -> MatchResult:
    """The result with what the case's own residual vehicle lacks: the first reason where that alone is too much."""
    if simple is None:
        return result
    if result.limits and simple.fitted > result.case.tolerance:
        own = Finding(
            "residual_vehicle", simple.fitted, result.case.tolerance, data={"words": simple.sentence()}
        )  # fmt: skip
        return replace(result, simple_vehicle=simple, findings=(own, *result.findings))
    return replace(result, simple_vehicle=simple, remarks=(simple.sentence(), *result.remarks))


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
