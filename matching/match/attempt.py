"""Whether targets are met: in the closed loop and in the simulation, in frequency and in damping."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from matching.match.case import (
    TORQUE_OVER_SPEED,
    Case,
    Demands,
    ExceededLimit,
    Move,
    Target,
    apply,
    change_weight,
    counterparts,
    demands,
    goals,
    released_moves,
    scaled,
    shares_of,
    target_modes,
    unscaled,
)
from matching.match.loop import feedback_on, linear_bed
from matching.match.loop_modes import ClosedLoop, LoopMode, inside_unit_circle, match_mode, neutral_motions
from matching.match.objectives import REGISTERED
from matching.match.programme import solved
from matching.match.result import TargetResult
from matching.match.solve import Near, Solution, TuningTask, solve, warm
from matching.match.verify import Traces, Verification, verify
from modelling.equations.casadi_code import compiled
from modelling.errors import InputError
from modelling.linear.steady_motion import operating_motion, speeds_of
from modelling.modal.modes import modes
from modelling.modal.result import Mode
from modelling.system import Gear, Shaft, System

# --- By how much what stands in the way would have to give.

CORNERS = 6  # quantities up to which every corner of the bounds is a start
HALVINGS = 3  # of the range of dead times, on a logarithmic scale
AT_BOUND = 1e-2  # of a quantity's range: what ends so near a bound may be held by it
FACTORS = (3.0, 30.0)  # by which bounds are moved out, in turn


def unkept(case: Case, moves: Sequence[Move], asked: Demands) -> list[ExceededLimit]:
    """Limits that the vehicle's manoeuvre breaks whatever the moves are, at the setting that breaks them least.

    Empty where some setting keeps all. The demands are convex in the inertias and fall with stiffness, so the
    optimiser's end, from the best corner of the bounds, is the least.
    """
    v = ca.MX.sym("v", len(moves))
    symbols = {f"rig.{name}": ca.MX(quantity.value) for name, quantity in case.rig.parameters.items()}
    symbols |= {name: ca.MX(unscaled(v[i], move)) for i, move in enumerate(moves) for name in move.together}
    rows = ca.vertcat(*(row for row, _ in asked.constraints(symbols)))
    if not moves or rows.is_empty():
        return []
    used = [i for i, does in enumerate(ca.which_depends(rows, v, 1, False)) if does]
    worst = ca.Function("worst", [v], [ca.mmax(rows)])
    start = np.full(len(moves), 0.5)
    corners = itertools.product((0.0, 1.0), repeat=len(used)) if len(used) <= CORNERS else ()
    starts = [start]
    for corner in corners:
        starts.append(start.copy())
        starts[-1][used] = corner
    best = min(starts, key=lambda x: float(worst(x)))
    t = ca.MX.sym("t")
    quiet: dict[str, Any] = {"print_time": False, "error_on_fail": False, "ipopt": {"print_level": 0, "sb": "yes"}}
    solver = ca.nlpsol("least", "ipopt", {"x": ca.vertcat(v, t), "f": t, "g": rows - t}, quiet)
    x0 = [*best, float(worst(best))]
    solution = solved(solver, x0=x0, lbx=[*np.zeros(len(moves)), 0], ubx=[*np.ones(len(moves)), np.inf], ubg=0)
    end = np.clip(solution["x"].full().ravel()[:-1], 0, 1)
    best = min((best, end), key=lambda x: float(worst(x)))
    if float(worst(best)) <= 1:
        return []
    values = {f"rig.{name}": quantity.value for name, quantity in case.rig.parameters.items()}
    values |= {name: float(unscaled(best[i], move)) for i, move in enumerate(moves) for name in move.together}
    return asked.broken(values)


@dataclass(frozen=True)
class DeadTimeTrial:
    """Shorter dead times that were solved: the shortest, and the longest with which every target is met, s or None."""

    shortest: float
    sufficient: float | None


def shorter_dead_times(
    task: TuningTask, solution: Solution, targets: Sequence[tuple[Mode, Mode]]
) -> DeadTimeTrial | None:
    """Solve the case at shorter dead times; None where there is none to try, as it is one sample already.

    Each is solved anew from the solution and from a gentler loop, and judged by margin and poles.
    """
    case = task.case
    shortest, longest = case.loop["sample_time"], case.loop["dead_time"]
    if longest <= shortest:
        return None
    if not _shows(task, solution, targets, shortest):
        return DeadTimeTrial(shortest, None)
    good = shortest
    for _ in range(HALVINGS):
        middle = float(np.sqrt(good * longest))
        if _shows(task, solution, targets, middle):
            good = middle
        else:
            longest = middle
    return DeadTimeTrial(shortest, good)


def _shows(task: TuningTask, solution: Solution, targets: Sequence[tuple[Mode, Mode]], dead_time: float) -> bool:
    case = replace(task.case, loop=task.case.loop.with_values({"dead_time": dead_time}))
    solved = warm(replace(task, case=case), solution)
    if solved is None:
        return False
    bed = linear_bed(apply(case, solved.values))
    loop = ClosedLoop.of(bed, feedback_on(bed))
    if not inside_unit_circle(loop.poles, neutral_motions(bed)) or not solved.holds:
        return False
    loop_modes = loop.modes()
    inertia = {f"inertias.{part.name}": part.J.value for part in case.vehicle.inertias}
    return all(
        (best := match_mode(wanted, loop_modes, inertia)) is not None and _keeps(target, wanted, best[0])
        for target, (_, wanted) in zip(case.targets, targets, strict=True)
    )


def _keeps(target: Target, wanted: Mode, shown: LoopMode) -> bool:
    """Whether a mode is as near to the one wanted as its target asks for."""
    return (
        abs(shown.frequency / wanted.frequency - 1) <= target.frequency_tolerance
        and abs(shown.damping_ratio - wanted.damping_ratio) <= target.damping_tolerance
    )


def wider_bounds(
    task: TuningTask, solution: Solution, meets: Callable[[Solution], bool]
) -> tuple[tuple[Move, float], ...]:
    """Quantities at a bound, as the case has them, each with the value (SI) beyond it with which every target is met.

    One of them where that does alone, else all that went beyond their bounds together; empty where none of it helps.

    Parameters
    ----------
    meets : callable
        Whether the case meets its targets and limits with a solution, verified.
    """
    stuck = [move for move in task.moves if _out_of(move, solution.values[move.name], 1.0) is not None]
    for factor in FACTORS if stuck else ():
        together = _beyond(task, solution, meets, stuck, factor)
        if not together:
            continue
        alone = (_beyond(task, solution, meets, [move], factor) for move, _ in together) if len(together) > 1 else ()
        return next((sufficient for sufficient in alone if sufficient), together)
    return ()


def _beyond(
    task: TuningTask, solution: Solution, meets: Callable[[Solution], bool], stuck: Sequence[Move], factor: float
) -> tuple[tuple[Move, float], ...]:
    """What ends beyond its bound where the bounds at which some quantities are stuck are moved out; empty if no use."""
    moved = {move.name: _out_of(move, solution.values[move.name], factor) or move for move in stuck}
    wider = replace(task, moves=tuple(moved.get(move.name, move) for move in task.moves))
    solved = warm(wider, solution)
    if solved is None or not meets(solved):
        return ()
    values = [(move, solved.values[move.name]) for move in stuck]
    return tuple((move, value) for move, value in values if not move.lower <= value <= move.upper)


def _out_of(move: Move, value: float, factor: float) -> Move | None:
    """A move with the bound that a value is at moved out; None where it is at none, or at 0, which is physical."""
    part = scaled(value, move)
    if part >= 1 - AT_BOUND:
        return replace(move, upper=factor * move.upper)
    if part <= AT_BOUND and move.lower > 0:
        return replace(move, lower=move.lower / factor)
    return None


# --- Which fixed quantities are released because a limit is active; the targets alone are too insensitive to them.

ACTIVE_FROM = 0.999  # of a limit: from this demand on it shapes the solution


def needed_to_keep(case: Case, free: Sequence[Move], asked: Demands) -> dict[str, str]:
    """Names of fixed moves, each with a limit on it that no setting of the free ones keeps."""
    out_of_reach = {limit for _, limit, _, _ in unkept(case, free, asked)}
    names = {name for move in free for name in move.together}
    for limit in [exceeded.limit for exceeded in asked.broken(_of_rig(case))]:
        if not names & asked.quantities(limit):
            out_of_reach.add(limit)
    return _fixed_behind(case, free, asked, out_of_reach)


def needed_for_more(case: Case, free: Sequence[Move], asked: Demands, tuned: Case) -> dict[str, str]:
    """Names of fixed moves, each with a limit on it that shapes the solution."""
    binding = {exceeded.limit for exceeded in asked.broken(_of_rig(tuned), ACTIVE_FROM)}
    return _fixed_behind(case, free, asked, binding)


def _of_rig(case: Case) -> dict[str, float]:
    return {f"rig.{name}": quantity.value for name, quantity in case.rig.parameters.items()}


def _fixed_behind(case: Case, free: Sequence[Move], asked: Demands, limits: set[str]) -> dict[str, str]:
    released: dict[str, str] = {}
    for limit in sorted(limits):
        behind = asked.quantities(limit)
        for move in case.moves:
            if move not in free and behind & set(move.together):
                released.setdefault(move.name, limit)
    return released


# --- Whether vehicle and rig may be linearised where they are: dry friction has to slide, a lash has to be loaded.

SLIDING_FROM = 0.5  # rad/s: below it friction may stick within the motion of a mode
COUNTED_FROM_STANDSTILL = ("dynamometer_speed", "dynamometer_power", TORQUE_OVER_SPEED)  # without an operating point
LOADED_FROM = 1e-3  # N·m: a lash that carries less is open or on the edge
CURE = 'state an operating point in motion under load, e.g. [operating_point] vehicle_speed = "30 km/h"'


def check_sliding(case: Case) -> None:
    """Refuse dry friction that sticks at the operating point: its linear model would clamp the inertia to ground."""
    for system in (case.vehicle, case.rig):
        speeds = speeds_of(system)
        for effect in system.effects:
            name = _sliding_inertia(system, effect.at)
            if effect.law.sticks and abs(speeds.get(name, 0.0)) < SLIDING_FROM:
                at = "at standstill" if system.operating_point is None else f"at {speeds[name]:.2g} rad/s"
                raise InputError(
                    f"{case.path}: operating_point",
                    f"the dry friction of {effect.at} sticks {at}: no linear model holds",
                    CURE,
                )


def _sliding_inertia(system: System, at: str) -> str:
    """The inertia whose motion dry friction at a place opposes: of a shaft or gear, its second end."""
    table, name = at.split(".")[:2]
    parts: Sequence[Shaft | Gear] = system.shafts if table == "shafts" else system.gears if table == "gears" else ()
    return next((part.between[1] for part in parts if part.name == name), name)


def unloaded_lashes(case: Case) -> list[str]:
    """A sentence for every lash that nothing loads where the models are linearised, which takes it as closed."""
    where: dict[str, str] = {}
    for system in (case.vehicle, case.rig):
        torques = _shaft_torques(system)
        at = "standstill" if system.operating_point is None else "the operating point"
        where |= {place: at for place in system.free_plays if abs(torques[place]) < LOADED_FROM}
    return [
        f"the lash of {place} is open at {at}, and the linear models take it as closed: what is said of modes and "
        f"responses holds for a loaded shaft alone; {CURE}"
        for place, at in where.items()
    ]


def opened_lashes(case: Case, traces: Traces | None) -> list[str]:
    """A sentence for every loaded lash that the simulated manoeuvre opens."""
    if traces is None or case.rig.operating_point is None:
        return []
    opened = []
    for place in case.rig.free_plays:
        torque = traces.absolute(f"{place}.torque")
        closed = torque * np.sign(torque[0]) > 0
        if not closed.all():
            first = traces.time[int(np.argmin(closed))]
            opened.append(
                f"the manoeuvre opens the lash of {place} after {first:.3g} s: the controller's models have it closed, "
                "vehicle and rig are simulated with it"
            )
    return opened


def _shaft_torques(system: System) -> dict[str, float]:
    model, about = compiled(system), operating_motion(system)
    torques = model.shaft_torques(about.state, about.inputs, model.p0).full().ravel()
    return {f"shafts.{shaft.name}": float(torque) for shaft, torque in zip(system.shafts, torques, strict=True)}


def standstill(case: Case) -> list[str]:
    """That limits count from standstill, where the case has such limits and no operating point."""
    counted = [name for name in COUNTED_FROM_STANDSTILL if name in case.limits]
    if case.vehicle.operating_point is not None or not counted:
        return []
    return [
        "the case states no [operating_point], so standstill is assumed: the manoeuvre is held against "
        f"{', '.join(counted)} from there; at speed the dynamometers need more"
    ]


# --- What a match is asked for, worked out once from its case, and what the search may spend on it.

SAME_VALUE = 1e-9  # relative: so near two values of a file are one

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Question:
    """A case with what follows from it.

    Attributes
    ----------
    targets : list of (Mode, Mode)
        Each target mode of the vehicle, undamped and damped.
    on_rig : sequence of Mode or None
        The rig's mode that corresponds to each.
    shares : ndarray (moves,)
        Largest share of each move in the energy of a target mode.
    demands : Demands
        What the vehicle's manoeuvre asks of adapters and dynamometers.
    """

    case: Case
    targets: list[tuple[Mode, Mode]]
    on_rig: Sequence[Mode | None]
    shares: np.ndarray
    demands: Demands


@dataclass(frozen=True)
class SearchEffort:
    """Seed of the random starts, most of them, processes, whom to tell, and solutions to start from instead.

    With ``ordering`` adapters that gain nothing stay as planned.
    """

    seed: int
    starts: int
    workers: int
    tell: Progress
    near: Near | None
    ordering: bool


def question_of(case: Case) -> Question:
    """Work out targets, weights and demands."""
    on_rig = counterparts(case)
    return Question(case, target_modes(case), on_rig, shares_of(case, modes(case.vehicle), on_rig), demands(case))


def differing_components(case: Case) -> list[str]:
    """A sentence for every shared quantity whose values differ, largest ratio first."""
    vehicle, rig = case.vehicle.parameters, case.rig.parameters
    differing = []
    for name in rig:
        if name not in vehicle:
            continue
        here, there = rig[name].value, vehicle[name].value
        off = abs(here - there) / max(abs(here), abs(there), 1e-300)
        if off > SAME_VALUE:
            unit = case.rig.units[name]
            words = (
                f"{name} is {there:g} {unit} in the vehicle and {here:g} {unit} on the rig: "
                "a component that both have under one name is the same hardware, so the two should agree"
            )
            differing.append((-off, words))
    return [words for _, words in sorted(differing)]


# --- Solving a case and verifying it; again where a limit needs a released quantity, or the simulation takes more.

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


# --- Targets met

SIMULATED_FREQUENCY_TOLERANCE = 0.02  # relative, between the vehicle's frequency and what the simulated rig shows


def reached(
    frequency: float, damping_ratio: float, wanted: Mode, frequency_tolerance: float, damping_tolerance: float
) -> bool:
    """Whether a mode at a frequency (Hz) is within the tolerances: relative in frequency, absolute in damping ratio."""
    return (
        abs(frequency / wanted.frequency - 1) <= frequency_tolerance
        and abs(damping_ratio - wanted.damping_ratio) <= damping_tolerance
    )


def target_results(question: Question, checked: Verification) -> tuple[TargetResult, ...]:
    """Every target with what the closed loop and the simulation show of it."""
    return tuple(_target(question, checked, number) for number in range(len(question.targets)))


def _target(question: Question, checked: Verification, number: int) -> TargetResult:
    wanted, target = question.targets[number][1], question.case.targets[number]
    mode, on_rig = checked.targets[number].mode, question.on_rig[number]
    simulated = checked.identified[number].matched
    met = (
        mode is not None and simulated is not None
        and reached(mode.frequency, mode.damping_ratio, wanted, target.frequency_tolerance, target.damping_tolerance)
        and reached(
            simulated.frequency, simulated.damping_ratio, wanted,
            SIMULATED_FREQUENCY_TOLERANCE, target.damping_tolerance,
        )
    )  # fmt: skip
    return TargetResult(
        vehicle_mode=target.mode,
        symmetry=wanted.symmetry,
        vehicle=wanted.frequency,
        vehicle_damping=wanted.damping_ratio,
        rig=None if on_rig is None else on_rig.frequency,
        matched=None if mode is None else mode.frequency,
        matched_damping=None if mode is None else mode.damping_ratio,
        identified=None if simulated is None else simulated.frequency,
        identified_damping=None if simulated is None else simulated.damping_ratio,
        met=met,
    )
