"""A case over a range of speeds: reading it, its grid, the case at one speed, and the one controller of all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from matching.match.case import Case, Drive, OperatingRange, table_of
from matching.match.coupled import run_in_of
from matching.match.gearboxes import Gearboxes
from matching.match.loop import linear_bed
from matching.match.requirements import requirements
from modelling.bed.bed import Loop
from modelling.bed.foreign_vehicle import foreign_vehicle_law
from modelling.bed.manoeuvres import TORQUE_UNIT, Manoeuvre, RecordedTorque, read_manoeuvre
from modelling.bed.profile import DrivenTorques, read_driver, read_speed_profile
from modelling.bed.pulse_following import pulse_following
from modelling.bed.stepped import SteppedLaw, SteppedVehicle, stepped_law, stepped_vehicle
from modelling.bed.vehicle import ResidualVehicle, cut
from modelling.errors import InputError, unknown
from modelling.linear.steady_motion import operating_motion, pedals_too_short, speeds_of, torques_of
from modelling.system import OperatingPoint, System
from modelling.units import to_si


@dataclass(frozen=True)
class RangeSettings:
    """How a range of speeds is covered.

    Attributes
    ----------
    slowest : float
        m/s: the lowest speed of the grid either way. Below it the design of that speed holds, or lies between those of
        both ways, and the vehicle in the law is as it is: about standstill dry friction sticks, no linear model holds.
    largest_ratio : float
        Of one speed of the grid to the next at most. What a tyre does goes with 1/v: matrices that lie straight between
        such neighbours reproduce it to a per cent, and the vehicle itself is exact.
    further : int
        Speeds between two of the grid at which the requirements are checked.
    """

    slowest: float = 0.2
    largest_ratio: float = 2.0
    further: int = 2


RANGE = RangeSettings()
KEYS = ("vehicle_speed", "rolling_radius", "road_load")
EXAMPLE = 'write vehicle_speed = ["0 km/h", "100 km/h"] and rolling_radius = 0.3'


# --- Reading and writing


def with_point_in_range(data: Mapping[str, Any], where: str) -> Mapping[str, Any]:
    """The tables of a case with an operating point in the middle of the range, where they state a range alone.

    Raises
    ------
    InputError
        If the range is none, or both state a road load.
    """
    if "operating_range" not in data:
        return data
    table = table_of(data, "operating_range", where, set(KEYS))
    if "operating_point" in data:
        if "road_load" in table:
            raise InputError(
                f"{where}: operating_range.road_load", "stands beside [operating_point]", "state it there, once"
            )  # fmt: skip
        return data
    low, high = _speeds(table, f"{where}: operating_range")
    middle = float(np.sqrt(max(low, RANGE.slowest) * high))
    speed = {"vehicle_speed": middle, "rolling_radius": table["rolling_radius"]}
    load = {"road_load": table["road_load"]} if "road_load" in table else {}
    return {**data, "operating_point": speed | load}


def read_range(
    data: Mapping[str, Any], vehicle: System, rig: System, loop: Loop, bodies: list[str], gearboxes: Gearboxes | None,
    where: str,
) -> OperatingRange | None:  # fmt: skip
    """The range of a case, None without one.

    Raises
    ------
    InputError
        Naming the key that is wrong, and where there are drives without a range.
    """
    if "operating_range" not in data:
        if "drives" in data:
            raise InputError(f"{where}: drives", "stand without [operating_range]", EXAMPLE)
        return None
    place = f"{where}: operating_range"
    table = table_of(data, "operating_range", where, set(KEYS))
    if not loop.structure.is_observer:
        raise InputError(
            f"{where}: loop.structure", f"{loop.structure.name!r} holds about one speed",
            'a range of speeds needs structure = "observer"',
        )  # fmt: skip
    low, high = _speeds(table, place)
    radius = to_si(table["rolling_radius"], "m", f"{place}.rolling_radius")
    made = OperatingRange(low, high, radius, tuple(bodies))
    driven = {one.torque_input for one in loop.dynamometers}
    known = [part.name for part in vehicle.inputs if part.name not in driven]
    known += gearboxes.driven if gearboxes is not None else ()
    entries = data.get("drives", [])
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise InputError(f"{where}: drives", "is no list of tables", 'write [[drives]] with vehicle_speed = "30 km/h"')
    drives = tuple(
        _drive(entry, number, made, vehicle, rig, loop, known, gearboxes, where)
        for number, entry in enumerate(entries, 1)
    )
    return replace(made, drives=drives)


def _speeds(table: Mapping[str, Any], place: str) -> tuple[float, float]:
    for key in ("vehicle_speed", "rolling_radius"):
        if key not in table:
            raise InputError(f"{place}.{key}", "is missing", EXAMPLE)
    entry = table["vehicle_speed"]
    if not isinstance(entry, list) or len(entry) != 2:
        raise InputError(f"{place}.vehicle_speed", "is no pair of speeds", EXAMPLE)
    low, high = (to_si(edge, "m/s", f"{place}.vehicle_speed") for edge in entry)
    backwards = -low > RANGE.slowest
    if not (low >= 0 or backwards) or not low < high or high <= RANGE.slowest:
        right = (
            f"lowest < highest is needed, highest above {RANGE.slowest:g} m/s, "
            f"lowest 0 or more, or backwards below −{RANGE.slowest:g} m/s"
        )
        raise InputError(f"{place}.vehicle_speed", f"{low:g} … {high:g} m/s is no range", right)
    if not to_si(table["rolling_radius"], "m", f"{place}.rolling_radius") > 0:
        raise InputError(f"{place}.rolling_radius", "is not above 0", "give the tyres' radius in m")
    return low, high


def _drive(
    entry: Mapping[str, Any], number: int, about: OperatingRange, vehicle: System, rig: System, loop: Loop,
    known: list[str], gearboxes: Gearboxes | None, where: str,
) -> Drive:  # fmt: skip
    place, own = f"{where}: drives[{number}]", ("title", "vehicle_speed", "profile", "driver")
    for key in entry:
        if gearboxes is not None and key not in known and (role := gearboxes.alone(key)):
            right = "vehicle and rig shift alike"
            if role == "vehicle":
                right += "; beyond the cut, a clutch of one ratio without teeth, and without effects at its input"
            raise InputError(f"{place}.{key}", f"is a clutch of the {role} alone", right)
        if key not in (*own, *known):
            raise unknown(str(key), [*own, *known], place)
    speed, low = to_si(entry.get("vehicle_speed", 0.0), "m/s", f"{place}.vehicle_speed"), min(about.lowest, 0.0)
    if not low <= speed <= about.highest:
        raise InputError(
            f"{place}.vehicle_speed", f"{speed:g} m/s is not in the range", f"{low:g} … {about.highest:g} m/s is needed"
        )
    folder, brakes = Path(where).parent, vehicle.brakes
    units = vehicle.input_units  # without those of clutches, which are torques
    given = {
        name: read_manoeuvre(entry[name], name, f"{place}.{name}", folder, unit=units.get(name, TORQUE_UNIT))
        for name in known if name in entry
    }  # fmt: skip
    torques: Mapping[str, Manoeuvre] = given
    if "profile" in entry:
        profile = read_speed_profile(entry["profile"], folder, place)
        speed = to_si(entry.get("vehicle_speed", float(profile.speed[0])), "m/s", f"{place}.vehicle_speed")
        begin = at_vehicle_speed(vehicle, rig, about, speed)
        driver = read_driver(entry.get("driver"), [name for name in known if name not in brakes], brakes, place)
        turning = {}
        if driver.brakes:
            turning = speeds_of(at_vehicle_speed(vehicle, rig, about, about.highest, held=True))
        torques = DrivenTorques(
            profile, driver, begin, loop, about.bodies, about.rolling_radius, turning, given
        )  # fmt: skip
    if not torques:
        right = 'write motor_torque = { kind = "drive_away", amplitude = 100 }, or profile = "speed.csv"'
        raise InputError(place, "names no torque", right)
    for name in brakes:
        if name in given and (least := given[name].smallest) < 0:
            raise InputError(f"{place}.{name}", f"reaches {least:g} N·m", "a brake's torque is 0 or more")
    gears = {} if gearboxes is None else gearboxes.begun_in(given, place, at_rest=speed == 0)
    if gears and "profile" in entry:
        raise InputError(
            f"{place}.profile", "shifts", "a driver drives in the gear of the case: leave out the clutches"
        )
    if vehicle.pedals and not gears:
        _check_held(vehicle, rig, about, speed, place)
    return Drive(str(entry.get("title", f"drive {number}")), speed, torques, gears)


def _check_held(vehicle: System, rig: System, about: OperatingRange, speed: float, place: str) -> None:
    """Check that a pedal holds the speed (m/s) at which a drive begins.

    Raises
    ------
    InputError
        If none does.
    """
    try:
        at_vehicle_speed(vehicle, rig, about, speed)
    except InputError as fault:
        raise InputError(f"{place}.vehicle_speed", fault.wrong, "begin at a speed that a pedal holds") from None


def range_tables(about: OperatingRange) -> dict[str, Any]:
    """``[operating_range]`` and ``[[drives]]`` of a case file, SI."""
    tables: dict[str, Any] = {
        "operating_range": {"vehicle_speed": [about.lowest, about.highest], "rolling_radius": about.rolling_radius}
    }
    if about.drives:
        tables["drives"] = [
            {
                "title": drive.title, "vehicle_speed": drive.vehicle_speed,
                **{
                    name: {"file": trace_file(number, name)} if isinstance(torque, RecordedTorque) else torque.table()
                    for name, torque in drive.torques.items()
                },
            }
            for number, drive in enumerate(about.drives, 1)
        ]  # fmt: skip
    return tables


def trace_file(number: int, name: str) -> str:
    """Where the recorded torque of a drive stands."""
    return f"drive_{number}_{name}.csv"


# --- The case at one speed


def grid(about: OperatingRange, further: int = 0) -> np.ndarray:
    """Speeds (g,), m/s, at which the controller is designed, with so many ``further`` ones between two of them."""
    forwards = _one_way(max(about.lowest, RANGE.slowest), about.highest, further)
    return forwards if about.lowest >= 0 else np.r_[-_one_way(RANGE.slowest, -about.lowest, further)[::-1], forwards]


def _one_way(low: float, high: float, further: int) -> np.ndarray:
    pieces = max(int(np.ceil(np.log(high / low) / np.log(RANGE.largest_ratio))), 1)
    return np.geomspace(low, high, pieces * (further + 1) + 1)


def ends_of(case: Case) -> list[float]:
    """Slowest and fastest speed of the grid each way, m/s: what goes with 1/v lies between what it is there."""
    about = case.operating_range
    assert about is not None
    speeds = grid(about)
    return [float(each[at]) for each in (speeds[speeds < 0], speeds[speeds > 0]) if len(each) for at in (0, -1)]


def at_speed(case: Case, speed: float, *, held: bool = True) -> Case:
    """The case with its operating point at a speed of the vehicle, m/s, at rest without one at 0; no targets.

    The drives' torques there are those that hold the speed; what acts beyond the cut is as the vehicle has it. Where
    no pedal holds it, the motion is ``held`` as in :func:`in_steady_motion`, or refused.
    """
    about = case.operating_range
    assert about is not None
    vehicle = at_vehicle_speed(case.vehicle, case.rig, about, speed, held=held)
    emulated = vehicle
    if case.simple_vehicle is not None:
        ends = [(one.vehicle_end, one.vehicle_end) for one in case.residual_vehicle.interfaces]
        beyond = {part.name for system in case.residual_vehicle.parts for part in system.inertias}
        acting = [part.name for part in case.simple_vehicle.inputs if part.on in beyond]
        emulated = turning_as(vehicle, case.simple_vehicle, ends, acting)
    fresh = cut(emulated, case.rig)
    parts = tuple(
        replace(tuned, operating_point=part.operating_point)
        for part, tuned in zip(fresh.parts, case.residual_vehicle.parts, strict=True)
    )
    residual: ResidualVehicle = replace(fresh, parts=parts)
    ends = [(one.rig_end, one.vehicle_end) for one in residual.interfaces]
    driven = {one.torque_input for one in case.loop.dynamometers}
    rig = turning_as(vehicle, case.rig, ends, [part.name for part in case.rig.inputs if part.name not in driven])
    limits = {**case.limits, "margin_from": requirements(case).margin_from}
    return replace(
        case, vehicle=vehicle, rig=rig, residual_vehicle=residual, targets=(), operating_range=None, limits=limits,
        simple_vehicle=None if case.simple_vehicle is None else emulated,
    )  # fmt: skip


def at_vehicle_speed(
    vehicle: System, rig: System, about: OperatingRange, speed: float, *, held: bool = False
) -> System:  # fmt: skip
    """The vehicle with its operating point at a speed, m/s; at rest at 0. ``held`` as in :func:`in_steady_motion`."""
    if not speed:
        return replace(vehicle, operating_point=None)
    bodies = dict.fromkeys(about.bodies, speed / about.rolling_radius)
    return in_steady_motion(vehicle, rig, bodies, {}, held=held)


def rotor_speed(rig: System, loop: Loop) -> float:
    """Mean speed of the rotors at the operating point of a rig, rad/s; 0 without one."""
    if rig.operating_point is None:
        return 0.0
    driven, speeds = {one.torque_input for one in loop.dynamometers}, speeds_of(rig)
    return float(np.mean([speeds[part.on] for part in rig.inputs if part.name in driven]))


def in_steady_motion(
    vehicle: System, rig: System, speeds: Mapping[str, float], torques: Mapping[str, float], *, held: bool = False
) -> System:  # fmt: skip
    """The vehicle at an operating point with these speeds (rad/s) and torques (N·m): the drives' torques follow.

    Drives are inputs that the rig has too; nothing acts at others that are not named. Where there are no drives the
    pedals that hold the speed follow, without pedals the others' torques; without a speed none do. Where no pedal
    holds a speed (an engine creeps faster, or is too weak), the motion may be ``held`` by the others' torques.

    Raises
    ------
    InputError
        If there is no such steady motion.
    """
    on_rig = {part.name for part in rig.inputs}
    open_ones = [part.name for part in vehicle.inputs if part.name not in torques]
    drives = [name for name in open_ones if name in on_rig]
    loads = [name for name in open_ones if name not in on_rig and name not in vehicle.brakes]
    pedals = [name for name in loads if name in vehicle.pedals]
    free = (drives or pedals or loads) if speeds else []
    stated = {**torques, **{name: 0.0 for name in open_ones if name not in free}}
    vehicle = replace(vehicle, operating_point=OperatingPoint(tuple(speeds.items()), tuple(stated.items())))
    if held and pedals and not drives and (short := pedals_too_short(vehicle)):
        nearest = {name: one.nearest for name, one in short.items()}
        kept = {name: torque for name, torque in stated.items() if name not in loads} | nearest
        vehicle = replace(vehicle, operating_point=OperatingPoint(tuple(speeds.items()), tuple(kept.items())))
    operating_motion(vehicle)
    return vehicle


def body_speed(case: Case) -> float:
    """Speed of the vehicle at the operating point of a case with a range, rad/s: the mean of its bodies'."""
    about, turning = case.operating_range, speeds_of(case.vehicle)
    assert about is not None
    return float(np.mean([turning[name] for name in about.bodies]))


