"""A case with its model files as text, so that it can be read again: tuned values as the new start."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from matching.match.box import read_uncertainty, uncertainty_table
from matching.match.case import (
    ERROR_SCALES,
    LIMITS_OF_ALL,
    Case,
    Compared,
    Move,
    Target,
    own_limit,
    table_of,
    text_of,
    whole_loop,
)
from matching.match.gearboxes import Gearboxes
from matching.match.movable import Movable, changed_by, movable
from matching.match.operating_range import (
    in_steady_motion,
    range_tables,
    read_range,
    trace_file,
    turning_as,
    with_point_in_range,
)
from matching.match.requirements import TORQUE_OVER_SPEED, read_limits
from matching.match.vehicle_in_the_loop import read_vehicle_in_the_loop
from modelling.bed.bed import HARDWARE, OWN_TIMES, ControlStructure, Dynamometer, Loop, predicted_part
from modelling.bed.controllers import DEFAULT, STRUCTURES
from modelling.bed.manoeuvres import Manoeuvre, RecordedTorque, read_manoeuvre
from modelling.bed.specimen import KNOWN, SPECIMENS, UNKNOWN
from modelling.bed.vehicle import ResidualVehicle, cut, own_part, with_residual_vehicle, without_exact_delays
from modelling.errors import InputError, listed, unknown
from modelling.linear.steady_motion import torques_of
from modelling.model_file import dumps, load, quantity
from modelling.system import Effect, System, resistance
from modelling.toml import check_file, no_pipe, read_toml, title
from modelling.topology import connected_parts, joints, side, speed_ratios
from modelling.units import to_si

# --- Case file

_HEAD = """\
# Written by rigmatch. rig.toml and [loop] hold the tuned values; those of the residual vehicle stand as `start` below
# [move], for the residual vehicle itself is always cut out of vehicle.toml. residual_vehicle*.toml show it as tuned.
"""

OWN_RESIDUAL_VEHICLE = "own_residual_vehicle.toml"  # of the user, as fitted


def case_files(case: Case) -> dict[str, str]:
    """Texts of ``case.toml``, ``vehicle.toml``, ``rig.toml`` and ``residual_vehicle.toml``, numbered if in parts."""
    boxes, vehicle, rig = case.gearboxes, case.vehicle, case.rig
    if boxes is not None:
        vehicle, rig = boxes.as_in_files(vehicle, rig)
    files = {"case.toml": case_text(case), "vehicle.toml": dumps(vehicle), "rig.toml": dumps(rig)}
    units = {**rig.input_units, **vehicle.input_units}
    for name, torque in case.manoeuvre.items():
        if isinstance(torque, RecordedTorque):
            files[_trace_file(name)] = torque.csv(name, units[name])
    for number, drive in enumerate(case.operating_range.drives if case.operating_range else (), 1):
        for name, torque in drive.torques.items():
            if isinstance(torque, RecordedTorque):
                files[trace_file(number, name)] = torque.csv(name, units[name])
    if case.simple_vehicle is not None:
        files[OWN_RESIDUAL_VEHICLE] = dumps(own_part(case.simple_vehicle, case.residual_vehicle))
    parts = case.residual_vehicle.parts
    for number, part in enumerate(parts, 1):
        files["residual_vehicle.toml" if len(parts) == 1 else f"residual_vehicle_{number}.toml"] = dumps(part)
    return files


def case_text(case: Case) -> str:
    """A case as the text of a case file next to ``vehicle.toml`` and ``rig.toml``, in SI."""
    loop = case.loop
    data: dict[str, Any] = {"title": case.title} if case.title else {}
    data |= {"vehicle": "vehicle.toml", "rig": "rig.toml"}
    data["dynamometers"] = {
        dyno.name: {key: value for key, value in vars(dyno).items() if key != "name" and value is not None}
        for dyno in loop.dynamometers
    }
    own = whole_loop(case)  # of the whole rig, whatever the controller knows of it
    data["loop"] = {"structure": loop.structure.name, "knows": list(own.measured)}
    if own.further_sensors:
        data["loop"]["measures"] = list(own.further_sensors)
    if loop.fixed:
        data["loop"]["fixed"] = True
    if loop.specimen != KNOWN:
        data["loop"]["specimen"] = loop.specimen
    data["loop"] |= {name: loop[name] for name in loop.quantities}
    data["targets"] = [vars(target) for target in case.targets]
    data["response"] = {"band": list(case.band), "compare": [vars(pair) for pair in case.compared]}
    data["response"] |= {
        "tolerance": case.tolerance, "unmeasured_tolerance": case.unmeasured_tolerance,
    }  # fmt: skip
    data["uncertainty"] = uncertainty_table(case.uncertainty, case.vehicle, case.rig, loop)
    data["manoeuvre"] = {
        name: {"file": _trace_file(name)} if isinstance(torque, RecordedTorque) else torque.table()
        for name, torque in case.manoeuvre.items()
    }
    point, boxes = case.vehicle.operating_point, case.gearboxes
    stated = (
        *(() if point is None else (*point.speeds, *point.torques)),
        *(() if boxes is None else boxes.closed.items()),
    )
    if stated or point is not None:
        data["operating_point"] = dict(stated)
    if case.operating_range is not None:
        data |= range_tables(case.operating_range)
    if case.simple_vehicle is not None:
        data["residual_vehicle"] = {"model": OWN_RESIDUAL_VEHICLE}
    if case.vehicle_in_the_loop is not None:
        data["vehicle_in_the_loop"] = case.vehicle_in_the_loop.table()
    data["limits"] = dict(case.limits)
    if "dynamometer_speed" in case.limits:  # with its unit: a bare number would be asked about
        data["limits"]["dynamometer_speed"] = f"{float(case.limits['dynamometer_speed'])!r} rad/s"
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
        return (case.rig.parameters | case.rig.dimensions)[rest].value
    return next(part.parameters[rest].value for part in case.residual_vehicle.parts if rest in part.parameters)


def _bounds(case: Case, move: Move) -> dict[str, Any]:
    start = min(max(value_of(case, move.name), move.lower), move.upper)
    catalogue = {"catalogue": list(move.catalogue)} if move.catalogue else {}
    return {"lower": move.lower, "upper": move.upper, "start": start, "planned": move.planned, **catalogue}


# --- Reading the loop and the dynamometers of a case file.

DYNAMOMETER_KEYS = ("torque_input", "torque_sensor", "speed_sensor", "follows")
MAY_LACK = "torque_sensor"  # of these: a bed without torque flanges
SMALLEST_GAIN = 0.1  # of a dynamometer's torque: a smaller one is no calibration but a mistake


def read_loop(data: Mapping[str, Any], rig: System, residual: ResidualVehicle, where: str) -> Loop:
    """The loop with its structure, dynamometers and values."""
    table = table_of(data, "loop", where)
    name = table.get("structure", DEFAULT)
    if not isinstance(name, str) or name not in STRUCTURES:
        raise unknown(str(name), sorted(STRUCTURES), f"{where}: loop.structure")
    structure = STRUCTURES[name]
    known = {**HARDWARE, **structure.quantities}
    of_loop = ["structure", "knows", "measures", "fixed", "specimen"]
    for key in table:
        if key not in known and key not in of_loop:
            raise unknown(key, [*of_loop, *known], f"{where}: loop")
    fixed = table.get("fixed", False)
    if not isinstance(fixed, bool):
        raise InputError(f"{where}: loop.fixed", "is neither true nor false", "fixed = true: the controller is given")
    values = {}
    for name, known_quantity in known.items():
        if (
            name in HARDWARE
            and isinstance(table.get(name), dict)
            and set(table[name]) & set(table_of(data, "dynamometers", where))
        ):
            raise _one_for_all(f"{where}: loop.{name}", name)
        value = (
            quantity(table[name], known_quantity.unit, f"{where}: loop.{name}").value
            if name in table
            else known_quantity.start
        )
        if not known_quantity.lower <= value <= known_quantity.upper:
            raise InputError(
                f"{where}: loop.{name}",
                f"{value:g} is not possible",
                f"{known_quantity.lower:g} … {known_quantity.upper:g} {known_quantity.unit} is needed",
            )
        values[name] = value
    knows = _names(table, "knows", [part.name for part in rig.inputs], "motor_torque", where)
    measures = _names(table, "measures", [part.name for part in rig.sensors], "motor_speed", where)
    dynamometers = tuple(_dynamometers(data, rig, residual, where))
    if not structure.is_observer and (blind := [one.name for one in dynamometers if one.torque_sensor is None]):
        raise InputError(
            f"{where}: dynamometers.{blind[0]}.torque_sensor", f"is missing, and structure {structure.name!r} needs it",
            'name the sensor of the torque flange; without one, structure = "observer" estimates the torque',
        )  # fmt: skip
    if own := [one.torque_input for one in dynamometers if one.torque_input in knows]:
        raise InputError(
            f"{where}: loop.knows", f"{own[0]!r} is the torque of a dynamometer, which the controller commands",
            "take it out; name torques that act from elsewhere, as the motor's",
        )  # fmt: skip
    those = {name for one in dynamometers for name in (one.torque_sensor, one.speed_sensor)}
    further = tuple(name for name in measures if name not in those)
    return Loop(structure, dynamometers, knows, values, further, fixed, _specimen(table, structure, where))


def _specimen(table: Mapping[str, Any], structure: ControlStructure, where: str) -> str:
    specimen = table.get("specimen", KNOWN)
    if not isinstance(specimen, str) or specimen not in SPECIMENS:
        raise unknown(str(specimen), list(SPECIMENS), f"{where}: loop.specimen")
    if specimen == UNKNOWN and not structure.is_observer:
        raise InputError(
            f"{where}: loop.specimen", f"is {specimen!r}, and structure {structure.name!r} has no model of it",
            'leave it out, or write structure = "observer"',
        )  # fmt: skip
    return specimen


def _before_the_specimen(loop: Loop, rig: System, residual: ResidualVehicle) -> tuple[Loop, list[str]]:
    """The loop with what reaches the controller of an unknown specimen, and sentences on where its model ends."""
    if loop.specimen == KNOWN:
        return loop, []
    part = predicted_part(rig, residual, loop)
    if not part.places:
        words = 'specimen "unknown": no gear, clutch or converter lies behind the dynamometers: the whole rig is known'
        return replace(loop, specimen=KNOWN), [words]
    inputs, sensors = ({one.name for one in parts} for parts in (part.system.inputs, part.system.sensors))
    known, read = (
        tuple(name for name in names if name in there)
        for names, there in ((loop.measured, inputs), (loop.further_sensors, sensors))
    )
    lost = [name for name in (*loop.measured, *loop.further_sensors) if name not in (*known, *read)]
    words = (
        f'specimen "unknown": the controller\'s model of the rig ends at {listed([*part.places])}, the torque on '
        f"{listed([*part.torques.values()])} is unmeasured"
    )
    if lost:
        words += f"; it does not use {listed(lost)}"
    words += "; unmeasured_tolerance holds for every response, since each passes the specimen"
    return replace(loop, measured=known, further_sensors=read, beyond=tuple(lost)), [words]


def _one_for_all(where: str, key: str) -> InputError:
    """The error for a property of the loop that is stated for each dynamometer."""
    if key in OWN_TIMES:
        return InputError(where, "names dynamometers", f"write {key} under [dynamometers.NAME] for each of them")
    return InputError(where, f"one {key} holds for all dynamometers", f"state it as {key} under [loop]")


def _torque_gain(table: Mapping[str, Any], where: str) -> float:
    """Air-gap torque over command as calibrated; 1 unless stated."""
    gain = to_si(table.get("torque_gain", 1.0), "1", where)
    if not SMALLEST_GAIN <= gain <= 1 / SMALLEST_GAIN:
        raise InputError(where, f"{gain:g} is no calibration", f"{SMALLEST_GAIN:g} … {1 / SMALLEST_GAIN:g} is possible")
    return gain


def _own_time(value: Any, key: str, where: str) -> float:
    """A time (s) that a dynamometer has for itself."""
    known = HARDWARE[key]
    time = to_si(value, "s", where)
    if not known.lower <= time <= known.upper:
        raise InputError(where, f"{time:g} is not possible", f"{known.lower:g} … {known.upper:g} s is needed")
    return time


def _names(table: Mapping[str, Any], key: str, known: list[str], example: str, where: str) -> tuple[str, ...]:
    names = table.get(key, [])
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise InputError(f"{where}: loop.{key}", "is no list of names", f'write {key} = ["{example}"]')
    for name in names:
        if name not in known:
            raise unknown(name, known, f"{where}: loop.{key}")
    return tuple(dict.fromkeys(names))


def _dynamometers(data: Mapping[str, Any], rig: System, residual: ResidualVehicle, where: str) -> Iterator[Dynamometer]:
    tables = table_of(data, "dynamometers", where)
    if not tables:
        raise InputError(f"{where}: dynamometers", "the case has none", "write [dynamometers.NAME] for each")
    inputs, sensors = {part.name: part for part in rig.inputs}, {part.name: part for part in rig.sensors}
    cuts = {cut.shaft: cut for cut in residual.interfaces}
    for name in tables:
        place = f"dynamometers.{name}"
        for key in set(HARDWARE) - set(OWN_TIMES):
            if isinstance(tables[name], dict) and key in tables[name]:
                raise _one_for_all(f"{where}: {place}.{key}", key)
        for what, key in LIMITS_OF_ALL.items():
            if isinstance(tables[name], dict) and (stated := {what, key} & set(tables[name])):
                own = f'"{own_limit(name, what)}"'
                raise InputError(f"{where}: {place}.{min(stated)}", "is a limit", f"write {own} = … under [limits]")
        table = table_of(tables, name, f"{where}: dynamometers", {*DYNAMOMETER_KEYS, "torque_gain", *OWN_TIMES})
        keys = [key for key in DYNAMOMETER_KEYS if key != MAY_LACK or key in table]
        texts = {key: text_of(table, key, f"{where}: {place}") for key in keys}
        choices = dict(zip(DYNAMOMETER_KEYS, ([*inputs], [*sensors], [*sensors], [*cuts]), strict=True))
        for key, value in texts.items():
            if value not in choices[key]:
                raise unknown(value, choices[key], f"{where}: {place}.{key}")
        if texts["torque_input"] in rig.pedals:
            wrong = f"{texts['torque_input']!r} is a pedal with a torque map"
            raise InputError(f"{where}: {place}.torque_input", wrong, "a dynamometer is commanded a torque")
        for key, measures in (("torque_sensor", "torque"), ("speed_sensor", "speed")):
            if key in texts and sensors[value := texts[key]].measures != measures:
                raise InputError(
                    f"{where}: {place}.{key}",
                    f"{value!r} measures {sensors[value].measures}",
                    f"a {measures} sensor is needed",
                )
        gain = _torque_gain(table, f"{where}: {place}.torque_gain")
        times = {key: _own_time(table[key], key, f"{where}: {place}.{key}") for key in OWN_TIMES if key in table}
        yield Dynamometer(
            name, texts["torque_input"], texts.get("torque_sensor"), texts["speed_sensor"], texts["follows"], gain,
            **times,
        )  # fmt: skip
    followed = [table.get("follows") for table in tables.values()]
    for shaft in cuts:
        if followed.count(shaft) != 1:
            raise InputError(
                f"{where}: dynamometers",
                f"{followed.count(shaft)} of them follow the cut at {shaft!r}",
                "one dynamometer a cut is needed",
            )


# --- Which quantities of a case may move, and reading which of them do.

MOVE_KEYS = {"start", "planned", "lower", "upper"}
BUYING_KEYS = {"catalogue", "step"}  # of an adapter: what of it can be bought
MOST_STEPS = 1000  # of a catalogue, either way from the plan: a bound of 0 has no end
EVEN = 1e-9  # of a step, by which a bound may be missed through rounding
SMALLEST_STEP = 0.01  # relative, of a catalogue: finer ones are no choice between parts


def read_moves(
    data: Mapping[str, Any], rig: System, residual: ResidualVehicle, loop: Loop, where: str
) -> tuple[Move, ...]:
    """What may move, each quantity with its mirror image."""
    table = table_of(data, "move", where)
    places = movable(rig, residual, loop)
    made: list[Move] = []
    for name, entry in table.items():
        place = f"{where}: move.{name!r}"
        if name not in places:
            raise unknown(name, list(places), place)
        if loop.fixed and name.startswith("loop."):
            raise InputError(place, "belongs to a fixed controller", "take it out, or fixed = true of [loop]")
        if name.removeprefix("loop.") in HARDWARE:
            raise InputError(
                place, "is the bed's, and no match can choose it",
                f"state it under [loop]; `rigmatch map CASE --x {name}` shows what another value gives",
            )  # fmt: skip
        start, unit, together = places[name]
        if not isinstance(entry, dict) or not {"lower", "upper"} <= set(entry) <= MOVE_KEYS | BUYING_KEYS:
            raise InputError(
                place, "has no bounds", "write { lower = …, upper = … }, and start = … if it shall start elsewhere"
            )
        low, high = (to_si(entry[key], unit, f"{place}.{key}") for key in ("lower", "upper"))
        planned = to_si(entry["planned"], unit, f"{place}.planned") if "planned" in entry else start
        if not low <= planned <= high:
            if not name.startswith("loop."):
                raise InputError(
                    place, f"the plan of {planned:g} {unit} lies outside its bounds {low:g} … {high:g} {unit}",
                    "widen the bounds, or state planned = … within them",
                )  # fmt: skip
            planned = min(max(planned, low), high)
        begin = to_si(entry["start"], unit, f"{place}.start") if "start" in entry else planned
        if not low < high or not low <= begin <= high:
            raise InputError(
                place,
                f"bounds {low:g} … {high:g} with start {begin:g} cross",
                "lower ≤ start ≤ upper and lower < upper is needed",
            )
        if low < _floor(name, loop) or (low == 0 and name.rsplit(".", 1)[1] in ("J", "ratio", "length", "diameter")):
            raise InputError(f"{place}.lower", f"{low:g} is not possible", "a physical bound is needed")
        taken = {other for move in made for other in move.together}
        if name in taken:
            raise InputError(place, "moves already with its mirror image", "name one of the pair")
        parts = _catalogue(name, entry, (low, high), planned, unit, place)
        made.append(Move(name, together, begin, low, high, unit, planned, parts))
    _check_dimensions(rig, made, where)
    return tuple(made)


def _check_dimensions(rig: System, moves: Sequence[Move], where: str) -> None:
    """Refuse what moves next to the dimensions that it follows from, and a bore as wide as its tube."""
    moved = {name.removeprefix("rig."): move for move in moves for name in move.together}
    for name in rig.dimensions.keys() & moved.keys():
        shaft = name.rpartition(".")[0]
        place = f"{where}: move.{moved[name].name!r}"
        changed = changed_by(rig, [f"rig.{name}"]) - {f"rig.{name}"}
        if both := sorted({one.removeprefix("rig.") for one in changed} & moved.keys()):
            raise InputError(place, f"changes {both[0]}, which moves as well", "name one of both")
        bore, outside = f"{shaft}.inner_diameter", f"{shaft}.diameter"
        widest = moved[bore].upper if bore in moved else rig.dimensions[bore].ends[1]
        least = moved[outside].lower if outside in moved else rig.dimensions[outside].ends[0]
        if widest >= least:
            raise InputError(
                place, f"lets the diameter of {widest:g} m inside reach the one outside, {least:g} m",
                "bounds that leave a wall",
            )  # fmt: skip


SIDES = {"left": "right", "right": "left", "l": "r", "r": "l", "fl": "fr", "fr": "fl", "rl": "rr", "rr": "rl",
         "links": "rechts", "rechts": "links"}  # fmt: skip


def _other_side(name: str) -> str:
    """The name of what stands on the other side, by the words for it; the name itself without any."""
    return "".join(SIDES.get(word, word) for word in re.split(r"([._])", name))


def one_of_two(moves: Sequence[Move], places: Mapping[str, Movable], rig: System, vehicle: System) -> list[str]:
    """A note on every part of the rig that may move while its like on the other side stays as planned.

    Where both halves of a car are the same, they are mirror images and move together; otherwise nothing ties them.
    """
    moved = {name for move in moves for name in move.together}
    pairs = sorted({tuple(sorted((one.name, _other_side(one.name)))) for one in rig.inertias})
    names = {one.name for one in rig.inertias} - {one.name for one in vehicle.inertias}
    tied = [list(pair) for pair in pairs if pair[0] != pair[1] and names.issuperset(pair)]
    notes = []
    for move in moves:
        other = _other_side(move.name)
        if move.name.startswith("rig.") and len(move.together) == 1 and other in places and other not in moved:
            stays = (
                f"{other} stays at {places[other].start:g} {move.unit}, as planned" if move.unit else f"{other} stays"
            )
            notes.append(
                f"{move.name} may move and {stays}: they are no mirror images. To order both, name both under [move], "
                f"or tie them by [mirror] pairs = {json.dumps(tied)} in the rig's file"
            )
    return notes


def _catalogue(
    name: str, entry: Mapping[str, Any], bounds: tuple[float, float], planned: float, unit: str, place: str
) -> tuple[float, ...]:
    """What can be bought within the bounds: as listed, or in equal steps from what is planned; empty for anything."""
    low, high = bounds
    stated = sorted(BUYING_KEYS & set(entry))
    if not stated:
        return ()
    key, where = stated[-1], f"{place}.{stated[-1]}"
    if len(stated) > 1:
        raise InputError(place, "states a catalogue and a step", "one of both is needed")
    if not name.startswith("rig."):
        raise InputError(where, "is no part that is bought", f"only quantities of the rig have a {key}")
    if key == "step":
        step = to_si(entry[key], "1", where)
        if not SMALLEST_STEP <= step <= 1 or not planned > 0:
            wrong, right = (
                f"{step:g} about {planned:g} {unit} is no step",
                f"a share from {SMALLEST_STEP:g} to 1 is needed",
            )
            raise InputError(where, wrong, right)
        ends = [np.log(end / planned) / np.log1p(step) if end > 0 else -MOST_STEPS for end in bounds]
        numbers = np.arange(np.ceil(max(ends[0], -MOST_STEPS) - EVEN), np.floor(min(ends[1], MOST_STEPS) + EVEN) + 1)
        values = (planned * (1 + step) ** numbers).tolist()
    elif isinstance(entry[key], list) and entry[key]:
        values = sorted(to_si(value, unit, where) for value in entry[key])
    else:
        raise InputError(where, f"{entry[key]!r} is no list of values", "write catalogue = [100000, 160000, 250000]")
    within = tuple(dict.fromkeys(float(value) for value in values if low <= value <= high))
    if not within:
        raise InputError(where, f"no part lies within {low:g} … {high:g} {unit}", "widen the bounds, or list others")
    return within


def as_planned(rig: System, moves: Sequence[Move], data: Mapping[str, Any]) -> System:
    """The rig as it was planned: a tuned case brings the tuned rig, and states under ``planned`` what that was."""
    stated = [move for move in moves if "planned" in data["move"][move.name] and move.name.startswith("rig.")]
    planned = {name.removeprefix("rig."): move.planned for move in stated for name in move.together}
    return rig.with_values(planned, designed=True)


def _floor(name: str, loop: Loop) -> float:
    if name.startswith("loop."):
        return loop.quantities[name.removeprefix("loop.")].lower
    return 0.0


# --- Reading the operating point of a case, and giving it to the vehicle and to the rig.

KEYS = ("vehicle_speed", "rolling_radius", "road_load")
# Inertia over the largest beyond a cut, from which a part carries the vehicle's mass: an engine has a hundredth of half
# a car, one wheel of four carries a fifth of the mass at least.
OF_THE_MASS = 0.05
ROAD_LOAD = {"constant": "N", "linear": "N*s/m", "quadratic": "N*s^2/m^2"}
EXAMPLE = 'write vehicle_speed = "30 km/h" and rolling_radius = 0.31, or the speed of an inertia: motor = "2500 1/min"'


def at_operating_point(data: Mapping[str, Any], vehicle: System, rig: System, where: str) -> System:
    """The vehicle at the case's operating point, with the road load that it states; as it is without one."""
    if "operating_point" not in data:
        return vehicle
    table, place = table_of(data, "operating_point", where), f"{where}: operating_point"
    speeds, torques = _stated(table, vehicle, place)
    bodies = vehicle_inertias(vehicle, rig)
    if "vehicle_speed" in table:
        speed = to_si(table["vehicle_speed"], "m/s", f"{place}.vehicle_speed")
        speeds |= dict.fromkeys(bodies, speed / _radius(table, place))
    if "road_load" in table:
        vehicle = _with_road_load(vehicle, bodies, table["road_load"], _radius(table, place), f"{place}.road_load")
    if not speeds and not torques:
        raise InputError(place, "states no speed and no torque", EXAMPLE)
    try:
        return in_steady_motion(vehicle, rig, speeds, torques)
    except InputError as fault:
        raise InputError(place, fault.wrong, fault.right) from None


