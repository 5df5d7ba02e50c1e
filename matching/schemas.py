"""JSON schemas of the input files, made from the tables by which the readers check keys, units and choices.

Editors complete and check a TOML file by the schema that its first line names, ``#:schema schemas/model.json``
(Taplo, Even Better TOML). ``rigmatch new`` writes them beside the files of the starter case.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable, Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from matching import fidelity
from matching import key_meanings as meanings
from matching.match import case_file
from matching.match.case import LIMITS_OF_ALL, Target
from matching.match.requirements import LIMIT_UNITS, OPENED_SHAFTS, TORQUE_OVER_SPEED
from matching.uncertainty import budget
from matching.uncertainty.budget import NAMES as DISTRIBUTIONS
from modelling import model_file, system
from modelling.bed.bed import HARDWARE, OWN_TIMES
from modelling.bed.controllers import DEFAULT, STRUCTURES
from modelling.bed.manoeuvres import KINDS as MANOEUVRES
from modelling.bed.manoeuvres import UNITS as MANOEUVRE_UNITS
from modelling.bed.profile import UNITS as DRIVER_UNITS
from modelling.bed.specimen import SPECIMENS
from modelling.effects import EFFECTS
from modelling.errors import InputError
from modelling.fidelity.measures import ARITHMETICS, DYNAMIC_DOMAINS, MEASUREMENT_DOMAIN, NRMSE_FORMS
from modelling.recordings import read as recordings
from modelling.units import GEARBOX_UNITS, INPUT_UNITS, QUANTITY_UNITS, SENSOR_UNITS
from modelling.writing import write_all

Schema = dict[str, Any]

TEXT: Schema = {"type": "string"}
NUMBER: Schema = {"type": "number"}
VALUE: Schema = {"type": ["number", "string"]}  # SI, or a text with a unit
NAMES: Schema = {"type": "array", "items": TEXT}
PAIR: Schema = {"type": "array", "items": TEXT, "minItems": 2, "maxItems": 2}
READINGS: Schema = {"type": "array", "items": NUMBER}
COMPONENTS = {
    "inertias": system.Inertia, "shafts": system.Shaft, "gears": system.Gear, "gearboxes": system.Gearbox,
    "differentials": system.Differential, "planetary_gears": system.PlanetaryGear, "inputs": system.Input,
    "sensors": system.Sensor,
}  # fmt: skip


def table(properties: Mapping[str, Schema], required: Iterable[str] = (), **more: Any) -> Schema:
    """A table with these keys and no others, unless ``additionalProperties`` says so."""
    needed = {"required": sorted(required)} if required else {}
    return {"type": "object", "properties": dict(properties), "additionalProperties": False, **needed, **more}


def by_name(entry: Schema) -> Schema:
    """A table whose keys are names of the user's."""
    return {"type": "object", "additionalProperties": entry}


def quantity(unit: str = "") -> Schema:
    """A number, a text with a unit, or a table with a range; see :func:`modelling.model_file.quantity`."""
    ranged = [table(dict.fromkeys(sorted(keys), VALUE), keys) for keys in model_file.QUANTITY_KEYS]
    return {"anyOf": [VALUE, *ranged], "description": f"SI unit: {unit}" if unit not in ("", "1") else "a pure number"}


def value(unit: str) -> Schema:
    """A number in SI or a text with a unit."""
    return VALUE | {"description": f"SI unit: {unit}" if unit != "1" else "a pure number"}


def described(properties: Mapping[str, Schema], meaning: Mapping[str, str]) -> dict[str, Schema]:
    """The same with what each key means before its unit."""
    return {
        key: own | {"description": "; ".join(filter(None, (meaning.get(key, ""), own.get("description", ""))))}
        for key, own in properties.items()
    }


def required_fields(component: type) -> set[str]:
    """Fields of a dataclass without a default, which a file has to give; the name is the table's."""
    fields = dataclasses.fields(component)
    return {field.name for field in fields if field.default is dataclasses.MISSING} - {"name"}


def _component(name: str) -> Schema:
    special = {
        "between": PAIR,
        "measures": {"enum": list(SENSOR_UNITS if name == "sensors" else INPUT_UNITS)},
        "uncertainty": VALUE,
        "counts": VALUE,
        "capacities": NAMES,
        "ratios": {"type": "array", "minItems": 1, "items": quantity("1")},
        "converter": table(
            {
                key: {"type": "array", "minItems": 2, "items": value(unit)}
                for key, unit in model_file.CONVERTER_UNITS.items()
            },
            model_file.CONVERTER_UNITS,
        ),
    }
    units = QUANTITY_UNITS | GEARBOX_UNITS
    keys = {
        key: special.get(key) or (quantity(units[key]) if key in units else TEXT)
        for key in sorted(model_file.KEYS[name])
    }
    drawn: Mapping[str, tuple[str, float | None]] = model_file.BY_DRAWING.get(name, {})
    keys |= {key: quantity(unit) for key, (unit, _) in drawn.items()}
    needed = required_fields(COMPONENTS[name]) - ({"stiffness"} if "length" in drawn else set())
    made = table(described(keys, meanings.MODEL_TABLES[name]), needed)
    if "length" in drawn:
        made["anyOf"] = [{"required": ["stiffness"]}, {"required": ["diameter", "length"]}]
    return by_name(made)


