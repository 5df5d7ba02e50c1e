"""What stands in the way of a match, in an engineer's words, most binding first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy

from matching.match.attempt import (
    DeadTimeTrial,
    Question,
    VerifiedSolution,
    differing_components,
    shorter_dead_times,
    target_results,
    task_of,
    wider_bounds,
)
from matching.match.case import TORQUE_OVER_SPEED, Case, ExceededLimit, Move, apply
from matching.match.result import ResponseError, TargetResult
from matching.match.solve import Solution, warm
from matching.match.verify import Violation, verify
from modelling.bed.controllers import ModelBased
from modelling.modal.modes import modes
from modelling.modal.result import Mode
from modelling.units import printed

# --- What would do: relaxations that were solved and verified. What is not found here is not named to anybody.

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


# --- Limits

_WORDS = {
    "dynamometer_torque": ("torque", "N·m"),
    "dynamometer_speed": ("speed", "rad/s"),
    "dynamometer_power": ("power", "W"),
    TORQUE_OVER_SPEED: ("share of the torque at its speed", ""),
}


def limits(
    question: Question, solution: VerifiedSolution, targets: Sequence[TargetResult], relaxed: Relaxations
) -> list[str]:
    """Sentences on what stands in the way; none if the match is good.

    What is said to help is what ``relaxed`` holds, which was solved.
    """
    case, checked, asked = question.case, solution.checked, question.demands
    shared = differing_components(case)
    said = [*shared, *_beyond(solution.beyond, relaxed)]
    said += _loop(solution, case)
    missed = [target for target in targets if not target.met]
    said += [_missed(case, target) for target in missed]
    if missed:
        said += _mechanics(question, missed)
        said += [*_bounds(relaxed), *_delay(question, missed, relaxed)]
    mentioned = {exceeded.limit for exceeded in solution.beyond}
    said += [_violation(violation) for violation in checked.violations if violation.limit not in mentioned]
    mentioned |= {violation.limit for violation in checked.violations}
    asking = asked.broken({f"rig.{name}": quantity.value for name, quantity in solution.tuned.rig.parameters.items()})
    said += [_asks(*demand) for demand in _worst(asking) if demand.limit not in mentioned]
    return said if len(said) > len(shared) else []


def led_by_dead_time(stands: list[str], case: Case, error: ResponseError) -> list[str]:
    """The sentences, led by what dead time and sampling leave with every torque measured, where that is too much."""
    if not stands or min(error.bound, error.after) <= case.tolerance:
        return stands
    alone = (
        f"with every torque measured, dead time and sampling alone leave a response error of {error.bound:.2g}, "
        f"{case.tolerance:g} is allowed"
    )
    return [alone, *stands]


def _loop(verified: VerifiedSolution, case: Case) -> list[str]:
    """What is wrong with the loop as a whole."""
    said, checked, solution = [], verified.checked, verified.solution
    if not checked.stable:
        failed = ", ".join(name for name, good in checked.checks.items() if not good)
        starts = f"none of {len(solution.starts)} starts ended in a stable loop within the bounds"
        if solution.blind is not None:
            starts += f", and {solution.blind[1] or 'none'} of {solution.blind[0]} settings drawn over them is stable"
        said.append(f"the closed loop is not stable ({failed})" + ("" if solution.feasible else f": {starts}"))
    if checked.stable and not solution.feasible:
        said.append(
            f"the search found no setting within the bounds that keeps a modulus margin of "
            f"{case.limits['modulus_margin']:g}, a damping ratio of {case.limits['damping_ratio']:g} and the limits "
            f"together; the values shown are {_shown(solution)}, with a margin of {checked.modulus_margin:.2f}"
        )
    return said


def _shown(solution: Solution) -> str:
    if solution.blind is None or not solution.blind[1]:
        return "where it began"
    return f"the best of {solution.blind[1]} stable ones among {solution.blind[0]} drawn over the bounds"


def _worst(broken: Sequence[ExceededLimit]) -> list[ExceededLimit]:
    """One of each limit, the worst, which comes first."""
    return list({exceeded.limit: exceeded for exceeded in reversed(broken)}.values())[::-1]


def _beyond(broken: Sequence[ExceededLimit], relaxed: Relaxations) -> list[str]:
    """Limits that no setting keeps, and the values with which the targets are met, if they are."""
    said = []
    for dyno, limit, demand, allowed in _worst(broken):
        said.append(f"{_asks(dyno, limit, demand, allowed)}; no setting within the bounds needs less")
        if limit in relaxed.limits:
            value = relaxed.limits[limit]
            said[-1] += (
                f"; solved with {_with_unit(limit, value)}, {value / allowed:.2f} times as large, every target is met"
            )
    if len(relaxed.limits) > 1:
        said[-1] += " (all of these together)"
    return said


def _asks(dyno: str, limit: str, demand: float, allowed: float) -> str:
    return (
        f"to move as the vehicle does, the manoeuvre takes {_named(limit, dyno)} of {_with_unit(limit, demand)}, "
        f"{_with_unit(limit, allowed)} is the limit"
    )


def _named(limit: str, dyno: str) -> str:
    if limit in _WORDS:
        return f"a {_WORDS[limit][0]} at dynamometer {dyno}"
    shaft, _, what = limit.removeprefix("shafts.").rpartition(".")
    return f"a {what} in {shaft}"


def _with_unit(limit: str, value: float) -> str:
    if limit in _WORDS:
        return f"{value:.4g} {_WORDS[limit][1]}".rstrip()
    return f"{value:.4g} N·m" if limit.endswith("torque") else f"{np.degrees(value):.3g}°"


def _missed(case: Case, target: TargetResult) -> str:
    mode, damping = target.vehicle_mode, target.vehicle_damping
    wanted = f"mode {mode} ({target.vehicle:.3f} Hz, damping ratio {damping:.3f}, {target.symmetry})"
    if target.matched is None or target.matched_damping is None:
        undone = target.rig or float("nan")
        return f"{wanted}: the closed loop has no such mode; with nothing done the rig shows it at {undone:.2f} Hz"
    words = f"{wanted} is reached at {target.matched:.3f} Hz with damping ratio {target.matched_damping:.3f}"
    if target.identified is None:
        return words + (
            ", and cannot be read off the simulation: it is moved too little, or dies away before it can be told apart"
        )
    return words + f"; the simulation shows {target.identified:.3f} Hz with {target.identified_damping:.3f}"


def _violation(violation: Violation) -> str:
    if violation.limit == "modulus_margin":
        return f"the modulus margin is {violation.value:.2f}, {violation.allowed:.2f} is wanted"
    if violation.limit == "damping_ratio":
        least = f"{violation.value:.4f}, {violation.allowed:g} is wanted"
        return f"the least damped {violation.where} has a damping ratio of {least}"
    value, allowed = (
        _with_unit(violation.limit, number_in_si) for number_in_si in (violation.value, violation.allowed)
    )
    what = f"{_WORDS[violation.limit][0]} " if violation.limit in _WORDS else ""
    ratio = f"{violation.value / violation.allowed:.2f} times the limit"
    return f"{violation.where}: the simulated manoeuvre takes {what}{value}, {ratio} of {allowed}"


def _mechanics(question: Question, missed: Sequence[TargetResult]) -> list[str]:
    """What adapters or inertias alone would have to be, where adapters are what may move."""
    case, on_rig, asked = question.case, question.on_rig, question.demands
    if any(move.name.startswith(("loop.", "residual_vehicle.")) for move in case.moves):
        return []
    number = {target.mode: i for i, target in enumerate(case.targets)}
    sentences = []
    for target in missed:
        mode = on_rig[number[target.vehicle_mode]]
        if mode is None:
            continue
        parts = []
        peak = max((float(np.abs(chain.torque).max()) for chain in asked.chains), default=0.0)
        limit = max(
            (value for key, value in case.limits.items() if key.startswith("shafts.") and key.endswith(".torque")),
            default=peak,
        )
        chains = [chain for chain in asked.chains if chain.shafts]
        shafts = sorted({name for chain in chains for name, _ in chain.shafts[-1:]})
        if stiffness := _needed(case, [f"shafts.{name}.stiffness" for name in shafts], mode, target.vehicle, 1e-6, 1.0):
            value = stiffness * case.rig.parameters[f"shafts.{shafts[0]}.stiffness"].value
            twist = limit / value
            turned = f"{np.degrees(twist):.0f}° ({twist / (2 * np.pi):.1f} turns) at {limit:.0f} N·m"
            parts.append(f"{_plain(value)} N·m/rad in {' and '.join(shafts)}, which twists {turned}")
        masses = sorted({name for chain in chains for name in chain.inertias})
        if inertia := _needed(case, [f"inertias.{name}.J" for name in masses], mode, target.vehicle, 1.0, 1e5):
            behind = sum(case.rig.parameters[f"inertias.{name}.J"].value for name in chains[0].inertias)
            instead = f"{_plain(inertia * behind)} kg·m² instead of {_plain(behind)}"
            parts.append(f"{inertia:.0f} times the inertia behind each cut, {instead}")
        elif parts:
            parts[-1] += ", and no inertia behind the cuts, however large, does it alone"
        if parts:
            sentences.append(
                f"no adapter within the bounds does it: {target.vehicle:.3f} Hz would take {', or '.join(parts)}; "
                "a residual vehicle model has to supply the inertia"
            )
    return sentences


def _plain(value: float) -> str:
    """Three digits without a power of ten."""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def _needed(case: Case, names: list[str], mode: Mode, wanted: float, low: float, high: float) -> float | None:
    """Common factor on quantities of the rig that brings its lowest elastic mode of one symmetry to a frequency."""
    inertias = {name: case.rig.parameters[name].value for name in names}

    def off(exponent: float) -> float:
        with_change = modes(case.rig, {name: value * 10**exponent for name, value in inertias.items()})
        lowest = next(each.frequency for each in with_change if each.frequency > 0 and each.symmetry == mode.symmetry)
        return lowest - wanted

    ends = np.log10(low), np.log10(high)
    if not inertias or off(ends[0]) * off(ends[1]) > 0:
        return None
    return float(10 ** scipy.optimize.brentq(off, *ends, xtol=1e-6))


def _bounds(relaxed: Relaxations) -> list[str]:
    """Bounds of the case beyond which the targets were met."""
    if not relaxed.bounds:
        return []
    values = []
    for move, value in relaxed.bounds:
        bound = f"{move.upper:.4g} is the largest" if value > move.upper else f"{move.lower:.4g} is the smallest"
        unit = "" if move.unit == "1" else f" {printed(move.unit)}"
        values.append(f"{move.name} at {value:.4g}{unit} ({bound} allowed)")
    return [f"bounds under [move] stand in the way: solved with {' and '.join(values)}, every target is met"]


def _delay(question: Question, missed: Sequence[TargetResult], relaxed: Relaxations) -> list[str]:
    """Dead time and lags where a shorter dead time meets the targets, else what else was seen to meet them."""
    loop, trial, said = question.case.loop, relaxed.dead_time, []
    if trial is not None and trial.sufficient is not None:
        for target in missed:
            omega = 2 * np.pi * target.vehicle
            late = np.degrees(omega * loop["dead_time"])
            lags = np.degrees(np.arctan(omega * loop["inverter_lag"]) + np.arctan(omega * loop["torque_sensor_lag"]))
            delay = f"dead time {1e3 * loop['dead_time']:.3g} ms"
            said.append(f"{delay} leaves {late:.0f}° at {target.vehicle:.2f} Hz and the lags {lags:.0f}°")
        said[-1] += f"; solved with {1e3 * trial.sufficient:.2g} ms, every target is met"
    elif trial is not None:
        said.append(
            f"a shorter dead time alone does not help: solved with one sample, {1e3 * trial.shortest:.3g} ms, the "
            "targets are not met either"
        )
    if relaxed.structure:
        said.append(
            f'with structure = "{relaxed.structure}" and every torque on the rig measured, the values shown meet '
            f"{len(question.case.targets)} of {len(question.case.targets)} targets (verified)"
        )
    return said