def _in_one_gear(
    data: Mapping[str, Any], vehicle: System, rig: System, where: str
) -> tuple[Mapping[str, Any], System, System, Gearboxes | None]:
    """Gearboxes in the gear whose clutch has a torque at the operating point, the first without one.

    The tables come back without these torques: the clutches are locked. Models without gearboxes come back as they are.

    Raises
    ------
    InputError
        If the operating point closes the clutches of several gears.
    """
    stated, place = data.get("operating_point"), f"{where}: operating_point"
    table = stated if isinstance(stated, Mapping) else {}
    held = list[System]()
    held_in, stated_torques = dict[str, int](), dict[str, float]()
    for system in (vehicle, rig):
        gears: dict[str, int] = {}
        for box in system.gearboxes:
            torques = {name: to_si(table.get(name, 0.0), "N*m", f"{place}.{name}") for name in box.capacities}
            closed = [gear for gear, torque in enumerate(torques.values(), 1) if torque > 0]
            stated_torques |= {name: torque for name, torque in torques.items() if torque > 0}
            if len(closed) > 1:
                wrong = f"closes the clutches of {len(closed)} gears of gearboxes.{box.name}"
                raise InputError(place, wrong, "state a torque for the clutch of one gear")
            gears[box.name] = closed[0] if closed else 1
        held.append(system.in_gear(gears))
        held_in |= gears
    clutches = {*vehicle.capacities, *rig.capacities}
    rest = {key: value for key, value in table.items() if key not in clutches}
    if len(rest) < len(table):
        data = {key: value for key, value in data.items() if key != "operating_point"}
        data |= {"operating_point": rest} if rest else {}
    gearboxes = Gearboxes(vehicle, rig, held_in, stated_torques) if held_in else None
    return data, held[0], held[1], gearboxes


