"""Reading the loop and the dynamometers of a case file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from matching.frequency.case.tables import table_of, text_of
from modelling.bed.loop import HARDWARE, Dynamometer, Loop
from modelling.bed.residual_vehicle import ResidualVehicle
from modelling.bed.structures import DEFAULT, STRUCTURES
from modelling.common.errors import InputError, unknown
from modelling.model.files import quantity
from modelling.model.system import System
from modelling.units import to_si

SMALLEST_GAIN = 0.1  # of a dynamometer's torque: a smaller one is no calibration but a mistake


def read_loop(data: Mapping[str, Any], rig: System, residual: ResidualVehicle, where: str) -> Loop:
    """The loop with its structure, dynamometers and values.

    Raises
    ------
    InputError
        Naming file and key.
    """
    table = table_of(data, "loop", where)
    name = table.get("structure", DEFAULT)
    if not isinstance(name, str) or name not in STRUCTURES:
        raise unknown(str(name), sorted(STRUCTURES), f"{where}: loop.structure")
    structure = STRUCTURES[name]
    known = {**HARDWARE, **structure.quantities}
    for key in table:
        if key not in known and key not in ("structure", "knows", "measures"):
            raise unknown(key, ["structure", "knows", "measures", *known], f"{where}: loop")
    values = {}
    for name, known_quantity in known.items():
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
    those = {name for dynamometer in dynamometers for name in (dynamometer.torque_sensor, dynamometer.speed_sensor)}
    further = tuple(name for name in measures if name not in those)
    return Loop(structure, dynamometers, knows, values, further)


def _torque_gain(table: Mapping[str, Any], where: str) -> float:
    """Air-gap torque over command as calibrated; 1 unless stated."""
    gain = to_si(table.get("torque_gain", 1.0), "1", where)
    if not SMALLEST_GAIN <= gain <= 1 / SMALLEST_GAIN:
        raise InputError(where, f"{gain:g} is no calibration", f"{SMALLEST_GAIN:g} … {1 / SMALLEST_GAIN:g} is possible")
    return gain


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
    keys = ("torque_input", "torque_sensor", "speed_sensor", "follows")
    for name in tables:
        place = f"dynamometers.{name}"
        table = table_of(tables, name, f"{where}: dynamometers", {*keys, "torque_gain"})
        texts = [text_of(table, key, f"{where}: {place}") for key in keys]
        choices = [list(known) for known in (inputs, sensors, sensors, cuts)]
        for key, value, known in zip(keys, texts, choices, strict=True):
            if value not in known:
                raise unknown(value, known, f"{where}: {place}.{key}")
        for key, value, measures in (("torque_sensor", texts[1], "torque"), ("speed_sensor", texts[2], "speed")):
            if sensors[value].measures != measures:
                raise InputError(
                    f"{where}: {place}.{key}",
                    f"{value!r} measures {sensors[value].measures}",
                    f"a {measures} sensor is needed",
                )
        gain = _torque_gain(table, f"{where}: {place}.torque_gain")
        yield Dynamometer(name, texts[0], texts[1], texts[2], texts[3], gain)
    followed = [table.get("follows") for table in tables.values()]
    for shaft in cuts:
        if followed.count(shaft) != 1:
            raise InputError(
                f"{where}: dynamometers",
                f"{followed.count(shaft)} of them follow the cut at {shaft!r}",
                "one dynamometer a cut is needed",
            )
