"""Reading case files; every complaint is one line that names file and key."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matching.frequency.case.case import OBJECTIVES, Case, Compared, Target
from matching.frequency.case.load_limits import read_limits
from matching.frequency.case.load_loop import read_loop
from matching.frequency.case.load_moves import as_planned, read_moves
from matching.frequency.case.load_operating_point import (
    at_operating_point,
    rig_at_operating_point,
    simple_at_operating_point,
)
from matching.frequency.case.tables import table_of, text_of
from matching.frequency.case.uncertainty import read_uncertainty
from modelling.bed.loop import Loop
from modelling.bed.manoeuvres import Manoeuvre, read_manoeuvre
from modelling.bed.residual_vehicle import ResidualVehicle, cut
from modelling.bed.shared_delays import without_exact_delays
from modelling.bed.simple_vehicle import with_residual_vehicle
from modelling.common.errors import InputError, unknown
from modelling.common.tables import no_pipe, read_toml, title
from modelling.linear.reference_motion import torques_of
from modelling.model.files import load
from modelling.model.system import System
from modelling.units import to_si

TOLERANCES = {"tolerance": 0.1, "unmeasured_tolerance": 0.3}  # response errors that are still called matched
_TOP = {
    "title", "vehicle", "rig", "dynamometers", "loop", "targets", "response", "manoeuvre", "limits", "move",
    "operating_point", "uncertainty", "residual_vehicle",
}  # fmt: skip


def is_case(data: Mapping[str, Any]) -> bool:
    """Whether the content of a file is that of a case: it names a vehicle or a rig, or has dynamometers."""
    return not data.keys().isdisjoint({"vehicle", "rig", "dynamometers"})


def load_case(path: str | Path) -> Case:
    """Read a case file and the model files it names.

    Raises
    ------
    InputError
        One line that names file and key.
    """
    return case_from_tables(read_toml(path), str(path))


def case_from_tables(data: Mapping[str, Any], where: str) -> Case:
    """As :func:`load_case` for tables as ``tomllib`` reads them; model files are looked for beside ``where``.

    Raises
    ------
    InputError
        One line that names file and key.
    """
    path = Path(where)
    for key in data:
        if key not in _TOP:
            raise unknown(key, sorted(_TOP), where)
    vehicle, rig = (_named_model(data, key, path) for key in ("vehicle", "rig"))
    try:
        vehicle, rig, notes = without_exact_delays(vehicle, rig)
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
    rig = rig_at_operating_point(vehicle, rig, residual, loop, where)
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
        _objective(data, where),
        read_uncertainty(data, vehicle, rig, loop, where),
        torque_curve=curve,
        simple_vehicle=simple,
        notes=notes,
        **{key: _tolerance(data, key, start, where) for key, start in TOLERANCES.items()},
    )


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
        simple = with_residual_vehicle(vehicle, residual, load(no_pipe(path, f"{where}: residual_vehicle")))
    except InputError as fault:
        raise InputError(f"{path}: {fault.where}", fault.wrong, fault.right) from None
    return simple_at_operating_point(data, vehicle, simple, residual, where)


def _band(data: Mapping[str, Any], where: str) -> tuple[float, float]:
    table = table_of(data, "response", where, {"band", "compare", "objective", *TOLERANCES})
    band = table.get("band", [0.5, 30.0])
    if not isinstance(band, list) or len(band) != 2:
        raise InputError(f"{where}: response.band", "is no pair of frequencies", "write band = [0.5, 30] in Hz")
    low, high = (to_si(edge, "Hz", f"{where}: response.band") for edge in band)
    if not 0 < low < high:
        raise InputError(f"{where}: response.band", f"{low:g} … {high:g} Hz is empty", "0 < lower < upper is needed")
    return low, high


def _objective(data: Mapping[str, Any], where: str) -> str:
    name = table_of(data, "response", where).get("objective", OBJECTIVES[0])
    if name not in OBJECTIVES:
        raise unknown(str(name), list(OBJECTIVES), f"{where}: response.objective")
    return name


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
    folder, held = Path(where).parent, torques_of(residual.vehicle)
    return {
        name: read_manoeuvre(entry, name, f"{where}: manoeuvre.{name}", folder, held.get(name, 0.0))
        for name, entry in tables.items()
    }


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