def _of_gearboxes(gearboxes: Gearboxes | None) -> list[str]:
    """Notes on gearboxes of vehicle and rig."""
    if gearboxes is None:
        return []
    roles = (("vehicle", gearboxes.vehicle), ("rig", gearboxes.rig))
    return [gearboxes.note(box.name, role) for role, system in roles for box in system.gearboxes]


def rig_at_operating_point(vehicle: System, rig: System, residual: ResidualVehicle, loop: Loop, where: str) -> System:
    """The rig where each cut turns as in the vehicle and each drive gives the vehicle's torque; dynamometers
    hold it."""
    if vehicle.operating_point is None:
        return rig
    dynamometers = {dynamometer.torque_input for dynamometer in loop.dynamometers}
    held = [part.name for part in rig.inputs if part.name not in dynamometers]
    try:
        return turning_as(vehicle, rig, [(cut.rig_end, cut.vehicle_end) for cut in residual.interfaces], held)
    except InputError as fault:
        raise InputError(
            f"{where}: operating_point",
            f"the vehicle has it, the rig does not: {fault.wrong}",
            "what both have under one name has to be the same",
        ) from None


def simple_at_operating_point(
    data: Mapping[str, Any], vehicle: System, simple: System, residual: ResidualVehicle, where: str
) -> System:
    """The vehicle with the user's residual vehicle where its cuts turn as the vehicle's, under the same road load.

    Torques beyond the cut are those of the vehicle under the same names; the drives' torques that hold it follow.
    """
    if vehicle.operating_point is None:
        return simple
    table, place = table_of(data, "operating_point", where), f"{where}: operating_point"
    beyond = {part.name for system in residual.parts for part in system.inertias}
    near = {part.name for part in vehicle.inertias} - beyond
    if "road_load" in table:
        bodies = _bodies(simple, near)
        simple = _with_road_load(simple, bodies, table["road_load"], _radius(table, place), f"{place}.road_load")
    acting = [part.name for part in simple.inputs if part.on not in near]
    try:
        return turning_as(vehicle, simple, [(cut.vehicle_end, cut.vehicle_end) for cut in residual.interfaces], acting)
    except InputError as fault:
        raise InputError(
            place,
            f"the vehicle has it, with the residual vehicle of the case it does not: {fault.wrong}",
            "where the shafts of the cut end, both have to be able to turn at the same speeds",
        ) from None