def turning_as(
    vehicle: System, system: System, ends: Sequence[tuple[str, str]], inputs: Sequence[str]
) -> System:  # fmt: skip
    """A system whose ``ends`` turn as the inertias of the vehicle that they stand for, with its torques at
    ``inputs``; at rest where the vehicle is.
    """
    if vehicle.operating_point is None:
        return replace(system, operating_point=None)
    speeds, torques = speeds_of(vehicle), torques_of(vehicle)
    point = OperatingPoint(
        tuple((end, speeds[of_vehicle]) for end, of_vehicle in ends),
        tuple((name, torques.get(name, 0.0)) for name in inputs),
    )
    system = replace(system, operating_point=point)
    operating_motion(system)
    return system


def design_vehicle(case: Case) -> SteppedVehicle:
    """The residual vehicle of a case over its range, as a simulation."""
    about = case.operating_range
    assert about is not None
    residuals = [at_speed(case, float(speed)).residual_vehicle for speed in grid(about)]
    return stepped_vehicle(residuals, case.loop, about.bodies, about.rolling_radius)


def _emulated_with_clutches(case: Case) -> ResidualVehicle | None:
    """The residual vehicle with live clutches, as tuned; None without any."""
    boxes = case.gearboxes
    if boxes is None or not boxes.emulated:
        return None
    live = cut(boxes.emulated_vehicle(case.vehicle), case.rig)
    tuned = {name: each.value for part in case.residual_vehicle.parts for name, each in part.parameters.items()}
    parts = (part.with_values({name: tuned[name] for name in part.parameters if name in tuned}) for part in live.parts)
    return replace(live, parts=tuple(parts))


def law_over_speed(case: Case) -> SteppedLaw:
    """The controller of a tuned case over its range.

    Raises
    ------
    NoDesign
        If a Riccati equation has no stabilising solution.
    """
    about = case.operating_range
    assert about is not None
    cases = [at_speed(case, float(speed)) for speed in grid(about)]
    rigs, residuals = [each.rig for each in cases], [each.residual_vehicle for each in cases]
    law = stepped_law(
        rigs, residuals, case.loop, case.loop.values, about.bodies, about.rolling_radius,
        linear_bed(cases[-1]).torque_signs, body_speed(case),
        _emulated_with_clutches(case),
    )  # fmt: skip
    if (vehicle := case.vehicle_in_the_loop) is None:
        return replace(law, following=pulse_following(law, rigs, residuals, case.loop))
    return foreign_vehicle_law(law, vehicle.timing(case.loop["sample_time"]), run_in_of(case))
