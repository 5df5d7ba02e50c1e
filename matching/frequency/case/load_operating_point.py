"""Reading the operating point of a case, and giving it to the vehicle and to the rig."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from matching.frequency.case.tables import table_of
from modelling.bed.loop import Loop
from modelling.bed.residual_vehicle import ResidualVehicle
from modelling.common.errors import InputError, unknown
from modelling.linear.reference_motion import operating_motion, speeds_of, torques_of
from modelling.model.components import Effect, OperatingPoint, resistance
from modelling.model.system import System
from modelling.units import to_si

KEYS = ("vehicle_speed", "rolling_radius", "road_load")
ROAD_LOAD = {"constant": "N", "linear": "N*s/m", "quadratic": "N*s^2/m^2"}
EXAMPLE = 'write vehicle_speed = "30 km/h" and rolling_radius = 0.31, or the speed of an inertia: motor = "2500 1/min"'


def at_operating_point(data: Mapping[str, Any], vehicle: System, rig: System, where: str) -> System:
    """The vehicle at the case's operating point, with the road load that it states; as it is without one.

    Raises
    ------
    InputError
        Naming file and key, also where the vehicle has no such steady motion.
    """
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
    on_rig = {part.name for part in rig.inputs}
    drives = [part.name for part in vehicle.inputs if part.name in on_rig and part.name not in torques]
    loads = [part.name for part in vehicle.inputs if part.name not in on_rig and part.name not in torques]
    free = (drives or loads) if speeds else []
    torques |= {name: 0.0 for name in (*drives, *loads) if name not in free}
    try:
        vehicle = replace(vehicle, operating_point=OperatingPoint(tuple(speeds.items()), tuple(torques.items())))
        operating_motion(vehicle)
    except InputError as fault:
        raise InputError(place, fault.wrong, fault.right) from None
    return vehicle


def rig_at_operating_point(vehicle: System, rig: System, residual: ResidualVehicle, loop: Loop, where: str) -> System:
    """The rig where each cut turns as in the vehicle and each drive gives the vehicle's torque; dynamometers hold it.

    Raises
    ------
    InputError
        If the rig has no such steady motion.
    """
    if vehicle.operating_point is None:
        return rig
    dynamometers = {dynamometer.torque_input for dynamometer in loop.dynamometers}
    held = [part.name for part in rig.inputs if part.name not in dynamometers]
    try:
        return _turning_as(vehicle, rig, [(cut.rig_end, cut.vehicle_end) for cut in residual.interfaces], held)
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

    Raises
    ------
    InputError
        If it has no such steady motion.
    """
    if vehicle.operating_point is None:
        return simple
    table, place = table_of(data, "operating_point", where), f"{where}: operating_point"
    beyond = {part.name for system in residual.parts for part in system.inertias}
    near = {part.name for part in vehicle.inertias} - beyond
    if "road_load" in table:
        bodies = _largest_of_each_part(simple, near)
        simple = _with_road_load(simple, bodies, table["road_load"], _radius(table, place), f"{place}.road_load")
    acting = [part.name for part in simple.inputs if part.on not in near]
    try:
        return _turning_as(vehicle, simple, [(cut.vehicle_end, cut.vehicle_end) for cut in residual.interfaces], acting)
    except InputError as fault:
        raise InputError(
            place,
            f"the vehicle has it, with the residual vehicle of the case it does not: {fault.wrong}",
            "where the shafts of the cut end, both have to be able to turn at the same speeds",
        ) from None


def _turning_as(vehicle: System, system: System, ends: Sequence[tuple[str, str]], inputs: Sequence[str]) -> System:
    """A system whose ``ends`` turn as the inertias of the vehicle that they stand for, with its torques at ``inputs``.

    Raises
    ------
    InputError
        If it has no such steady motion.
    """
    speeds, torques = speeds_of(vehicle), torques_of(vehicle)
    point = OperatingPoint(
        tuple((end, speeds[of_vehicle]) for end, of_vehicle in ends),
        tuple((name, torques.get(name, 0.0)) for name in inputs),
    )
    system = replace(system, operating_point=point)
    operating_motion(system)
    return system


def vehicle_inertias(vehicle: System, rig: System) -> list[str]:
    """Inertias that stand for the vehicle's mass: of each connected part that the rig lacks the largest."""
    return _largest_of_each_part(vehicle, {part.name for part in rig.inertias})


def _largest_of_each_part(vehicle: System, near: set[str]) -> list[str]:
    """Of each connected part of what is not ``near`` the largest inertia."""
    inertia = {part.name: part.J.value for part in vehicle.inertias if part.name not in near}
    joints = [part.between for part in vehicle.shafts] + [part.between for part in vehicle.gears]
    carried, left = [], set(inertia)
    while left:
        group = {next(name for name in inertia if name in left)}
        while grown := {end for ends in joints if set(ends) & group for end in ends if end in inertia} - group:
            group |= grown
        left -= group
        carried.append(max(group, key=lambda name: inertia[name]))
    return carried


def _stated(table: Mapping[str, Any], vehicle: System, place: str) -> tuple[dict[str, float], dict[str, float]]:
    """Speeds of inertias (rad/s) and torques of inputs (N·m) that stand under their names."""
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
            torques[key] = to_si(value, "N*m", f"{place}.{key}")
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