def vehicle_inertias(vehicle: System, rig: System) -> list[str]:
    """Inertias that stand for the vehicle's mass, see :func:`_bodies`, beyond the rig."""
    return _bodies(vehicle, {part.name for part in rig.inertias})


def _bodies(vehicle: System, near: set[str]) -> list[str]:
    """Of each connected part of what is not ``near`` the largest inertia, where the part is behind the wheels.

    An engine beyond a cut is a part of its own, too: its inertia is below :data:`OF_THE_MASS` of the vehicle's.
    """
    inertia = {part.name: part.J.value for part in vehicle.inertias if part.name not in near}
    largest = [max(part, key=inertia.__getitem__) for part in connected_parts(inertia, joints(vehicle))]
    mass = max((inertia[name] for name in largest), default=0.0)
    return [name for name in largest if inertia[name] >= OF_THE_MASS * mass]


def _stated(table: Mapping[str, Any], vehicle: System, place: str) -> tuple[dict[str, float], dict[str, float]]:
    """Speeds of inertias (rad/s) and torques (N·m) or pedals of inputs that stand under their names."""
    inertias, inputs = ([part.name for part in parts] for parts in (vehicle.inertias, vehicle.inputs))
    speeds, torques = {}, {}
    for key, value in table.items():
        if key in KEYS:
            continue
        if key in inertias and key in inputs:
            raise InputError(f"{place}.{key}", "is an inertia and an input", "rename one of them in the model")
        if key in inertias:
            speeds[key] = to_si(value, "rad/s", f"{place}.{key}")
        elif key in inputs:
            torques[key] = to_si(value, vehicle.input_units[key], f"{place}.{key}")
        else:
            raise unknown(key, [*KEYS, *inertias, *inputs], place)
    return speeds, torques


