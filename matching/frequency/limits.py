"""What stands in the way of a match, in an engineer's words, most binding first."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import brentq

from matching.frequency.case import Case
from matching.frequency.demands import Demands
from matching.frequency.result import TargetResult
from matching.frequency.solve import Solution
from matching.frequency.verification.verify import Verification
from modelling.modes import Mode, modes

_WORDS = {
    "dynamometer_torque": ("torque", "N·m"),
    "dynamometer_speed": ("speed", "rad/s"),
    "dynamometer_power": ("power", "W"),
}


def limits(
    case: Case, tuned: Case, checked: Verification, targets: Sequence[TargetResult], asked: Demands, solution: Solution,
    on_rig: Sequence[Mode | None],
) -> list[str]:  # fmt: skip
    """Sentences on what stands in the way; none if the match is good."""
    found: list[str] = []
    if not checked.stable:
        failed = ", ".join(name for name, good in checked.checks.items() if not good)
        found.append(f"the closed loop is not stable ({failed}): no start led to a stable loop within the bounds")
    elif not solution.feasible:
        found.append(
            "no setting within the bounds keeps the margins and limits together; "
            "the values shown are where the search began"
        )
    missed = [target for target in targets if not target.met]
    for target in missed:
        found.append(_missed(case, target))
    if missed:
        found += _mechanics(case, missed, on_rig, asked)
        found += _dead_time(case, tuned, missed, checked)
    found += [_violation(case, own.limit, own.where, own.value, own.allowed) for own in checked.violations]
    told = {own.limit for own in checked.violations}
    for dyno, name, demand, allowed in asked.broken({f"rig.{key}": q.value for key, q in tuned.rig.parameters.items()}):
        if name not in told:
            found.append(
                f"the vehicle's own manoeuvre asks for more than {name} allows at the {dyno} dynamometer: "
                f"{demand:.4g} against {allowed:.4g}"
            )
    return found


def _missed(case: Case, target: TargetResult) -> str:
    mode, damping = target.vehicle_mode, target.vehicle_damping
    wanted = f"mode {mode} ({target.vehicle:.3f} Hz, damping ratio {damping:.3f}, {target.symmetry})"
    if target.matched is None or target.matched_damping is None:
        undone = target.rig or float("nan")
        return f"{wanted}: the closed loop has no such mode; with nothing done the rig shows it at {undone:.2f} Hz"
    words = f"{wanted} is reached at {target.matched:.3f} Hz with damping ratio {target.matched_damping:.3f}"
    if target.seen is None:
        return words + ", and the simulation does not show it: no torque that reaches the bed moves it visibly"
    return words + f"; the simulation shows {target.seen:.3f} Hz with {target.seen_damping:.3f}"


def _violation(case: Case, limit: str, where: str, value: float, allowed: float) -> str:
    if limit == "modulus_margin":
        return f"the modulus margin is {value:.2f}, {allowed:.2f} is wanted"
    if limit == "damping_ratio":
        return f"the least damped {where} has a damping ratio of {value:.4f}, {allowed:g} is wanted"
    enough = f"{value / allowed:.2f} times as much would do"
    if limit in _WORDS:
        word, unit = _WORDS[limit]
        asked = f"{where}: the manoeuvre takes a {word} of {value:.4g} {unit}"
    else:
        unit = "N·m" if limit.endswith("torque") else "rad"
        asked = f"{where} reaches {value:.4g} {unit} over the manoeuvre"
    return f"{asked}, the limit is {allowed:.4g} {unit}; {enough}"


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


def _dead_time(case: Case, tuned: Case, missed: Sequence[TargetResult], checked: Verification) -> list[str]:
    """What dead time and lags leave of the phase at the targets, and which dead time would do by the modal rule."""
    if not any(move.name.startswith(("loop.", "residual_vehicle.")) for move in case.moves):
        return []
    found = []
    for target in missed:
        loop, omega = tuned.loop, 2 * np.pi * target.vehicle
        late = np.degrees(omega * loop["dead_time"])
        lags = np.degrees(np.arctan(omega * loop["inverter_lag"]) + np.arctan(omega * loop["torque_sensor_lag"]))
        delay = f"dead time {1e3 * loop['dead_time']:.3g} ms"
        words = f"{delay} leaves {late:.0f}° at {target.vehicle:.2f} Hz and the lags {lags:.0f}°"
        if loop.structure == "pi":
            words += (
                f"; where feedback alone has to show a mode of damping ratio {target.vehicle_damping:.3f}, "
                "the sensitivity rises there as the damping falls, and a modulus margin of "
                f"{case.limits['modulus_margin']:g} does not allow it: "
                'structure = "model_based" takes the announced torques out of the feedback'
            )
        found.append(words)
    return found
