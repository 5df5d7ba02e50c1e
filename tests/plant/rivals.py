"""Which other causes a recording cannot tell from the hidden one, by what they leave over after refitting."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from plant.bench import Take, replay
from plant.calibrate import SPARSE, freedom, remainder, stacked
from plant.hidden import KINDS, SPOKEN, Hidden, known, places
from plant.scene import Scene, scaled
from plant.systems import Drive

# kinds that can look alike at one place; every kind also competes with itself at other places
ALIKE = [
    ("coulomb_friction", "stribeck_friction", "quadratic_drag", "constant_torque"),
    ("backlash", "hardening", "hysteresis", "slip", "compliance"),
    ("dead_time", "input_lag", "input_gain", "input_offset"),
    ("sensor_delay", "sensor_lag", "sensor_gain", "sensor_offset", "sensor_drift"),
]
# another kind is inseparable when the rival leaves less than this chi-square: the likelihood cannot part the two
INSEPARABLE = 20.0
# another place of the same kind already when it leaves this mean square (noise = 1): it errs by 1.025 times the noise
SAME_PLACE = 0.05


def candidates(drive: Drive, effect: Hidden) -> list[Hidden]:
    """The same kind at other places, other kinds of its group at its place; further ones are :func:`crossed`."""
    group = next((g for g in ALIKE if effect.kind in g), (effect.kind,))
    elsewhere = [at for at in places(drive, effect.kind) if at != effect.at]
    fitted = drive.tolerance if effect.kind != "parameter_drift" else {}  # an uncertain value is fitted
    same = [Hidden(effect.kind, at) for at in elsewhere if at not in fitted]
    if effect.kind == "input_offset":
        same.append(Hidden("constant_torque", f"inertias.{drive.inputs[effect.name]}"))
    if effect.kind == "geared_ripple":
        same.append(Hidden("torque_ripple", f"inertias.{effect.name}"))
    if effect.kind == "constant_torque":
        same += [Hidden("input_offset", f"inputs.{name}") for name, on in drive.inputs.items() if on == effect.name]
    return same + [Hidden(kind, effect.at) for kind in group if kind != effect.kind]


def crossed(drive: Drive, effect: Hidden, near: list[dict[str, str]]) -> list[Hidden]:
    """Other kinds at other places, both of which look alike by themselves."""
    said = {one["kind"] for one in near if one["at"] == effect.at}
    kinds = [kind for kind in KINDS if SPOKEN.get(kind, kind) in said and effect.at in places(drive, kind)]
    spoken = SPOKEN.get(effect.kind, effect.kind)
    where = [one["at"] for one in near if one["at"] != effect.at and one["kind"] == spoken]
    return [Hidden(kind, at) for kind in kinds for at in where if at in places(drive, kind)]


def separations(scene: Scene, effect: Hidden, others: list[Hidden], take: Take) -> list[dict[str, Any]]:
    """Each rival with the chi-square that remains when it and the base model try to explain the effect; least first.

    `others` are the further effects in the take: they stay as they are on either side.
    """
    drive = scene.drive
    free = freedom(drive, take, scene.noise, scene.dt, scene.written, known([effect, *others]))

    def heard(*more: Hidden) -> np.ndarray:
        readings = replay(drive, take.inputs, take.start, scene.dt, effects=[*others, *more])
        return stacked(readings, scene.noise)

    base = heard()
    target = heard(effect) - base
    own = float(np.sum(remainder(target, free)[0] ** 2))
    found: list[dict[str, Any]] = []
    tried = candidates(drive, effect)
    for rival in tried:
        parameters = _by_size(scene, effect, rival)
        s, best = 0.03, np.inf
        for _ in range(4):  # the rival's own size, by its share in the regression
            try:
                left, x = remainder(target, free, heard(Hidden(rival.kind, rival.at, parameters(s))) - base)
            except FloatingPointError:
                break
            rest, share = float(np.sum(left**2)), abs(float(x[-1]))
            best = min(best, rest)
            if rest > 0.3 * own or not 1e-6 < s * share < KINDS[rival.kind].largest or abs(share - 1) < 0.01:
                break
            s *= share
        where = {"kind": SPOKEN.get(rival.kind, rival.kind), "at": rival.at}
        found.append(where | {"chi_square": best * SPARSE, "mean_square": best / target.size})
        if rival is tried[-1]:
            tried += [one for one in crossed(drive, effect, alike(effect, found)) if one not in tried]
    return sorted(found, key=lambda one: float(one["chi_square"]))


def _by_size(scene: Scene, effect: Hidden, rival: Hidden) -> Callable[[float], dict[str, float]]:
    """The parameters of a rival as a function of its size; the order of a ripple as the angle it is over turns."""
    parameters = scaled(scene, rival.kind, rival.at, effect.draw)
    if effect.kind != "geared_ripple":
        return parameters
    turns = scene.drive.speed_ratio(effect.members[-1]) / scene.drive.speed_ratio(rival.members[-1])
    return lambda s: parameters(s) | {"order": effect.parameters["order"] * turns}


def alike(effect: Hidden, found: list[dict[str, Any]]) -> list[dict[str, str]]:
    """Of the separations, the causes that count as not told apart."""
    spoken = SPOKEN.get(effect.kind, effect.kind)
    near = [
        one
        for one in found
        if one["chi_square"] < INSEPARABLE or (one["kind"] == spoken and one["mean_square"] < SAME_PLACE)
    ]
    return [{"kind": one["kind"], "at": one["at"]} for one in near]