def _radius(table: Mapping[str, Any], place: str) -> float:
    if "rolling_radius" not in table:
        raise InputError(
            f"{place}.rolling_radius", "is missing", "a speed or force of the vehicle needs the tyres' radius in m"
        )
    radius = to_si(table["rolling_radius"], "m", f"{place}.rolling_radius")
    if not radius > 0:
        raise InputError(f"{place}.rolling_radius", f"{radius:g} is not possible", "greater than 0 is needed")
    return radius


def _with_road_load(vehicle: System, bodies: list[str], load: Any, radius: float, place: str) -> System:
    """The vehicle with a force constant + linear·v + quadratic·v² against its motion, shared by its bodies."""
    terms = load if isinstance(load, Mapping) else {"constant": load}
    for key in terms:
        if key not in ROAD_LOAD:
            raise unknown(str(key), list(ROAD_LOAD), place)
    force = {key: to_si(value, ROAD_LOAD[key], f"{place}.{key}") / len(bodies) for key, value in terms.items()}
    for key, value in force.items():
        if value < 0:
            raise InputError(f"{place}.{key}", f"{value:g} is not possible", "0 or more is needed")
    effects: list[Effect] = []
    values = {}
    for body in bodies:
        at = f"inertias.{body}"
        if "linear" in force:
            values[f"{at}.drag"] = vehicle.parameters[f"{at}.drag"].value + force["linear"] * radius**2
        if "constant" in force:
            effects.append(resistance(at, 0, force["constant"] * radius))
        if "quadratic" in force:
            effects.append(resistance(at, 2, force["quadratic"] * radius**3))
    try:
        return vehicle.with_values(values).with_effects(*effects)
    except InputError as fault:
        raise InputError(f"{place}", f"{fault.where} {fault.wrong}", "state it in the vehicle or here") from None


