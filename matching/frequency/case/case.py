"""Case files of the match: what is matched to what, by which loop, and which quantities may move."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from modelling.bed.loop import HARDWARE, Dynamometer, Loop
from modelling.bed.manoeuvres import Manoeuvre, from_table
from modelling.bed.residual_vehicle import ResidualVehicle, cut
from modelling.bed.structures import DEFAULT, STRUCTURES
from modelling.common.errors import InputError, unknown
from modelling.common.tables import read_toml
from modelling.model.files import load, quantity
from modelling.model.mirror import mirror_image
from modelling.model.quantity import Quantity
from modelling.model.system import System
from modelling.units import to_si

OBJECTIVES = ("response_error", "fidelity")  # what the feedback is tuned by
DEFAULT_LIMITS = {"modulus_margin": 0.5, "damping_ratio": 0.01}


@dataclass(frozen=True)
class Compared:
    """A transfer function that vehicle and rig are compared by: an input and a sensor both know by name."""

    input: str
    sensor: str


@dataclass(frozen=True)
class Target:
    """A vehicle mode the rig has to show: its number, and how far frequency (relative) and damping ratio may be off."""

    mode: int
    frequency_tolerance: float = 0.01
    damping_tolerance: float = 0.02


@dataclass(frozen=True)
class Move:
    """A quantity that may move.

    Attributes
    ----------
    name : str
        ``residual_vehicle.…``, ``rig.…`` or ``loop.…``.
    together : tuple of str
        The name itself and its mirror image, which moves with it.
    start, lower, upper : float
        In SI.
    unit : str
    """

    name: str
    together: tuple[str, ...]
    start: float
    lower: float
    upper: float
    unit: str


@dataclass(frozen=True)
class Case:
    """A match as asked for; see ``examples/road_to_rig/case.toml`` for every key with a comment."""

    vehicle: System
    rig: System
    residual_vehicle: ResidualVehicle
    loop: Loop
    targets: tuple[Target, ...]
    band: tuple[float, float]
    compared: tuple[Compared, ...]
    manoeuvre: Mapping[str, Manoeuvre]
    limits: Mapping[str, float]
    moves: tuple[Move, ...]
    title: str = ""
    path: str = field(default="", compare=False)
    objective: str = "response_error"


_TOP = {"title", "vehicle", "rig", "dynamometers", "loop", "targets", "response", "manoeuvre", "limits", "move"}


def load_case(path: str | Path) -> Case:
    """Read a case file and the model files it names.

    Raises
    ------
    InputError
        One line that names file and key.
    """
    data = read_toml(path)
    where = str(path)
    for key in data:
        if key not in _TOP:
            raise unknown(key, sorted(_TOP), where)
    vehicle, rig = (load(Path(path).parent / _text(data, key, where)) for key in ("vehicle", "rig"))
    try:
        residual = cut(vehicle, rig)
    except InputError as fault:
        raise InputError(f"{where}: {fault.where}", fault.wrong, fault.right) from None
    loop = _loop(data, rig, residual, where)
    band = _band(data, where)
    return Case(
        vehicle,
        rig,
        residual,
        loop,
        _targets(data, where),
        band,
        _compared(data, vehicle, rig, residual, where),
        _manoeuvre(data, rig, residual, loop, where),
        _limits(data, rig, where),
        _moves(data, rig, residual, loop, where),
        _text(data, "title", where) if "title" in data else "",
        where,
        _objective(data, where),
    )


def _text(own: Mapping[str, Any], key: str, where: str) -> str:
    value = own.get(key)
    if not isinstance(value, str) or not value:
        raise InputError(f"{where}: {key}", "is missing or no text", f'write {key} = "…"')
    return value


def _table(data: Mapping[str, Any], key: str, where: str, known: set[str] | None = None) -> dict[str, Any]:
    own = data.get(key, {})
    if not isinstance(own, dict):
        raise InputError(f"{where}: {key}", "is no table", f"write [{key}]")
    for name in own:
        if known is not None and name not in known:
            raise unknown(name, sorted(known), f"{where}: {key}")
    return own


def _loop(data: Mapping[str, Any], rig: System, residual: ResidualVehicle, where: str) -> Loop:
    own = _table(data, "loop", where)
    name = own.get("structure", DEFAULT)
    if not isinstance(name, str) or name not in STRUCTURES:
        raise unknown(str(name), sorted(STRUCTURES), f"{where}: loop.structure")
    structure = STRUCTURES[name]
    known = {**HARDWARE, **structure.quantities}
    for key in own:
        if key not in known and key not in ("structure", "knows"):
            raise unknown(key, ["structure", "knows", *known], f"{where}: loop")
    values = {}
    for name, spec in known.items():
        given = quantity(own[name], spec.unit, f"{where}: loop.{name}").value if name in own else spec.start
        if not spec.lower <= given <= spec.upper:
            raise InputError(
                f"{where}: loop.{name}",
                f"{given:g} is not possible",
                f"{spec.lower:g} … {spec.upper:g} {spec.unit} is needed",
            )
        values[name] = given
    knows = own.get("knows", [])
    if not isinstance(knows, list) or not all(isinstance(name, str) for name in knows):
        raise InputError(f"{where}: loop.measured", "is no list of names", 'write knows = ["motor_torque"]')
    inputs = [part.name for part in rig.inputs]
    for name in knows:
        if name not in inputs:
            raise unknown(name, inputs, f"{where}: loop.measured")
    return Loop(structure, tuple(_dynamometers(data, rig, residual, where)), tuple(knows), values)


def _dynamometers(data: Mapping[str, Any], rig: System, residual: ResidualVehicle, where: str) -> Iterator[Dynamometer]:
    tables = _table(data, "dynamometers", where)
    if not tables:
        raise InputError(f"{where}: dynamometers", "the case has none", "write [dynamometers.NAME] for each")
    inputs, sensors = {part.name: part for part in rig.inputs}, {part.name: part for part in rig.sensors}
    cuts = {own.shaft: own for own in residual.interfaces}
    keys = ("torque_input", "torque_sensor", "speed_sensor", "follows")
    for name in tables:
        place = f"dynamometers.{name}"
        own = _table(tables, name, f"{where}: dynamometers", set(keys))
        given = [_text(own, key, f"{where}: {place}") for key in keys]
        choices = [list(known) for known in (inputs, sensors, sensors, cuts)]
        for key, value, known in zip(keys, given, choices, strict=True):
            if value not in known:
                raise unknown(value, known, f"{where}: {place}.{key}")
        for key, value, measures in (("torque_sensor", given[1], "torque"), ("speed_sensor", given[2], "speed")):
            if sensors[value].measures != measures:
                raise InputError(
                    f"{where}: {place}.{key}",
                    f"{value!r} measures {sensors[value].measures}",
                    f"a {measures} sensor is needed",
                )
        yield Dynamometer(name, *given)
    followed = [own.get("follows") for own in tables.values()]
    for shaft in cuts:
        if followed.count(shaft) != 1:
            raise InputError(
                f"{where}: dynamometers",
                f"{followed.count(shaft)} of them follow the cut at {shaft!r}",
                "one dynamometer a cut is needed",
            )


def _band(data: Mapping[str, Any], where: str) -> tuple[float, float]:
    own = _table(data, "response", where, {"band", "compare", "objective"})
    band = own.get("band", [0.5, 30.0])
    if not isinstance(band, list) or len(band) != 2:
        raise InputError(f"{where}: response.band", "is no pair of frequencies", "write band = [0.5, 30] in Hz")
    low, high = (to_si(edge, "Hz", f"{where}: response.band") for edge in band)
    if not 0 < low < high:
        raise InputError(f"{where}: response.band", f"{low:g} … {high:g} Hz is empty", "0 < lower < upper is needed")
    return low, high


def _objective(data: Mapping[str, Any], where: str) -> str:
    given = _table(data, "response", where).get("objective", OBJECTIVES[0])
    if given not in OBJECTIVES:
        raise unknown(str(given), list(OBJECTIVES), f"{where}: response.objective")
    return given


def _compared(
    data: Mapping[str, Any], vehicle: System, rig: System, residual: ResidualVehicle, where: str
) -> tuple[Compared, ...]:
    given = _table(data, "response", where).get("compare")
    if (
        not isinstance(given, list)
        or not given
        or not all(isinstance(pair, dict) and set(pair) == {"input", "sensor"} for pair in given)
    ):
        raise InputError(
            f"{where}: response.compare",
            "is no list of transfer functions",
            'write compare = [{ input = "…", sensor = "…" }]',
        )
    simulated = [part.name for own in residual.parts for part in own.inputs]
    inputs = [
        part.name for part in vehicle.inputs if part.name in {own.name for own in rig.inputs} or part.name in simulated
    ]
    sensors = [part.name for part in vehicle.sensors if part.name in {own.name for own in rig.sensors}]
    made = []
    for number, pair in enumerate(given, 1):
        for key, known in (("input", inputs), ("sensor", sensors)):
            if pair[key] not in known:
                raise unknown(pair[key], known, f"{where}: response.compare[{number}].{key}")
        made.append(Compared(pair["input"], pair["sensor"]))
    return tuple(made)


def _manoeuvre(
    data: Mapping[str, Any], rig: System, residual: ResidualVehicle, loop: Loop, where: str
) -> dict[str, Manoeuvre]:
    tables = _table(data, "manoeuvre", where)
    driven = {dyno.torque_input for dyno in loop.dynamometers} | {cut.torque for cut in residual.interfaces}
    known = [part.name for system in (rig, *residual.parts) for part in system.inputs if part.name not in driven]
    if not tables:
        raise InputError(
            f"{where}: manoeuvre",
            "the case has none",
            'write [manoeuvre.motor_torque] with kind = "tip_in" and amplitude',
        )
    for name in tables:
        if name not in known:
            raise unknown(name, known, f"{where}: manoeuvre")
    return {name: from_table(own, f"{where}: manoeuvre.{name}") for name, own in tables.items()}


def _targets(data: Mapping[str, Any], where: str) -> tuple[Target, ...]:
    given = data.get("targets", [])
    if not isinstance(given, list) or not given or not all(isinstance(own, dict) for own in given):
        raise InputError(
            f"{where}: targets", "the case has none", "write [[targets]] with mode = NUMBER of the vehicle mode"
        )
    made = []
    for number, own in enumerate(given, 1):
        place = f"{where}: targets[{number}]"
        for key in own:
            if key not in ("mode", "frequency_tolerance", "damping_tolerance"):
                raise unknown(key, ["mode", "frequency_tolerance", "damping_tolerance"], place)
        mode = own.get("mode")
        if not isinstance(mode, int) or isinstance(mode, bool) or mode < 1:
            raise InputError(
                f"{place}.mode", "is no mode number", "write the number that 'rigmatch modes' gives the vehicle mode"
            )
        tolerances = {key: to_si(own[key], "1", f"{place}.{key}") for key in own if key != "mode"}
        for key, value in tolerances.items():
            if not value > 0:
                raise InputError(f"{place}.{key}", f"{value:g} is not possible", "greater than 0 is needed")
        made.append(Target(mode, **tolerances))
    return tuple(made)


def _limits(data: Mapping[str, Any], rig: System, where: str) -> dict[str, float]:
    own = _table(data, "limits", where)
    units = {
        "modulus_margin": "1",
        "damping_ratio": "1",
        "dynamometer_torque": "N*m",
        "dynamometer_speed": "rad/s",
        "dynamometer_power": "W",
    }
    units |= {f"shafts.{part.name}.torque": "N*m" for part in rig.shafts} | {
        f"shafts.{part.name}.twist": "rad" for part in rig.shafts
    }
    limits = dict(DEFAULT_LIMITS)
    for key, value in own.items():
        if key not in units:
            raise unknown(key, list(units), f"{where}: limits")
        limits[key] = to_si(value, units[key], f"{where}: limits.{key}")
        if not limits[key] > 0:
            raise InputError(f"{where}: limits.{key}", f"{limits[key]:g} is not possible", "greater than 0 is needed")
    if limits["modulus_margin"] >= 1:
        raise InputError(
            f"{where}: limits.modulus_margin",
            f"{limits['modulus_margin']:g} cannot be reached",
            "less than 1 is needed; 0.5 is usual",
        )
    return limits


def _moves(data: Mapping[str, Any], rig: System, residual: ResidualVehicle, loop: Loop, where: str) -> tuple[Move, ...]:
    table = _table(data, "move", where)
    places = movable(rig, residual, loop)
    made: list[Move] = []
    for name, given in table.items():
        place = f"{where}: move.{name!r}"
        if name not in places:
            raise unknown(name, list(places), place)
        start, unit, together = places[name]
        if not isinstance(given, dict) or not {"lower", "upper"} <= set(given) <= {"start", "lower", "upper"}:
            raise InputError(
                place, "has no bounds", "write { lower = …, upper = … }, and start = … if it shall start elsewhere"
            )
        low, high = (to_si(given[key], unit, f"{place}.{key}") for key in ("lower", "upper"))
        begin = to_si(given["start"], unit, f"{place}.start") if "start" in given else min(max(start, low), high)
        if not low < high or not low <= begin <= high:
            raise InputError(
                place,
                f"bounds {low:g} … {high:g} with start {begin:g} cross",
                "lower ≤ start ≤ upper and lower < upper is needed",
            )
        if low < _floor(name, loop) or (low == 0 and name.rsplit(".", 1)[1] in ("J", "ratio")):
            raise InputError(f"{place}.lower", f"{low:g} is not possible", "a physical bound is needed")
        taken = {other for move in made for other in move.together}
        if name in taken:
            raise InputError(place, "moves already with its mirror image", "name one of the pair")
        made.append(Move(name, together, begin, low, high, unit))
    return tuple(made)


def _floor(name: str, loop: Loop) -> float:
    if name.startswith("loop."):
        return loop.quantities[name.removeprefix("loop.")].lower
    return 0.0


def movable(rig: System, residual: ResidualVehicle, loop: Loop) -> dict[str, tuple[float, str, tuple[str, ...]]]:
    """Every quantity that may move: start, unit and the names that move together (itself and its mirror image).

    What the rig shares with the vehicle is the specimen and does not move.
    """
    shared = {own.shaft for own in residual.interfaces}
    vehicle_side: dict[str, Quantity] = {}
    units: dict[str, str] = {}
    for part in residual.parts:
        vehicle_side |= part.parameters
        units |= part.units
    found: dict[str, tuple[float, str, tuple[str, ...]]] = {}
    mirrors = {name: mirror_image(name, residual.vehicle) for name in vehicle_side}
    for name, value in vehicle_side.items():
        own = f"residual_vehicle.{name}"
        image = mirrors[name]
        found[own] = (value.value, units[name], (own,) if image == name else (own, f"residual_vehicle.{image}"))
    specimen = set(residual.vehicle.parameters) | {f"shafts.{name}" for name in shared}
    for name, value in rig.parameters.items():
        if name in specimen:
            continue
        own, image = f"rig.{name}", mirror_image(name, rig)
        found[own] = (value.value, rig.units[name], (own,) if image == name else (own, f"rig.{image}"))
    for name, spec in loop.quantities.items():
        found[f"loop.{name}"] = (loop.values[name], spec.unit, (f"loop.{name}",))
    return found
