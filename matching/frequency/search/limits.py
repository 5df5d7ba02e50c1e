"""What stands in the way of a match, in an engineer's words, most binding first."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import brentq

from matching.frequency.case.case import Case
from matching.frequency.case.demands import Demands
from matching.frequency.case.load_limits import TORQUE_OVER_SPEED
from matching.frequency.search.infeasible_limits import DeadTimeTrial, Unkept
from matching.frequency.search.result import TargetResult
from matching.frequency.search.shared_components import differing_components
from matching.frequency.solver.task import Solution
from matching.frequency.verification.peaks import Violation
from matching.frequency.verification.verify import Verification
from modelling.modal.modes import Mode, modes

_WORDS = {
    "dynamometer_torque": ("torque", "N·m"),
    "dynamometer_speed": ("speed", "rad/s"),
    "dynamometer_power": ("power", "W"),
    TORQUE_OVER_SPEED: ("share of the torque at its speed", ""),
}


def limits(
    case: Case, tuned: Case, checked: Verification, targets: Sequence[TargetResult], asked: Demands, solution: Solution,
    on_rig: Sequence[Mode | None], beyond: Sequence[Unkept] = (), trial: DeadTimeTrial | None = None,
) -> list[str]:  # fmt: skip
    """Sentences on what stands in the way; none if the match is good.

    ``beyond`` are limits that no setting keeps, ``trial`` are shorter dead times that were solved, if any were.
    """
    found = [*differing_components(case), *(_beyond(*one) for one in _worst(beyond))]
    shared = len(differing_components(case))
    if not checked.stable:
        failed = ", ".join(name for name, good in checked.checks.items() if not good)
        starts = f"none of {len(solution.starts)} starts ended in a stable loop within the bounds"
        found.append(f"the closed loop is not stable ({failed}): {starts}")
    found += [f"two methods disagree, so neither is believed: {difference}" for difference in checked.disagreements]
    missed = [target for target in targets if not target.met]
    if checked.stable and not solution.feasible and (missed or checked.violations):
        found.append(
            f"no setting within the bounds was found that keeps a modulus margin of {case.limits['modulus_margin']:g}, "
            f"a damping ratio of {case.limits['damping_ratio']:g} and the limits together; the values shown are where "
            f"the search began, with a margin of {checked.modulus_margin:.2f}"
        )
    for target in missed:
        found.append(_missed(case, target))
    if missed:
        found += _mechanics(case, missed, on_rig, asked)
        found += _dead_time(case, tuned, missed, trial)
    told = {name for _, name, _, _ in beyond}
    found += [_violation(own) for own in checked.violations if own.limit not in told]
    told |= {own.limit for own in checked.violations}
    asking = asked.broken({f"rig.{name}": own.value for name, own in tuned.rig.parameters.items()})
    found += [_asks(*one) for one in _worst(asking) if one[1] not in told]
    return found if len(found) > shared else []


def _worst(broken: Sequence[Unkept]) -> list[Unkept]:
    """One of each limit, the worst, which comes first."""
    return list({limit: (dyno, limit, demand, allowed) for dyno, limit, demand, allowed in reversed(broken)}.values())[
        ::-1
    ]


def _beyond(dyno: str, limit: str, demand: float, allowed: float) -> str:
    """A limit that no setting keeps, with the least that would do."""
    return _asks(dyno, limit, demand, allowed) + "; no setting within the bounds needs less"


def _asks(dyno: str, limit: str, demand: float, allowed: float) -> str:
    return (
        f"to move as the vehicle does, the manoeuvre takes {_named(limit, dyno)} of {_with_unit(limit, demand)}, "
        f"{_with_unit(limit, allowed)} is the limit: it would have to be {demand / allowed:.2f} times as large, "
        f"or the manoeuvre {allowed / demand:.0%} of what it is"
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
    if target.seen is None:
        return words + (
            ", and cannot be read off the simulation: it is moved too little, or dies away before it can be told apart"
        )
    return words + f"; the simulation shows {target.seen:.3f} Hz with {target.seen_damping:.3f}"


def _violation(own: Violation) -> str:
    if own.limit == "modulus_margin":
        return f"the modulus margin is {own.value:.2f}, {own.allowed:.2f} is wanted"
    if own.limit == "damping_ratio":
        return f"the least damped {own.where} has a damping ratio of {own.value:.4f}, {own.allowed:g} is wanted"
    value, allowed = (_with_unit(own.limit, one) for one in (own.value, own.allowed))
    what = f"{_WORDS[own.limit][0]} " if own.limit in _WORDS else ""
    ratio = f"{own.value / own.allowed:.2f} times the limit"
    return f"{own.where}: the simulated manoeuvre takes {what}{value}, {ratio} of {allowed}"


def _mechanics(case: Case, missed: Sequence[TargetResult], on_rig: Sequence[Mode | None], asked: Demands) -> list[str]:
    """What adapters or inertias alone would have to be, where adapters are what may move."""
    if any(move.name.startswith(("loop.", "residual_vehicle.")) for move in case.moves):
        return []
    number = {target.mode: i for i, target in enumerate(case.targets)}
    found = []
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
            found.append(
                f"no adapter within the bounds does it: {target.vehicle:.3f} Hz would take {', or '.join(parts)}; "
                "a residual vehicle model has to supply the inertia"
            )
    return found


def _plain(value: float) -> str:
    """Three digits without a power of ten."""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def _needed(case: Case, names: list[str], mode: Mode, wanted: float, low: float, high: float) -> float | None:
    """Common factor on quantities of the rig that brings its lowest elastic mode of one symmetry to a frequency."""
    own = {name: case.rig.parameters[name].value for name in names}

    def off(exponent: float) -> float:
        found = modes(case.rig, {name: value * 10**exponent for name, value in own.items()})
        lowest = next(each.frequency for each in found if each.frequency > 0 and each.symmetry == mode.symmetry)
        return lowest - wanted

    ends = np.log10(low), np.log10(high)
    if not own or off(ends[0]) * off(ends[1]) > 0:
        return None
    return float(10 ** brentq(off, *ends, xtol=1e-6))


def _dead_time(case: Case, tuned: Case, missed: Sequence[TargetResult], trial: DeadTimeTrial | None) -> list[str]:
    """The phase that dead time and lags take at the targets, and what shorter dead times did when they were solved."""
    loop = tuned.loop
    if loop.torqueless or not any(move.name.startswith(("loop.", "residual_vehicle.")) for move in case.moves):
        return []
    cure = ""
    if trial is not None and trial.sufficient is not None:
        cure = f"solved with {1e3 * trial.sufficient:.2g} ms, every target is met"
    elif trial is not None:
        cure = f"solved with one sample, {1e3 * trial.shortest:.3g} ms, the targets are not met either"
        if advice := loop.structure.cure(case.limits["modulus_margin"]):
            cure += f": {advice}"
    found = []
    for target in missed:
        omega = 2 * np.pi * target.vehicle
        late = np.degrees(omega * loop["dead_time"])
        lags = np.degrees(np.arctan(omega * loop["inverter_lag"]) + np.arctan(omega * loop["torque_sensor_lag"]))
        delay = f"dead time {1e3 * loop['dead_time']:.3g} ms"
        found.append(f"{delay} leaves {late:.0f}° at {target.vehicle:.2f} Hz and the lags {lags:.0f}°")
    if cure:
        found[-1] += f"; {cure}"
    return found