# --- Reading case files; every complaint is one line that names file and key.

# Response errors that are still called matched, unless the case says otherwise.
LENIENT = 1.0  # a response error, at which responses differ by a factor of e: a case may allow it, not more in earnest
TOLERANCES = {"tolerance": ERROR_SCALES.measured, "unmeasured_tolerance": ERROR_SCALES.unmeasured}
UNLIKE = 0.01  # relative difference of a shared quantity's values from which a note asks whether it is the same part
TOP = {
    "title", "vehicle", "rig", "dynamometers", "loop", "targets", "response", "manoeuvre", "limits", "move",
    "operating_point", "operating_range", "drives", "uncertainty", "residual_vehicle",
    "vehicle_in_the_loop",
}  # fmt: skip


def is_case(data: Mapping[str, Any]) -> bool:
    """Whether the content of a file is that of a case: it names a vehicle or a rig, or has dynamometers."""
    return not data.keys().isdisjoint({"vehicle", "rig", "dynamometers"})


def load_case(path: str | Path) -> Case:
    """Read a case file and the model files it names."""
    return case_from_tables(read_toml(path), str(path))


def case_from_tables(data: Mapping[str, Any], where: str) -> Case:
    """As :func:`load_case` for tables as ``tomllib`` reads them; model files are looked for next to ``where``."""
    path = Path(where)
    check_file(data, TOP, where, "case")
    data = with_point_in_range(data, where)
    vehicle, rig = (_named_model(data, key, path) for key in ("vehicle", "rig"))
    data, vehicle, rig, gearboxes = _in_one_gear(data, vehicle, rig, where)
    _check_not_swapped(data, vehicle, rig, where)
    rig, late = _without_late_dynamometers(data, rig)
    unlike = _unlike(vehicle, rig, where)
    try:
        vehicle, rig, notes = without_exact_delays(vehicle, rig)
        if gearboxes is not None:
            gearboxes = gearboxes.without_exact_delays()
    except InputError as fault:
        raise InputError(f"{where}: {fault.where}", fault.wrong, fault.right) from None
    vehicle = at_operating_point(data, vehicle, rig, where)
    try:
        residual = cut(vehicle, rig)
    except InputError as fault:
        raise InputError(f"{where}: {fault.where}", fault.wrong, fault.right) from None
    simple = _simple_vehicle(data, vehicle, residual, where)
    if simple is not None:
        residual = cut(simple, rig)
    loop = read_loop(data, rig, residual, where)
    loop, of_dynamometers = _with_late_dynamometers(loop, late)
    loop, of_specimen = _before_the_specimen(loop, rig, residual)
    rig = rig_at_operating_point(vehicle, rig, residual, loop, where)
    if gearboxes is not None and "operating_range" in data and simple is None and "vehicle_in_the_loop" not in data:
        gearboxes = gearboxes.emulating({part.name for system in residual.parts for part in system.inertias})
    covered = read_range(data, vehicle, rig, loop, vehicle_inertias(vehicle, rig), gearboxes, where)
    band = _band(data, where)
    limits, curve = read_limits(data, rig, where)
    moves = read_moves(data, rig, residual, loop, where)
    rig = as_planned(rig, moves, data)
    return Case(
        vehicle,
        rig,
        residual,
        loop,
        _targets(data, where),
        band,
        _compared(data, vehicle, rig, residual, where),
        _manoeuvre(data, rig, residual, loop, where),
        limits,
        moves,
        title(data, where),
        where,
        read_uncertainty(data, vehicle, rig, loop, where),
        torque_curve=curve,
        operating_range=covered,
        simple_vehicle=simple,
        vehicle_in_the_loop=read_vehicle_in_the_loop(data, vehicle, rig, loop, where),
        gearboxes=gearboxes,
        notes=(
            *_of_gearboxes(gearboxes),
            *unlike,
            *dict.fromkeys([*vehicle.doubts, *rig.doubts]),
            *one_of_two(moves, movable(rig, residual, loop), rig, vehicle),
            *_elsewhere(rig, loop),
            *_in_turns(data),
            *_lenient(data),
            *notes,
            *of_dynamometers,
            *of_specimen,
        ),
        **_tolerances(data, loop, where),
    )


