"""A case with its model files as text, so that it can be read again: tuned values as the new start."""

from __future__ import annotations

from typing import Any

import tomli_w

from matching.frequency.case.case import Case, Move
from matching.frequency.case.load_limits import TORQUE_OVER_SPEED
from matching.frequency.case.uncertainty import uncertainty_table
from modelling.bed.manoeuvres import RecordedTorque
from modelling.bed.simple_vehicle import own_part
from modelling.model.files import dumps

_HEAD = """\
# Written by rigmatch. rig.toml and [loop] hold the tuned values; those of the residual vehicle stand as `start` below
# [move], for the residual vehicle itself is always cut out of vehicle.toml. residual_vehicle*.toml show it as tuned.
"""

OWN_RESIDUAL_VEHICLE = "own_residual_vehicle.toml"  # of the user, as fitted


def case_files(case: Case) -> dict[str, str]:
    """Texts of ``case.toml``, ``vehicle.toml``, ``rig.toml`` and ``residual_vehicle.toml``, numbered if in parts."""
    files = {"case.toml": case_text(case), "vehicle.toml": dumps(case.vehicle), "rig.toml": dumps(case.rig)}
    for name, torque in case.manoeuvre.items():
        if isinstance(torque, RecordedTorque):
            files[_trace_file(name)] = torque.csv(name)
    if case.simple_vehicle is not None:
        files[OWN_RESIDUAL_VEHICLE] = dumps(own_part(case.simple_vehicle, case.residual_vehicle))
    parts = case.residual_vehicle.parts
    for number, part in enumerate(parts, 1):
        files["residual_vehicle.toml" if len(parts) == 1 else f"residual_vehicle_{number}.toml"] = dumps(part)
    return files


def case_text(case: Case) -> str:
    """A case as the text of a case file beside ``vehicle.toml`` and ``rig.toml``, in SI."""
    loop = case.loop
    data: dict[str, Any] = {"title": case.title} if case.title else {}
    data |= {"vehicle": "vehicle.toml", "rig": "rig.toml"}
    data["dynamometers"] = {
        dyno.name: {key: value for key, value in vars(dyno).items() if key != "name"} for dyno in loop.dynamometers
    }
    data["loop"] = {"structure": loop.structure.name, "knows": list(loop.measured)}
    if loop.further_sensors:
        data["loop"]["measures"] = list(loop.further_sensors)
    data["loop"] |= {name: loop[name] for name in loop.quantities}
    data["targets"] = [vars(target) for target in case.targets]
    data["response"] = {"band": list(case.band), "compare": [vars(pair) for pair in case.compared]}
    data["response"] |= {
        "objective": case.objective, "tolerance": case.tolerance, "unmeasured_tolerance": case.unmeasured_tolerance,
    }  # fmt: skip
    data["uncertainty"] = uncertainty_table(case.uncertainty, case.vehicle, case.rig, loop)
    data["manoeuvre"] = {
        name: {"file": _trace_file(name)} if isinstance(torque, RecordedTorque) else torque.table()
        for name, torque in case.manoeuvre.items()
    }
    if (point := case.vehicle.operating_point) is not None:
        data["operating_point"] = dict((*point.speeds, *point.torques))
    if case.simple_vehicle is not None:
        data["residual_vehicle"] = {"model": OWN_RESIDUAL_VEHICLE}
    data["limits"] = dict(case.limits)
    if case.torque_curve is not None:
        curve = zip(case.torque_curve.speeds, case.torque_curve.torques, strict=True)
        data["limits"][TORQUE_OVER_SPEED] = [list(pair) for pair in curve]
    data["move"] = {move.name: _bounds(case, move) for move in case.moves}
    return _HEAD + tomli_w.dumps(data)


def _trace_file(name: str) -> str:
    return f"manoeuvre_{name}.csv"


def value_of(case: Case, name: str) -> float:
    """Value that a case holds under the name of a quantity that may move, SI."""
    whose, _, rest = name.partition(".")
    if whose == "loop":
        return case.loop[rest]
    if whose == "rig":
        return case.rig.parameters[rest].value
    return next(part.parameters[rest].value for part in case.residual_vehicle.parts if rest in part.parameters)


def _bounds(case: Case, move: Move) -> dict[str, float]:
    start = min(max(value_of(case, move.name), move.lower), move.upper)
    return {"lower": move.lower, "upper": move.upper, "start": start, "planned": move.planned}
