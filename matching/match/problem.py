"""What a match is asked for, and whether targets are met: in the closed loop and in the simulation."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from matching.match.case import Case, Move, unscaled
from matching.match.demands import Demands, ExceededLimit, demands, rig_values
from matching.match.movable import changed_by, with_sizes
from matching.match.requirements import TORQUE_OVER_SPEED
from matching.match.result import TargetResult
from matching.match.targets import on_rig, released_moves, shares_of, target_modes
from matching.match.verify import Traces, Verification
from modelling.equations.casadi_code import compiled
from modelling.errors import InputError
from modelling.linear.steady_motion import operating_motion, speeds_of
from modelling.modal.modes import modes
from modelling.modal.result import Mode
from modelling.system import Gear, Shaft, System

# --- What a match is asked for, worked out once from its case.

SAME_VALUE = 1e-9  # relative: so near two values of a file are one

Progress = Callable[[str], None]


@dataclass(frozen=True)
class MatchProblem:
    """A case with what follows from it.

    Attributes
    ----------
    targets : list of (Mode, Mode)
        Each target mode of the vehicle, undamped and damped.
    on_rig : sequence of Mode or None
        The mode of the rig without control that corresponds to each.
    shares : dict of str to float
        Largest share of each move in the energy of a target mode, by name.
    demands : Demands
        What the vehicle's manoeuvre asks of adapters and dynamometers.
    moves : tuple of Move
        What is released: by its share, or because a limit takes it.
    released : dict of str to str
        Of these, what moves for a limit's sake alone, with that limit.
    beyond : list of ExceededLimit
        Limits that no setting keeps, at the setting that breaks them least.
    """

    case: Case
    targets: list[tuple[Mode, Mode]]
    on_rig: Sequence[Mode | None]
    shares: Mapping[str, float]
    demands: Demands
    moves: tuple[Move, ...]
    released: Mapping[str, str]
    beyond: list[ExceededLimit]


def problem_of(case: Case) -> MatchProblem:
    """Work out targets, weights, demands and what is released."""
    rig_modes, asked = on_rig(case), demands(case)
    shares = shares_of(case, modes(case.vehicle), rig_modes)
    moving = released_moves(case, shares)
    released = needed_to_keep(case, moving, asked)
    moves = tuple(move for move in case.moves if move in moving or move.name in released)
    return MatchProblem(
        case, target_modes(case), rig_modes,
        dict(zip((move.name for move in case.moves), shares.tolist(), strict=True)), asked, moves, released,
        infeasible_limits(case, moves, asked),
    )  # fmt: skip


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


# --- Limits that the manoeuvre breaks whatever the moves are, and fixed quantities that are released for a limit.

SPREAD = 256  # settings of the rig at which the demands are looked at, and all corners
CORNERS = 8  # quantities up to which all corners are looked at


def infeasible_limits(case: Case, moves: Sequence[Move], asked: Demands) -> list[ExceededLimit]:
    """Limits that the vehicle's manoeuvre breaks whatever the moves are, at the setting that breaks them least.

    The demands are convex in the inertias and fall with stiffness: the least of settings spread over the bounds and of
    their corners is the beginning of a descent without derivatives (Nelder and Mead 1965).
    """
    of_rig = [move for move in moves if move.name.startswith("rig.")]
    planned = rig_values(case)

    def values(at: np.ndarray) -> dict[str, float]:
        parts = zip(of_rig, np.clip(at, 0, 1).tolist(), strict=True)
        moved = {name: float(unscaled(part, move)) for move, part in parts for name in move.together}
        return planned | with_sizes(case.rig, moved)

    def worst(at: np.ndarray) -> float:
        return float(asked.shares(values(at)).max(initial=0.0))

    if worst(np.full(len(of_rig), 0.5)) <= 1 or not asked.broken(planned):
        return []
    if not of_rig:
        return asked.broken(planned)
    tried = scipy.stats.qmc.Sobol(len(of_rig), seed=0).random(SPREAD)
    if len(of_rig) <= CORNERS:
        corners = np.array(np.meshgrid(*[[0.0, 1.0]] * len(of_rig))).reshape(len(of_rig), -1).T
        tried = np.vstack([tried, corners])
    best = min(tried, key=worst)
    found = scipy.optimize.minimize(worst, best, method="Nelder-Mead", bounds=[(0, 1)] * len(of_rig)).x
    best = min((best, found), key=worst)
    return [] if worst(best) <= 1 else asked.broken(values(best))


def needed_to_keep(case: Case, free: Sequence[Move], asked: Demands) -> dict[str, str]:
    """Names of fixed moves, each with a limit on it that no setting of the free ones keeps."""
    planned = rig_values(case)
    out_of_reach = {limit for _, limit, _, _ in infeasible_limits(case, free, asked)}
    names = changed_by(case.rig, [name for move in free for name in move.together])
    for limit in [exceeded.limit for exceeded in asked.broken(planned)]:
        if not names & asked.quantities(limit, planned):
            out_of_reach.add(limit)
    released: dict[str, str] = {}
    for limit in sorted(out_of_reach):
        behind = asked.quantities(limit, planned)
        for move in case.moves:
            if move not in free and behind & changed_by(case.rig, move.together):
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


def long_sample(case: Case) -> list[str]:
    """That the controller's sample is longer than a dead time: then a shorter sample gains what a machine cannot."""
    step, loop = case.loop["sample_time"], case.loop
    shortest = min(loop["dead_time"] if one.dead_time is None else one.dead_time for one in loop.dynamometers)
    if loop.torqueless or step <= shortest:
        return []
    return [
        f"the sample time, {1e3 * step:.3g} ms, is longer than the dead time, {1e3 * shortest:.3g} ms: a command is "
        "held for longer than it is late, so a shorter sample time reduces the error more than a faster inverter"
    ]


# --- Targets met

SIMULATED_FREQUENCY_TOLERANCE = 0.02  # relative, between the frequency of the loop's mode and what its simulation shows


def reached(
    frequency: float, damping_ratio: float, wanted: Mode, frequency_tolerance: float, damping_tolerance: float
) -> bool:
    """Whether a mode at a frequency (Hz) is within the tolerances: relative in frequency, absolute in damping ratio."""
    return (
        abs(frequency / wanted.frequency - 1) <= frequency_tolerance
        and abs(damping_ratio - wanted.damping_ratio) <= damping_tolerance
    )


def confirmed(frequency: float, damping_ratio: float, of_loop: float, wanted: Mode, damping_tolerance: float) -> bool:
    """Whether a simulation shows the loop's mode (both frequencies in Hz), and damped as ``wanted``."""
    return (
        abs(frequency / of_loop - 1) <= SIMULATED_FREQUENCY_TOLERANCE
        and abs(damping_ratio - wanted.damping_ratio) <= damping_tolerance
    )


def target_results(problem: MatchProblem, checked: Verification) -> tuple[TargetResult, ...]:
    """Every target with what the closed loop and the simulation show of it."""
    return tuple(_target(problem, checked, number) for number in range(len(problem.targets)))


def _target(problem: MatchProblem, checked: Verification, number: int) -> TargetResult:
    wanted, target = problem.targets[number][1], problem.case.targets[number]
    mode, on_rig = checked.targets[number].mode, problem.on_rig[number]
    simulated = checked.identified[number].matched
    met = (
        mode is not None and simulated is not None
        and reached(mode.frequency, mode.damping_ratio, wanted, target.frequency_tolerance, target.damping_tolerance)
        and confirmed(simulated.frequency, simulated.damping_ratio, mode.frequency, wanted, target.damping_tolerance)
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
