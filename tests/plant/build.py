"""The chain of a drive with what is hidden in it, laws as the specification's effect table has them."""

import numpy as np

from plant.engine import CURVE_POINTS, Chain
from plant.hidden import KINDS, Hidden
from plant.systems import Drive


def chain_of(drive: Drive, effects: list[Hidden]) -> Chain:
    """The chain of a drive with its hidden effects; what is hidden in sensors does not touch it."""
    soft = [e for e in effects if e.kind == "compliance"]
    inertias, shafts = list(drive.inertias), list(drive.shafts)
    chain = Chain(len(inertias) + len(soft), len(shafts) + len(soft), len(drive.inputs))
    values = dict(drive.values)
    values.update({e.at: e.parameters["value"] for e in effects if e.kind == "wrong_parameter"})
    late = values | {e.at: e.parameters["value"] for e in effects if e.kind == "parameter_jump"}
    for column, block in enumerate((values, late)):
        for i, name in enumerate(inertias):
            chain["J"][column * chain.n + i] = block[f"inertias.{name}.J"]
            chain["drag"][column * chain.n + i] = block[f"inertias.{name}.drag"]
        for j, name in enumerate(shafts):
            chain["k"][column * chain.s + j] = block[f"shafts.{name}.stiffness"]
            chain["c"][column * chain.s + j] = block[f"shafts.{name}.damping"]
    for j, ends in enumerate(drive.shafts.values()):
        chain["first"][j], chain["second"][j] = (inertias.index(end) for end in ends)
        chain["ratio"][j] = values.get(f"shafts.{shafts[j]}.ratio", 1.0)
    chain["on"][:] = [inertias.index(name) for name in drive.inputs.values()]
    for more, effect in enumerate(soft):
        i, j, old = len(inertias) + more, len(shafts) + more, shafts.index(effect.name)
        chain["J"][[i, chain.n + i]] = effect.parameters["J"]
        chain["k"][[j, chain.s + j]] = effect.parameters["stiffness"]
        chain["first"][j], chain["second"][j], chain["second"][old] = i, chain["second"][old], i
    for effect in effects:
        _put(chain, drive, effect.in_recording(1))
    return chain


def _put(chain: Chain, drive: Drive, effect: Hidden) -> None:
    p, group = effect.parameters, effect.at.split(".")[0]
    if effect.kind == "parameter_jump":
        chain.jump_time = p["time"]
    if effect.kind == "parameter_drift":
        _put_drift(chain, drive, effect)
    if group not in ("inertias", "shafts", "inputs") or KINDS[effect.kind].group == "values":
        return
    index = list(getattr(drive, group)).index(effect.name)
    match effect.kind:
        case "coulomb_friction" | "stribeck_friction":
            back = p.get("torque_reverse", p["torque"])
            chain["friction"][index], chain["friction_reverse"][index] = p["torque"], back
            chain["breakaway"][index] = p.get("breakaway", p["torque"])
            chain["breakaway_reverse"][index] = p.get("breakaway", back)
            chain["stribeck_speed"][index] = p.get("speed", 0.0)
        case "torque_ripple" | "geared_ripple":
            chain["ripple_follows"][index] = list(drive.inertias).index(effect.members[-1])
            for key in ("order", "amplitude", "phase"):
                chain[f"ripple_{key}"][index] = p[key]
        case "position_torque":
            for key in ("period", "amplitude", "phase"):
                chain[f"place_{key}"][index] = p[key]
        case "input_gain_drift":
            chain["gain_change"][index], chain["gain_warm"][index] = p["change"], p["time_constant"]
        case "table":
            _put_curve(chain, index, p)
        case "gear_loss":
            chain["lost_driven"][index] = 1 - p["efficiency"]
            chain["lost_driving"][index] = 1 / p.get("efficiency_reverse", p["efficiency"]) - 1
        case "disturbance":
            chain.disturbed, chain.disturbance = index, (p["amplitude"], 2 * np.pi * p["frequency"], p["phase"])
        case "hysteresis":
            chain["dahl_torque"][index], chain["dahl_angle"][index] = p["torque"], p["angle"]
        case "angle_stiffness":
            chain["wave_amplitude"][index], chain["wave_order"][index] = p["share"], p["order"]
        case _:
            slot = {
                "backlash": ("gap", "gap"),
                "hardening": ("cubic", "cubic"),
                "slip": ("series_damper", "coefficient"),
                "quadratic_drag": ("quadratic", "coefficient"),
                "constant_torque": ("constant", "torque"),
                "dead_time": ("delay", "delay"),
                "input_lag": ("lag", "time_constant"),
                "input_gain": ("factor", "factor"),
                "input_offset": ("offset", "offset"),
                "saturating_actuator": ("limit", "limit"),
            }.get(effect.kind)
            if slot:
                chain[slot[0]][index] = p[slot[1]]


def _put_curve(chain: Chain, index: int, p: dict[str, float]) -> None:
    """A torque over speed or angle on an inertia, over twist in a shaft."""
    axis, count = next(key.split("_")[0] for key in p if not key.startswith("torque")), len(p) // 2
    name = "twist" if axis == "twist" else "curve"
    for part, key in (("at", axis), ("torque", "torque")):
        row = chain[f"{name}_{part}"].reshape(-1, CURVE_POINTS)[index]
        row[:count] = [p[f"{key}_{i}"] for i in range(1, count + 1)]
    chain[f"{name}_count"][index] = count
    if name == "curve":
        chain["curve_over"][index] = {"speed": 1, "angle": 2}[axis]


def _put_drift(chain: Chain, drive: Drive, effect: Hidden) -> None:
    """A drag, stiffness or damping that changes with time."""
    group, name, quantity = effect.at.split(".")
    index, key = list(getattr(drive, group)).index(name), {"stiffness": "k", "damping": "c"}.get(quantity, quantity)
    chain[f"{key}_change"][index] = effect.parameters["change"]
    chain[f"{key}_warm"][index] = effect.parameters["time_constant"]
