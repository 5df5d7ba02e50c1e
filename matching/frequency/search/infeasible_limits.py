"""By how much what stands in the way would have to give."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from matching.frequency.case.case import Case, Move, Target
from matching.frequency.case.demands import Demands, ExceededLimit
from matching.frequency.case.tuned import apply
from matching.frequency.loop.encirclements import encirclements
from matching.frequency.loop.loop_modes import LoopMode, feedback_modes, match_mode
from matching.frequency.loop.parts import parts_of
from matching.frequency.programme.ipopt import solved
from matching.frequency.programme.scaling import scaled, unscaled
from matching.frequency.solver.solve import warm
from matching.frequency.solver.task import Solution, TuningTask
from modelling.modal.result import Mode

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

    Each is solved anew from the solution and from a gentler loop, and judged by margin, encirclements and poles.
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
    parts = parts_of(apply(case, solved.values))
    winding = encirclements(parts)
    if winding.unstable or not winding.clear or winding.modulus_margin < case.limits["modulus_margin"]:
        return False
    loop_modes = feedback_modes(parts)
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
