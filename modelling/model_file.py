"""Model files: TOML ⇄ System."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import tomli_w

from modelling.dimensions import OF_A_GEAR, OF_A_SHAFT, with_dimensions, without_dimensions
from modelling.effects import EFFECTS
from modelling.effects.effect import Kind, place_in_file, shared_place
from modelling.errors import InputError, unknown
from modelling.system import (
    TABLES,
    Converter,
    Differential,
    Effect,
    Gear,
    Gearbox,
    Inertia,
    Input,
    PlanetaryGear,
    Quantity,
    Sensor,
    Shaft,
    System,
    quantity_unit,
)
from modelling.toml import check_file, check_keys, read_toml, text, title
from modelling.topology import connected_parts, joints, speed_ratios
from modelling.units import GEARBOX_UNITS, QUANTITY_UNITS, SENSOR_UNITS, in_unit, to_si

# --- Files

KEYS = {
    "inertias": {"J", "drag"},
    "shafts": {"between", "ratio", "stiffness", "damping"},
    "gears": {"between", "ratio"},
    "gearboxes": {"between", "ratios", "capacities", "deflection", "settling", "engages_below", "converter"},
    "differentials": {"cage", "left", "right"},
    "planetary_gears": {"sun", "carrier", "ring", "ratio"},
    "inputs": {"on", "measures", "reference"},
    "sensors": {"measures", "of", "uncertainty", "counts"},
}
BY_DRAWING: dict[str, dict[str, tuple[str, float | None]]] = {
    "shafts": OF_A_SHAFT,
    "gears": dict.fromkeys(OF_A_GEAR, ("1", None)),
}  # keys in place of others
QUANTITY_KEYS = ({"value"}, {"value", "lower", "upper"}, {"value", "tolerance"})  # of a quantity that is a table
TOP = {"title", "reference", "mirror", "effects", *TABLES}


def load(path: str | Path) -> System:
    """Read a model file.

    Raises
    ------
    InputError
        One line that names file and key.
    """
    return from_dict(read_toml(path), str(path))


def from_dict(data: Mapping[str, Any], where: str = "model") -> System:
    """A system from the content of a model file.

    Parameters
    ----------
    data : mapping
        As :func:`tomllib.load` gives it.
    where : str
        How errors call it.

    Raises
    ------
    InputError
        One line that names file and key.
    """
    check_file(data, TOP, where, "model")
    data, drawings = without_dimensions(data, where, quantity)
    try:
        system = System(
            inertias=tuple(_parts(data, "inertias", where, _inertia)),
            shafts=tuple(
                replace(shaft, drawing=drawings.get(shaft.name)) for shaft in _parts(data, "shafts", where, _shaft)
            ),
            gears=tuple(_parts(data, "gears", where, _gear)),
            gearboxes=tuple(_parts(data, "gearboxes", where, _gearbox)),
            differentials=tuple(_parts(data, "differentials", where, _differential)),
            planetary_gears=tuple(_parts(data, "planetary_gears", where, _planetary_gear)),
            inputs=tuple(_parts(data, "inputs", where, _input)),
            sensors=tuple(_parts(data, "sensors", where, _sensor)),
            mirror=_mirror(data.get("mirror", {}), f"{where}: mirror"),
            effects=_effects(data, where),
            title=title(data, where),
            reference=text(data, "reference", where, ""),
        )
        _check_shafts_turn(system)
        return system
    except InputError as fault:
        if fault.where.startswith(where):
            raise
        raise InputError(f"{where}: {fault.where}" if fault.where else where, fault.wrong, fault.right) from None


ROUNDED = 1e-6  # relative: below it the ratios round a loop contradict each other by the digits that a file states only


def _check_shafts_turn(system: System) -> None:
    """Refuse a loop of shafts and gears whose ratios contradict each other: whatever turns would wind it up."""
    shafts, every = joints(system, "shafts"), joints(system, "gears", "shafts")
    for part in connected_parts((inertia.name for inertia in system.inertias), every):
        speed = speed_ratios(part[0], every)
        for shaft in (shaft for shaft in shafts if shaft.ends[0] in speed):
            first, second = shaft.ends
            if abs(speed[first] - shaft.ratio * speed[second]) > ROUNDED * abs(speed[first]):
                other_way = (
                    f"{first} turns {speed[first] / speed[second]:.6g} times as fast as {second} by the other way"
                )
                raise InputError(
                    shaft.place,
                    f"locks the drivetrain: without twist {other_way}, {shaft.ratio:.6g} times by this shaft",
                    "check the ratios",
                )


def _parts(data: Mapping[str, Any], table: str, where: str, make: Callable[[str, dict, str], Any]) -> list:
    parts = data.get(table, {})
    if not isinstance(parts, dict):
        raise InputError(f"{where}: {table}", "is no table", f"write [{table}.NAME]")
    components = []
    for name, content in parts.items():
        place = f"{where}: {table}.{name}"
        components.append(make(name, check_keys(content, KEYS[table], place), place))
    return components


def _inertia(name: str, table: dict, place: str) -> Inertia:
    return Inertia(name, _needed(table, "J", place), _optional(table, "drag", place) or Quantity(0.0))


def _shaft(name: str, table: dict, place: str) -> Shaft:
    return Shaft(
        name,
        _between(table, place),
        _needed(table, "stiffness", place),
        _optional(table, "damping", place) or Quantity(0.0),
        _optional(table, "ratio", place),
    )


def _gear(name: str, table: dict, place: str) -> Gear:
    return Gear(name, _between(table, place), _needed(table, "ratio", place))


def _gearbox(name: str, table: dict, place: str) -> Gearbox:
    for key, example in (("ratios", "[12.0, 7.5]"), ("capacities", '["clutch_1", "clutch_2"]')):
        if not isinstance(table.get(key), list):
            raise InputError(
                f"{place}.{key}", "is no list" if key in table else "is missing", f"write {key} = {example}"
            )
    for each in table["capacities"]:
        if not isinstance(each, str):
            raise InputError(f"{place}.capacities", f"{each!r} is no name", "write the names of inputs in quotes")
    ratios = tuple(quantity(each, "1", f"{place}.ratios") for each in table["ratios"])
    deflection = _needed(table, "deflection", place)
    settling, below = (_optional(table, key, place) for key in ("settling", "engages_below"))
    converter = _converter(table.get("converter"), f"{place}.converter")
    capacities = tuple(table["capacities"])
    return Gearbox(name, _between(table, place), ratios, capacities, deflection, settling, below, converter)


CONVERTER_UNITS = {"speed_ratios": "1", "capacity_factors": "N*m*s^2/rad^2", "torque_ratios": "1"}


def _converter(table: Any, place: str) -> Converter | None:
    if table is None:
        return None
    if not isinstance(table, dict):
        right = "write { speed_ratios = [0, 0.8, 1], capacity_factors = [2e-3, 1.6e-3, 0], torque_ratios = [2, 1, 1] }"
        raise InputError(place, "is no table", right)
    for key in table:
        if key not in CONVERTER_UNITS:
            raise unknown(str(key), list(CONVERTER_UNITS), place)
    lists = {}
    for key, unit in CONVERTER_UNITS.items():
        if not isinstance(table.get(key), list):
            raise InputError(
                f"{place}.{key}", "is no list" if key in table else "is missing", "write a list of numbers"
            )
        lists[key] = tuple(to_si(each, unit, f"{place}.{key}") for each in table[key])
    return Converter(**lists)


def _differential(name: str, table: dict, place: str) -> Differential:
    return Differential(name, *(text(table, key, place) for key in ("cage", "left", "right")))


def _planetary_gear(name: str, table: dict, place: str) -> PlanetaryGear:
    sun, carrier, ring = (text(table, key, place) for key in ("sun", "carrier", "ring"))
    return PlanetaryGear(name, sun, carrier, ring, _needed(table, "ratio", place))


def _input(name: str, table: dict, place: str) -> Input:
    measures, reference = (text(table, key, place) if key in table else None for key in ("measures", "reference"))
    return Input(name, text(table, "on", place), measures, reference)


def _sensor(name: str, table: dict, place: str) -> Sensor:
    measures = text(table, "measures", place)
    if measures not in SENSOR_UNITS:
        raise unknown(measures, list(SENSOR_UNITS), f"{place}.measures")
    unit = SENSOR_UNITS[measures]
    uncertainty = to_si(table["uncertainty"], unit, f"{place}.uncertainty") if "uncertainty" in table else None
    counts = to_si(table["counts"], "1", f"{place}.counts") if "counts" in table else None
    if counts is not None and (measures != "speed" or not counts >= 1):
        wrong = f"{counts:g} is no number of counts" if measures == "speed" else f"a sensor of {measures} has no counts"
        raise InputError(f"{place}.counts", wrong, "an encoder that measures a speed has 1 a turn or more")
    return Sensor(name, measures, text(table, "of", place), uncertainty, counts)


def _mirror(table: Any, place: str) -> tuple[tuple[str, str], ...]:
    pairs = table.get("pairs", []) if isinstance(table, dict) else None
    if not isinstance(pairs, list) or (isinstance(table, dict) and set(table) - {"pairs"}):
        raise InputError(place, "is not understood", 'write pairs = [["left", "right"], …] below [mirror]')
    return tuple(_pair(pair, f"{place}.pairs") for pair in pairs)


def _effects(data: Mapping[str, Any], where: str) -> tuple[Effect, ...]:
    tables = data.get("effects", [])
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise InputError(f"{where}: effects", "is no list of tables", "write [[effects]] with kind and at below")
    if not tables:
        return ()
    # units and places are those of the system without effects
    inputs = {name: {"on": table["on"]} for name, table in data.get("inputs", {}).items()}  # what imposes is an effect
    base = from_dict({key: value for key, value in data.items() if key != "effects"} | {"inputs": inputs}, where)
    places: dict[str, dict[str, None]] = {}
    return tuple(_effect(table, base, places, f"{where}: effects[{number}]") for number, table in enumerate(tables, 1))


def _effect(table: dict, base: System, places_by_kind: dict[str, dict[str, None]], place: str) -> Effect:
    kind = text(table, "kind", place)
    if kind not in EFFECTS:
        raise unknown(kind, sorted(EFFECTS), f"{place}.kind")
    law = EFFECTS[kind]
    if kind not in places_by_kind:
        places_by_kind[kind] = dict.fromkeys(law.places(base))
    at = _effect_place(table, places_by_kind[kind], place, base)
    parameters = _separate({key: value for key, value in table.items() if key not in ("kind", "at")}, law, place)
    for key in parameters:
        if key not in law.parameters:
            raise unknown(key, law.file_keys, f"{place} ({kind})")
    for array in law.arrays:
        numbers = sorted(int(key.rpartition("_")[2]) for key in parameters if key.rpartition("_")[0] == array)
        if numbers != list(range(1, len(numbers) + 1)):
            raise InputError(f"{place}.{array}", "has a gap", f"write all of it as {array} = [first, second, …]")
    quantities = (
        (key, quantity(value, law.unit(key, at, base), f"{place}.{key}")) for key, value in parameters.items()
    )
    return Effect(kind, at, tuple(quantities))


def _separate(values: Mapping[str, Any], law: Kind, place: str) -> dict[str, Any]:
    """Values by key, those of a list each by itself: ``key_1``, ``key_2``, …; of rows ``key_1_1``, ``key_1_2``, …."""
    out: dict[str, Any] = {}
    for key, value in values.items():
        if key in law.matrices:
            if not isinstance(value, list) or not value or not all(isinstance(row, list) for row in value):
                raise InputError(f"{place}.{key}", "is no list of rows", f"write {key} = [[first, …], [second, …], …]")
            out |= {f"{key}_{i}_{j}": each for i, row in enumerate(value, 1) for j, each in enumerate(row, 1)}
        elif key not in law.arrays:
            out[key] = value
        elif isinstance(value, list):
            out |= {f"{key}_{i}": element for i, element in enumerate(value, 1)}
        else:
            raise InputError(f"{place}.{key}", "is no list", f"write {key} = [first, second, …]")
    return out


def _joined(effect: Effect) -> dict[str, Any]:
    """The parameters of an effect as a file writes them."""
    out: dict[str, Any] = {}
    for key, value in effect.parameters:
        array, _, number = key.rpartition("_")
        matrix, _, row = array.rpartition("_")
        if array in effect.law.arrays and number.isdecimal():
            out.setdefault(array, []).append(value.written())
        elif matrix in effect.law.matrices:
            rows = out.setdefault(matrix, [])
            rows.extend([] for _ in range(int(row) - len(rows)))
            rows[int(row) - 1].append(value.written())
        else:
            out[key] = value.written()
    return out


def _exists(name: str, base: System) -> bool:
    """Whether a name such as ``shafts.link`` is one of a component of the system."""
    table, _, own = name.partition(".")
    return any(part.name == own for part in getattr(base, table, ()) if table in TABLES)


def _effect_place(table: dict, possible: Collection[str], place: str, base: System) -> str:
    """The place of an effect; a list of inputs or sensors shares it."""
    several = table.get("at")
    names = several if isinstance(several, list) and several else [text(table, "at", place)]
    for name in names:
        elsewhere = isinstance(name, str) and not any(own.startswith(name.partition(".")[0]) for own in possible)
        if elsewhere and _exists(name, base):
            tables = sorted({own.partition(".")[0] for own in possible}) or ["something that this model does not have"]
            others = [kind for kind, law in sorted(EFFECTS.items()) if name in law.places(base)]
            wrong = f"{table.get('kind')} does not act at {name!r}, but at {' or '.join(tables)}"
            raise InputError(f"{place}.at", wrong, f"there act {', '.join(others)}" if others else "")
        if not isinstance(name, str) or name not in possible:
            raise unknown(str(name), list(possible), f"{place}.at")
    return shared_place(names)


def quantity(value: Any, si: str, where: str) -> Quantity:
    """A quantity as files write it: a number, ``"number unit"``, ``{value, lower, upper}`` or ``{value, tolerance}``.

    Raises
    ------
    InputError
        If it is none of these, not finite, of another unit, or its bounds cross.
    """
    if not isinstance(value, dict):
        return Quantity(to_si(value, si, where))
    keys = set(value)
    if keys not in QUANTITY_KEYS:
        raise InputError(
            where,
            f"has the keys {', '.join(sorted(map(str, keys))) or 'none'}",
            "write {value, lower, upper} or {value, tolerance}",
        )
    middle = to_si(value["value"], si, f"{where}.value")
    if "tolerance" in keys:
        tolerance = to_si(value["tolerance"], "1", f"{where}.tolerance")
        if tolerance < 0:
            raise InputError(
                f"{where}.tolerance", f"{tolerance:g} is negative", "write the relative half-width, e.g. 0.1"
            )
        if tolerance > 1:
            raise InputError(
                f"{where}.tolerance", f"{tolerance:g} is a half-width of {100 * tolerance:g} %",
                f"write the relative half-width: {tolerance / 100:g} is {tolerance:g} %; or lower and upper",
            )  # fmt: skip
        half = abs(middle) * tolerance
        low, high = middle - half, middle + half
    elif "lower" in keys:
        low, high = (to_si(value[key], si, f"{where}.{key}") for key in ("lower", "upper"))
    else:
        return Quantity(middle)
    try:
        return Quantity(middle, low, high)
    except InputError as fault:
        raise InputError(where, fault.wrong, fault.right) from None


def _needed(table: dict, key: str, place: str) -> Quantity:
    if key not in table:
        raise InputError(place, f"{key!r} is missing", f"give a number{in_unit(quantity_unit(key))}")
    return quantity(table[key], quantity_unit(key), f"{place}.{key}")


def _optional(table: dict, key: str, place: str) -> Quantity | None:
    return quantity(table[key], quantity_unit(key), f"{place}.{key}") if key in table else None


def _between(table: dict, place: str) -> tuple[str, str]:
    if "between" not in table:
        raise InputError(place, "'between' is missing", 'write between = ["first", "second"]')
    return _pair(table["between"], f"{place}.between")


def _pair(value: Any, where: str) -> tuple[str, str]:
    if not isinstance(value, list) or len(value) != 2:
        raise InputError(where, "is no pair", 'write ["first", "second"]')
    for end in value:
        if not isinstance(end, str):
            raise InputError(where, f"{type(end).__name__} where a name in quotes is expected", 'write "…"')
    return value[0], value[1]


def to_dict(system: System) -> dict[str, Any]:
    """The content of the model file of a system; :func:`from_dict` gives the same system back."""
    data: dict[str, Any] = {}
    if system.title:
        data["title"] = system.title
    if system.reference:
        data["reference"] = system.reference
    for table in TABLES:
        if parts := getattr(system, table):
            data[table] = {part.name: _fields(part, KEYS[table]) for part in parts}
    if system.mirror:
        data["mirror"] = {"pairs": [list(pair) for pair in system.mirror]}
    if system.effects:
        data["effects"] = [
            {"kind": effect.kind, "at": place_in_file(effect.at)} | _joined(effect) for effect in system.effects
        ]
    return with_dimensions(data, system)


def dumps(system: System) -> str:
    """A system as the text of a model file, in SI."""
    return tomli_w.dumps(to_dict(system))


def _fields(part: Any, keys: set[str]) -> dict[str, Any]:
    members = ("between", "ratios", "capacities", "cage", "left", "right", "sun", "carrier", "ring")
    order = (*members, "on", "measures", "reference", "of", "uncertainty", "counts", *QUANTITY_UNITS, *GEARBOX_UNITS,
             "converter")  # fmt: skip
    fields = {key: getattr(part, key) for key in order if key in keys and getattr(part, key) is not None}
    return {
        key: _written(value)
        for key, value in fields.items()
        if not (key in ("drag", "damping") and value == Quantity(0.0))
    }


def _written(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_written(each) for each in value]
    return value.written() if isinstance(value, Quantity | Converter) else value
