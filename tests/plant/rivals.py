"""Which other causes a recording cannot tell from the hidden one, by what they leave over after refitting."""

from __future__ import annotations

from typing import Any

import numpy as np

from plant.bench import replay
from plant.calibrate import SPARSE, freedom, remainder, stacked
from plant.hidden import KINDS, SPOKEN, Hidden, places

# kinds that can look alike at one place; every kind also competes with itself at other places
ALIKE = [
    ("coulomb_friction", "stribeck_friction", "quadratic_drag", "constant_torque"),
    ("backlash", "hardening", "hysteresis", "slip", "compliance"),
    ("dead_time", "input_lag", "input_gain"),
    ("sensor_delay", "sensor_lag", "sensor_gain", "sensor_offset", "sensor_drift"),
]
# another kind is inseparable when the rival leaves less than this chi-square: the likelihood cannot part the two
INSEPARABLE = 20.0
# another place of the same kind already when it leaves this mean square (noise = 1): it errs by 1.025 times the noise
SAME_PLACE = 0.05


def candidates(drive: Any, effect: Hidden) -> list[Hidden]:
    group = next((g for g in ALIKE if effect.kind in g), (effect.kind,))
    same = [Hidden(effect.kind, at) for at in places(drive, effect.kind) if at != effect.at]
    return same + [Hidden(kind, effect.at) for kind in group if kind != effect.kind]


def separations(scene: Any, effect: Hidden, take: Any) -> list[dict[str, Any]]:
    """Each rival with the chi-square that remains when it and the base model try to explain the effect; least first."""
    drive = scene.drive
    found: list[dict[str, Any]] = []
    usual = freedom(drive, take, scene.noise, scene.dt, scene.written)
    base = stacked(replay(drive, take.inputs, take.start, scene.dt), scene.noise)
    target = stacked(take.stepped, scene.noise) - base
    for rival in candidates(drive, effect):
        fixed = rival.at if rival.kind == "wrong_parameter" else ""
        free = freedom(drive, take, scene.noise, scene.dt, scene.written, fixed) if fixed else usual
        entry = KINDS[rival.kind]
        name = rival.at if entry.group == "values" else rival.at.split(".")[1]
        parameters = entry.parameters(np.random.default_rng(effect.draw), drive, scene.scale, name)
        s, best = 0.03, np.inf
        own = float(np.sum(remainder(target, free)[0] ** 2)) * SPARSE
        for _ in range(4):
            try:
                heard = replay(
                    drive, take.inputs, take.start, scene.dt, effects=[Hidden(rival.kind, rival.at, parameters(s))]
                )
            except FloatingPointError:
                break
            left, x = remainder(target, free, stacked(heard, scene.noise) - base)
            chi = float(np.sum(left**2)) * SPARSE
            best = min(best, chi)
            if chi > 0.3 * own or not 1e-6 < s * abs(x[-1]) < entry.largest or abs(abs(x[-1]) - 1) < 0.01:
                break
            s *= abs(float(x[-1]))
        found.append(
            {
                "kind": SPOKEN.get(rival.kind, rival.kind),
                "at": rival.at,
                "chi_square": best,
                "mean_square": best / SPARSE / target.size,
            }
        )
    return sorted(found, key=lambda one: one["chi_square"])