def _check_not_swapped(data: Mapping[str, Any], vehicle: System, rig: System, where: str) -> None:
    tables = data.get("dynamometers")
    entries = tables.values() if isinstance(tables, dict) else ()
    named = {str(table.get("torque_input")) for table in entries if isinstance(table, dict)}
    of_vehicle, of_rig = ({part.name for part in system.inputs} for system in (vehicle, rig))
    if named and named <= of_vehicle and named.isdisjoint(of_rig):
        raise InputError(f"{where}: vehicle, rig", "are exchanged: the vehicle has the dynamometers", "exchange them")


def _without_late_dynamometers(data: Mapping[str, Any], rig: System) -> tuple[System, dict[str, float]]:
    """The rig without the dead times of its model at inputs of dynamometers, and these (s) by input."""
    tables = data.get("dynamometers")
    entries = tables.values() if isinstance(tables, dict) else ()
    driven = {f"inputs.{table.get('torque_input')}" for table in entries if isinstance(table, dict)}
    late: dict[str, float] = {}
    kept = []
    for effect in rig.effects:
        if effect.law.only_delays and set(effect.places) <= driven:
            for place in effect.places:
                name = place.removeprefix("inputs.")
                late[name] = late.get(name, 0.0) + sum(quantity.value for _, quantity in effect.parameters)
        else:
            kept.append(effect)
    return (replace(rig, effects=tuple(kept)) if late else rig), late


def _with_late_dynamometers(loop: Loop, late: Mapping[str, float]) -> tuple[Loop, list[str]]:
    """The loop whose dynamometers have the dead times of the rig's model on top of the loop's, and sentences on it.

    A dynamometer that states its own dead time states all of it.
    """
    made, notes = [], []
    for one in loop.dynamometers:
        more = late.get(one.torque_input, 0.0)
        if more and one.dead_time is None:
            made.append(replace(one, dead_time=loop["dead_time"] + more))
            notes.append(
                f"dynamometer {one.name}: its input is late by {1e3 * more:g} ms in the rig's model, so its dead "
                f"time is {1e3 * (loop['dead_time'] + more):g} ms"
            )
        else:
            made.append(one)
            if more and one.dead_time is not None:
                notes.append(
                    f"dynamometer {one.name}: its dead time of {1e3 * one.dead_time:g} ms is all of it; the "
                    f"{1e3 * more:g} ms in the rig's model are not added"
                )
    return replace(loop, dynamometers=tuple(made)), notes


def _unlike(vehicle: System, rig: System, where: str) -> list[str]:
    """A note on every shared quantity that differs; the same part has the same value.

    Raises
    ------
    InputError
        If a ratio has another sign: one of both turns the wrong way.
    """
    notes = []
    for name in vehicle.parameters.keys() & rig.parameters.keys():
        there, here = vehicle.parameters[name].value, rig.parameters[name].value
        if name.endswith(".ratio") and there * here < 0:
            wrong = f"{name} is {there:g} in the vehicle and {here:g} in the rig: the same part turns the other way"
            raise InputError(f"{where}: rig", wrong, "give both the same sign, or the rig's part another name")
        if abs(there - here) > UNLIKE * max(abs(there), abs(here)):
            notes.append(
                f"{name} is {there:g} in the vehicle and {here:g} {rig.units[name]} in the rig: the same part?"
            )
    if not any(".ratio" in note for note in notes):
        notes += _other_speeds(vehicle, rig)
    return sorted(notes)


def _other_speeds(vehicle: System, rig: System) -> list[str]:
    """A note on shared inertias that turn in another proportion, whatever stands between them in each."""
    shared = [part.name for part in vehicle.inertias if any(other.name == part.name for other in rig.inertias)]
    if not shared:
        return []
    found = dict[float, str]()
    there, here = (speed_ratios(shared[0], joints(system)) for system in (vehicle, rig))
    for name in shared[1:]:
        if there.get(name) and here.get(name) and abs(here[name] / there[name] - 1) > UNLIKE:
            found.setdefault(round(here[name] / there[name], 6), name)
    return [
        f"{shared[0]} turns {1 / there[name]:.4g} times as fast as {name} in the vehicle and {1 / here[name]:.4g} "
        "times on the rig: their responses differ by this, whatever is tuned"
        for name in found.values()
    ]


def _elsewhere(rig: System, loop: Loop) -> list[str]:
    """A note on every dynamometer whose speed sensor sits on an inertia that no rigid joint ties to its own."""
    on, of = {part.name: part.on for part in rig.inputs}, {part.name: part.of for part in rig.sensors}
    rigid = joints(rig, "gears")
    return [
        f"dynamometer {one.name}: its torque acts on {on[one.torque_input]}, but {one.speed_sensor} measures "
        f"{of[one.speed_sensor]}: the right sensor?"
        for one in loop.dynamometers
        if of[one.speed_sensor] not in side(on[one.torque_input], rigid)
    ]


def _in_turns(data: Mapping[str, Any]) -> list[str]:
    """A note on a speed limit that is written without a unit: rad/s, which a bed's data sheet does not use."""
    limits = data.get("limits")
    stated = limits.get("dynamometer_speed") if isinstance(limits, dict) else None
    if not isinstance(stated, int | float) or isinstance(stated, bool):
        return []
    return [f"limits.dynamometer_speed = {stated:g} is in rad/s: {30 / np.pi * stated:.0f} 1/min"]


def _lenient(data: Mapping[str, Any]) -> list[str]:
    """A note on a tolerance of the response error that hardly refuses anything: per cent, perhaps."""
    response = data.get("response")
    stated = {key: response.get(key) for key in TOLERANCES} if isinstance(response, dict) else {}
    return [
        f"response.{key} = {value:g} lets responses differ {np.exp(min(value, 99)):.3g} times; 0.1 is about 10 %"
        for key, value in stated.items()
        if isinstance(value, int | float) and value > LENIENT
    ]


def _named_model(data: Mapping[str, Any], key: str, path: Path) -> System:
    """The model that a case names; the case is at fault where there is no such file."""
    named = path.parent / text_of(data, key, str(path))
    if not os.path.exists(named):  # Path.exists raises where a name is too long
        raise InputError(f"{path}: {key}", f"{named} does not exist", "name a model file, relative to the case")
    return load(no_pipe(named, f"{path}: {key}"))