def _effect(kind: str) -> Schema:
    law = EFFECTS[kind]
    keys = {
        key: {"type": "array", "items": {"type": "array", "items": quantity()}} if key in law.matrices
        else {"type": "array", "items": quantity()} if key in law.arrays else quantity(law.parameters[key].unit or "")
        for key in law.file_keys
    }  # fmt: skip
    return table({"kind": {"const": kind}, "at": {"anyOf": [TEXT, NAMES]}, **keys}, ("kind", "at"))


def _model() -> Schema:
    keys = {name: _component(name) for name in system.TABLES} | {
        "title": TEXT, "reference": TEXT, "mirror": table({"pairs": {"type": "array", "items": PAIR}}),
        "effects": {"type": "array", "items": {"oneOf": [_effect(kind) for kind in sorted(EFFECTS)]}},
    }  # fmt: skip
    return table(described({key: keys[key] for key in sorted(model_file.TOP)}, meanings.MODEL))


def _loop(structure: str) -> Schema:
    known = {**HARDWARE, **STRUCTURES[structure].quantities}
    keys = {name: quantity(own.unit) | {"description": f"{own.meaning}; {own.unit}"} for name, own in known.items()}
    named = {"structure": {"const": structure}, "knows": NAMES, "measures": NAMES, "fixed": {"type": "boolean"}}
    named |= {"specimen": {"enum": list(SPECIMENS)}} if STRUCTURES[structure].is_observer else {}
    return table(named | keys, () if structure == DEFAULT else ("structure",))


def _manoeuvre() -> Schema:
    kinds = [
        table(
            {"kind": {"const": kind}}
            | {field.name: value(MANOEUVRE_UNITS[field.name]) for field in dataclasses.fields(law)},
            required_fields(law) | {"kind"},
        )
        for kind, law in MANOEUVRES.items()
    ]
    return {"anyOf": [*kinds, {"type": "array"}, {"type": "object", "required": ["file"]}]}


def _case() -> Schema:
    known = {key: value(unit) for key, unit in LIMIT_UNITS.items()} | {OPENED_SHAFTS: {"type": "boolean"}}
    limits = described(known, meanings.LIMITS)
    road_load = table({key: value(unit) for key, unit in case_file.ROAD_LOAD.items()})
    response: dict[str, Schema] = {"band": {"type": "array", "items": VALUE, "minItems": 2, "maxItems": 2},
                "compare": {"type": "array", "minItems": 1,
                            "items": table({"input": TEXT, "sensor": TEXT}, ("input", "sensor"))},
                **dict.fromkeys(case_file.TOLERANCES, VALUE)}  # fmt: skip
    dynamometer = dict.fromkeys(case_file.DYNAMOMETER_KEYS, TEXT) | {"torque_gain": VALUE}
    dynamometer |= dict.fromkeys(OWN_TIMES, value("s"))
    of_dynamometer = [key for key in case_file.DYNAMOMETER_KEYS if key != case_file.MAY_LACK]
    targets = {field.name: VALUE for field in dataclasses.fields(Target)} | {"mode": {"type": "integer", "minimum": 1}}
    keys = {
        "title": TEXT, "vehicle": TEXT, "rig": TEXT, "residual_vehicle": table({"model": TEXT}, ("model",)),
        "dynamometers": by_name(table(dynamometer, of_dynamometer)),
        "loop": {"anyOf": [_loop(name) for name in STRUCTURES]},
        "targets": {"type": "array", "minItems": 1, "items": table(targets, ("mode",))},
        "response": table(response, ("compare",)),
        "manoeuvre": by_name(_manoeuvre()),
        "limits": table(limits | {TORQUE_OVER_SPEED: {"type": "array"}},
                        patternProperties={r"^shafts\..+\.(torque|twist|shear_stress|shear_stress_amplitude)$": VALUE,
                                           rf"^dynamometers\..+\.({'|'.join(LIMITS_OF_ALL)})$": VALUE}),
        "move": by_name(table(
            dict.fromkeys(sorted(case_file.MOVE_KEYS), VALUE)
            | {"catalogue": {"type": "array", "minItems": 1, "items": VALUE}, "step": VALUE}, ("lower", "upper"),
        )),
        "operating_point": {"type": "object", "properties": described(
            {"vehicle_speed": value("m/s"), "rolling_radius": value("m"), "road_load": road_load}, meanings.OPERATING)},
        "operating_range": table(described(
            {"vehicle_speed": {"type": "array", "minItems": 2, "maxItems": 2, "items": value("m/s")},
             "rolling_radius": value("m"), "road_load": road_load}, meanings.RANGE),
            ("vehicle_speed", "rolling_radius")),
        "drives": {"type": "array", "items": {"type": "object", "properties": described(
            {"title": TEXT, "vehicle_speed": value("m/s"), "profile": TEXT,
             "driver": table(
                 {"input": TEXT, "brakes": NAMES} | {key: value(unit) for key, unit in DRIVER_UNITS.items()})},
            meanings.DRIVE)}},
        "uncertainty": {"type": "object"},
        "vehicle_in_the_loop": table(described(
            {"fmu": TEXT, "torques": by_name(TEXT), "speeds": by_name(TEXT), "inputs": by_name(TEXT),
             "step": value("s"), "late": {"type": "integer", "minimum": 0, "maximum": 100}}, meanings.VEHICLE),
            ("fmu", "torques", "speeds")),
    }  # fmt: skip
    needed = ("vehicle", "rig", "dynamometers", "targets", "response", "manoeuvre")
    return table(described({key: keys[key] for key in sorted(case_file.TOP)}, meanings.CASE), needed)


def _budget() -> Schema:
    measurand = table(dict.fromkeys(("name", "formula", "unit", "description"), TEXT), ("formula",))
    texts = ("unit", "simultaneous", "cause", "description")
    inputs = dict.fromkeys(budget.KNOWN, NUMBER) | dict.fromkeys(texts, TEXT)
    inputs |= {"readings": READINGS, "distribution": {"enum": list(DISTRIBUTIONS)}}
    line = dict.fromkeys(budget.LINE, TEXT) | {"abscissa": READINGS, "ordinate": READINGS, "origin": NUMBER}
    keys = {
        "title": TEXT, "coverage": NUMBER, "coverage_factor": NUMBER, "measurand": measurand,
        "measurands": by_name(measurand), "inputs": by_name(table(described(inputs, meanings.INPUT))),
        "correlations": {"type": "array", "items": table({"between": PAIR, "r": NUMBER}, ("between", "r"))},
        "lines": by_name(table(described(line, meanings.LINE), ("abscissa", "ordinate"))),
    }  # fmt: skip
    return table(described({key: keys[key] for key in budget.TOP}, meanings.BUDGET))


def _fidelity() -> Schema:
    signal = dict.fromkeys((*fidelity.STATED_KEYS, *fidelity.MEASURED_KEYS), VALUE)
    sensor = dict.fromkeys(fidelity.SENSOR_KEYS, VALUE)
    signals = by_name(table(described(signal, meanings.FIDELITY_SIGNAL)))
    keys: dict[str, Schema] = {
        "title": TEXT, "f_max": VALUE, "longest_delay": VALUE, "weights": by_name(NUMBER),
        "recordings": table(dict.fromkeys(fidelity.RECORDING_KEYS, TEXT)),
        "arithmetic": {"enum": list(ARITHMETICS)}, "nrmse": {"enum": list(NRMSE_FORMS)},
        MEASUREMENT_DOMAIN: by_name(table(described(sensor, meanings.FIDELITY_SENSOR))),
    }  # fmt: skip
    keys |= dict.fromkeys(DYNAMIC_DOMAINS, signals)
    return table(described({key: keys[key] for key in fidelity.KEYS}, meanings.FIDELITY))


def _channels() -> Schema:
    keys = dict.fromkeys(recordings.KEYS, VALUE) | {"channel": TEXT, "unit": TEXT, "sign": {"enum": [1, -1]}}
    channel = table(described(keys | {"group": {"type": "integer", "minimum": 0}}, meanings.CHANNEL), ("channel",))
    top = dict.fromkeys(recordings.FILE_KEYS, VALUE) | {"channels": by_name({"anyOf": [TEXT, channel]})}
    return table(top | {"header": {"type": "integer", "minimum": 1}})


MAKERS = {"model": _model, "case": _case, "budget": _budget, "fidelity": _fidelity, "channels": _channels}


def schemas() -> dict[str, Schema]:
    """The JSON schema of every kind of input file, by its name: model, case, budget, fidelity, channels."""
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema"}
    return {kind: head | {"title": f"rigmatch: {kind} file"} | make() for kind, make in MAKERS.items()}


def schema_files() -> dict[str, str]:
    """Texts of ``schemas/KIND.json``."""
    return {f"schemas/{kind}.json": json.dumps(made, indent=1, sort_keys=True) for kind, made in schemas().items()}


def write_starter(target: Path) -> list[Path]:
    """Write the starter case with the schemas, see :func:`matching.api.new`; the files."""
    if target.is_dir() and any(target.iterdir()):
        raise InputError(str(target), "is not empty", "name a new or an empty directory")
    if target.exists() and not target.is_dir():
        raise InputError(str(target), "is a file", "name a new or an empty directory")
    starter = {part.name: part.read_text(encoding="utf-8") for part in files("matching").joinpath("starter").iterdir()}
    starter |= schema_files()
    write_all(target, dict(sorted(starter.items())))
    return [target / name for name in sorted(starter)]