def _simple_vehicle(
    data: Mapping[str, Any], vehicle: System, residual: ResidualVehicle, where: str
) -> System | None:  # fmt: skip
    """The vehicle with the residual vehicle of the case's own, None without one."""
    if "residual_vehicle" not in data:
        return None
    table = table_of(data, "residual_vehicle", where, {"model"})
    path = Path(where).parent / text_of(table, "model", f"{where}: residual_vehicle")
    try:
        simple = with_residual_vehicle(vehicle, residual, load(no_pipe(path, f"{where}: residual_vehicle")).in_gear(1))
    except InputError as fault:
        raise InputError(f"{path}: {fault.where}", fault.wrong, fault.right) from None
    return simple_at_operating_point(data, vehicle, simple, residual, where)


def _band(data: Mapping[str, Any], where: str) -> tuple[float, float]:
    table = table_of(data, "response", where, {"band", "compare", "objective", *TOLERANCES})
    if table.get("objective", "response_error") != "response_error":  # as older versions wrote it
        raise InputError(f"{where}: response.objective", "is not response_error", "leave it out: there is no other")
    band = table.get("band", [0.5, 30.0])
    if not isinstance(band, list) or len(band) != 2:
        raise InputError(f"{where}: response.band", "is no pair of frequencies", "write band = [0.5, 30] in Hz")
    low, high = (to_si(edge, "Hz", f"{where}: response.band") for edge in band)
    if not 0 < low < high:
        wrong = "begins at 0 Hz, where a free drivetrain has no response" if low == 0 < high else "is empty"
        raise InputError(f"{where}: response.band", f"{low:g} … {high:g} Hz {wrong}", "0 < lower < upper is needed")
    return low, high


def _tolerances(data: Mapping[str, Any], loop: Loop, where: str) -> dict[str, float]:
    """Those of the response errors; where the specimen is unknown, that of unmeasured torques holds for all."""
    made = {key: _tolerance(data, key, start, where) for key, start in TOLERANCES.items()}
    return made if loop.specimen == KNOWN else dict.fromkeys(made, made["unmeasured_tolerance"])


def _tolerance(data: Mapping[str, Any], key: str, start: float, where: str) -> float:
    value = to_si(table_of(data, "response", where).get(key, start), "1", f"{where}: response.{key}")
    if not value > 0:
        raise InputError(f"{where}: response.{key}", f"{value:g} is not possible", "greater than 0 is needed")
    return value


def _compared(
    data: Mapping[str, Any], vehicle: System, rig: System, residual: ResidualVehicle, where: str
) -> tuple[Compared, ...]:
    entries = table_of(data, "response", where).get("compare")
    right = 'write compare = [{ input = "…", sensor = "…" }]'
    if not isinstance(entries, list) or not entries:
        raise InputError(f"{where}: response.compare", "is no list of transfer functions", right)
    for number, pair in enumerate(entries, 1):
        if not isinstance(pair, dict) or set(pair) != {"input", "sensor"}:
            raise InputError(f"{where}: response.compare[{number}]", "is no pair of input and sensor", right)
    simulated = [part.name for system in residual.parts for part in system.inputs]
    inputs = [
        part.name
        for part in vehicle.inputs
        if part.name in {driven.name for driven in rig.inputs} or part.name in simulated
    ]
    sensors = [part.name for part in vehicle.sensors if part.name in {sensor.name for sensor in rig.sensors}]
    made = []
    for number, pair in enumerate(entries, 1):
        for key, known in (("input", inputs), ("sensor", sensors)):
            if pair[key] not in known:
                raise unknown(pair[key], known, f"{where}: response.compare[{number}].{key}")
        made.append(Compared(pair["input"], pair["sensor"]))
    return tuple(made)


def _manoeuvre(
    data: Mapping[str, Any], rig: System, residual: ResidualVehicle, loop: Loop, where: str
) -> dict[str, Manoeuvre]:
    tables = table_of(data, "manoeuvre", where)
    driven = {dyno.torque_input for dyno in loop.dynamometers} | {cut.torque for cut in residual.interfaces}
    units = {name: unit for system in (rig, *residual.parts) for name, unit in system.input_units.items()}
    known = [name for name in units if name not in driven]
    if not tables:
        raise InputError(
            f"{where}: manoeuvre",
            "the case has none",
            'write [manoeuvre.motor_torque] with kind = "tip_in" and amplitude',
        )
    for name in tables:
        if name not in known:
            raise unknown(name, known, f"{where}: manoeuvre")
    folder, held = Path(where).parent, torques_of(residual.vehicle)
    read = {
        name: read_manoeuvre(entry, name, f"{where}: manoeuvre.{name}", folder, held.get(name, 0.0), units[name])
        for name, entry in tables.items()
    }
    if not any(one.amplitude for one in read.values()):
        name = next(iter(read))
        raise InputError(
            f"{where}: manoeuvre.{name}.amplitude", "is 0: nothing moves", "give the torque of a tip-in, say"
        )
    return read


def _targets(data: Mapping[str, Any], where: str) -> tuple[Target, ...]:
    entries = data.get("targets", [])
    if not isinstance(entries, list) or not entries or not all(isinstance(table, dict) for table in entries):
        raise InputError(
            f"{where}: targets", "the case has none", "write [[targets]] with mode = NUMBER of the vehicle mode"
        )
    made = list[Target]()
    for number, table in enumerate(entries, 1):
        place = f"{where}: targets[{number}]"
        for key in table:
            if key not in ("mode", "frequency_tolerance", "damping_tolerance"):
                raise unknown(key, ["mode", "frequency_tolerance", "damping_tolerance"], place)
        mode = table.get("mode")
        if not isinstance(mode, int) or isinstance(mode, bool) or mode < 1:
            raise InputError(
                f"{place}.mode", "is no mode number", "write the number that 'rigmatch modes' gives the vehicle mode"
            )
        if mode in (before := [target.mode for target in made]):
            wrong, right = f"{mode} is that of targets[{before.index(mode) + 1}] already", "name another mode"
            raise InputError(f"{place}.mode", wrong, right)
        tolerances = {key: to_si(table[key], "1", f"{place}.{key}") for key in table if key != "mode"}
        for key, value in tolerances.items():
            if not value > 0:
                raise InputError(f"{place}.{key}", f"{value:g} is not possible", "greater than 0 is needed")
        made.append(Target(mode, **tolerances))
    return tuple(made)
