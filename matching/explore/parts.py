"""Parts of a model added, removed and renamed in the text of its file; comments and order of the rest stay."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Mapping
from typing import Any

import tomlkit

from matching.explore.files import Document, Keys, ModelDocument, Workspace, edited, number_or_text
from modelling.effects import EFFECTS
from modelling.effects.effect import place_in_file
from modelling.errors import InputError
from modelling.system import System
from modelling.topology import DIVIDING, joints

# What can be added: table of the new part, and what it sits at
ADDABLE = {
    "inertia on a shaft": "inertias", "shaft between inertias": "shafts", "shaft by its drawing": "shafts",
    "gear between inertias": "gears", "differential": "differentials", "planetary gear": "planetary_gears",
    "torque on an inertia": "inputs", "speed sensor of an inertia": "sensors", "torque sensor of a shaft": "sensors",
}  # fmt: skip


MEMBERS = {  # of what divides a torque: keys of the inertia it sits at, and of the second and third
    "differential": ("cage", "left", "right"), "planetary gear": ("sun", "carrier", "ring"),
}  # fmt: skip
BEGUN_LENGTH, BEGUN_DIAMETER, BEGUN_RATIO = "300 mm", "30 mm", 2.0  # of a shaft and a planetary gear, to begin with


def add_part(document: ModelDocument, kind: str, name: str, at: str, other: str = "", third: str = "") -> None:
    """Add a part.

    An inertia and the shaft that it comes with get the values of ``at`` and of the model's first shaft to begin with, a
    gear the ratio 1, a planetary gear the ratio 2, a shaft by its drawing a steel bar of 300 mm and 30 mm.

    Parameters
    ----------
    kind : str
        One of :data:`ADDABLE`.
    name : str
        Of the new part; the shaft of an inertia is called ``NAME_shaft``.
    at, other, third : str
        The inertia or shaft it sits at, the second inertia of a shaft or gear, and the third one of a differential
        (cage, left, right) or planetary gear (sun, carrier, ring).

    Raises
    ------
    InputError
        If the name is none or taken, or the model is none with the part; then nothing changes.
    """
    name, system = _name(name), document.system
    new = {f"{ADDABLE[kind]}.{name}": _content(kind, at, other, third, system)}
    if kind == "inertia on a shaft":
        new[f"shafts.{name}_shaft"] = _shaft(at, name, system)
    text = tomlkit.parse(document.text)
    for place, content in new.items():
        table, _, own = place.partition(".")
        if own in text.get(table, {}):
            raise InputError(place, "exists", "give another name")
        text.setdefault(table, tomlkit.table(is_super_table=True))[own] = content
    document.take(tomlkit.dumps(text))


def free_name(system: System, word: str) -> str:
    """A name that no part has, and with ``_shaft`` behind it none either: the word and a number."""
    taken = {place.partition(".")[2] for place in system.places()}
    return next(name for n in itertools.count(1) if not {name := f"{word}_{n}", f"{word}_{n}_shaft"} & taken)


def _name(name: str) -> str:
    bare = name.strip()
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]*", bare):
        raise InputError("name", f"{bare!r} is no name", "write letters, digits and _, a letter first")
    return bare


def _content(kind: str, at: str, other: str, third: str, system: System) -> dict[str, Any]:
    if kind == "inertia on a shaft":
        return {"J": next((part.J.value for part in system.inertias if part.name == at), 1.0)}
    if kind == "shaft between inertias":
        return _shaft(at, other, system)
    if kind == "shaft by its drawing":
        like = _shaft(at, other, system)
        return {"between": like["between"], "length": BEGUN_LENGTH, "diameter": BEGUN_DIAMETER,
                "damping": like["damping"]}  # fmt: skip
    if kind in MEMBERS:
        ends = dict(zip(MEMBERS[kind], (at, other, third), strict=True))
        return ends | ({"ratio": BEGUN_RATIO} if kind == "planetary gear" else {})
    if kind == "gear between inertias":
        return {"between": [at, other], "ratio": 1.0}
    if kind == "torque on an inertia":
        return {"on": at}
    return {"measures": kind.partition(" ")[0], "of": at}


def _shaft(first: str, second: str, system: System) -> dict[str, Any]:
    alike = system.shafts[0] if system.shafts else None
    stiffness, damping = (alike.stiffness.value, alike.damping.value) if alike else (1e4, 1.0)  # N·m/rad, N·m·s/rad
    return {"between": [first, second], "stiffness": stiffness, "damping": damping}


def remove_part(document: ModelDocument, place: str) -> list[str]:
    """Remove a part with all that hangs on it: shafts, gears, inputs, sensors, effects; their places.

    Raises
    ------
    InputError
        If the rest is no model; then nothing changes.
    """
    gone = _with_dependents(document.system, place)
    text = tomlkit.parse(document.text)
    for each in gone:
        table, _, name = each.partition(".")
        del text[table][name]  # type: ignore[union-attr]
        if not text[table]:
            del text[table]
    inertias = [each.partition(".")[2] for each in gone if each.startswith("inertias.")]
    if text.get("reference") in inertias:
        del text["reference"]
    if "mirror" in text:
        pairs = text["mirror"]["pairs"]  # type: ignore[index]
        kept = [pair for pair in pairs if not set(pair) & set(inertias)]  # type: ignore[union-attr]
        text["mirror"]["pairs"] = kept  # type: ignore[index]
    _drop_effects(text, lambda at, _: any(each in gone for each in (at if isinstance(at, list) else [at])))
    document.take(tomlkit.dumps(text))
    return gone


def _drop_effects(text: Any, dropped: Callable[[Any, str], bool]) -> None:
    """Drop effects by place and kind from the content of a file, and the list with the last of them."""
    effects = text.get("effects", [])
    for number in range(len(effects) - 1, -1, -1):
        if dropped(effects[number]["at"], effects[number]["kind"]):
            del effects[number]
    if "effects" in text and not effects:
        del text["effects"]


def _with_dependents(system: System, place: str) -> list[str]:
    table, _, name = place.partition(".")
    gone = [place]
    if table == "inertias":
        for own in ("shafts", "gears", "gearboxes"):
            for part in getattr(system, own):
                if name in part.between:
                    gone += _with_dependents(system, f"{own}.{part.name}")
        gone += [joint.place for joint in joints(system, *DIVIDING) if name in joint.ends]
        gone += [f"inputs.{part.name}" for part in system.inputs if part.on == name]
    if table == "gearboxes":
        gone += [f"inputs.{capacity}" for part in system.gearboxes if part.name == name for capacity in part.capacities]
    if table in ("inertias", "shafts"):
        of_shaft = table == "shafts"
        gone += [f"sensors.{part.name}" for part in system.sensors
                 if part.of == name and (part.measures == "torque") == of_shaft]  # fmt: skip
    return list(dict.fromkeys(gone))


# --- Effects at a part.


def effects_for(system: System, place: str) -> dict[str, dict[str, str]]:
    """Kinds of effect that can be added at a part by typing numbers: SI units of what each needs, by its key.

    Tables, effects with a value for every recording, and those of two places are written in the file.
    """
    there = {effect.kind for effect in system.effects if effect.at == place}
    kinds = {kind: law for kind, law in EFFECTS.items() if not (law.arrays or law.follows or law.by_recording)}
    return {
        kind: {key: law.unit(key, place, system) for key, own in law.parameters.items() if not own.optional}
        for kind, law in kinds.items()
        if kind not in there and place in law.places(system)
    }


def add_effect(document: ModelDocument, kind: str, place: str, values: Mapping[str, str]) -> None:
    """Add an effect at a part with the values that were typed, by key.

    Raises
    ------
    InputError
        If a value is missing or wrong, or the model is none with the effect; then nothing changes.
    """
    if missing := [key for key in effects_for(document.system, place).get(kind, {}) if not values.get(key, "").strip()]:
        raise InputError(f"{place}.{kind}.{missing[0]}", "is empty", "enter a value, with its unit or in the one shown")
    table = tomlkit.table()
    table.update({"kind": kind, "at": place} | {key: number_or_text(text) for key, text in values.items()})
    text = tomlkit.parse(document.text)
    text.setdefault("effects", tomlkit.aot()).append(table)
    document.take(tomlkit.dumps(text))


def remove_effect(document: ModelDocument, kind: str, at: str) -> None:
    """Remove the effect of a kind at a place."""
    text = tomlkit.parse(document.text)
    _drop_effects(text, lambda *found: found == (place_in_file(at), kind))
    document.take(tomlkit.dumps(text))


# --- A part with another name, in every open file that names it.


def rename_part(workspace: Workspace, role: str, place: str, new: str) -> list[str]:
    """Give a part another name: in its model, in the other model of a case where it is the same part, and in the case.

    Returns the names of the changed files. One *Undo* takes all of it back.

    Raises
    ------
    InputError
        If the name is none or taken; then nothing changes.
    """
    new, (table, _, old) = _name(new), place.partition(".")
    models = [own for key, own in workspace.models.items() if key == role or place in own.system.places()]
    if any(f"{table}.{new}" in own.system.places() for own in models):
        raise InputError(f"{table}.{new}", "exists", "give another name")
    together: list[Document] = []
    texts = [
        (model, _renamed(model.text, table, old, new, _in_model(model.content, table, old, new))) for model in models
    ]
    for model, text in texts:
        model.take(text, together)
        together.append(model)
    if workspace.case is not None:
        text = workspace.case.text
        for own in ("manoeuvre", "operating_point") if table in ("inputs", "inertias") else ():
            text = _renamed_key(text, own, old, new)
        text = re.sub(rf"(?<=[\"'.]){table}\.{re.escape(old)}(?=[.\"'])", f"{table}.{new}", text)
        text = edited(text, _in_case(tomlkit.parse(text).unwrap(), table, old, new))
        if text != workspace.case.text:
            workspace.case.change_text(text, together)
            together.append(workspace.case)
    return [document.path.name for document in together]


def _renamed(text: str, table: str, old: str, new: str, values: Mapping[Keys, Any]) -> str:
    text = _renamed_key(edited(text, values), table, old, new)
    if new not in tomlkit.parse(text).unwrap().get(table, {}):
        raise InputError(f"{table}.{old}", "is written in a way that cannot be renamed here", "rename it in the file")
    return text


def _renamed_key(text: str, table: str, old: str, new: str) -> str:
    """The text with another key in a table, which stands in a header, below the table's own header, or is dotted."""
    name = rf"(?:{re.escape(old)}|\"{re.escape(old)}\"|'{re.escape(old)}')"
    lines, here = text.splitlines(keepends=True), ""
    for number, line in enumerate(lines):
        if header := re.match(r"\s*\[\[?\s*([^\]]+?)\s*\]", line):
            here = header[1].replace(" ", "")
            lines[number] = re.sub(rf"^(\s*\[\s*{table}\s*\.\s*){name}(?=\s*[.\]])", rf"\g<1>{new}", line)
        elif here == table:
            lines[number] = re.sub(rf"^(\s*){name}(?=\s*[.=])", rf"\g<1>{new}", line)
        elif not here:
            lines[number] = re.sub(rf"^(\s*{table}\s*\.\s*){name}(?=\s*[.=])", rf"\g<1>{new}", line)
    return "".join(lines)


def _in_model(content: Mapping[str, Any], table: str, old: str, new: str) -> dict[Keys, Any]:
    """What in a model names a part, by where it stands: the new value."""
    values: dict[Keys, Any] = {}

    def same(keys: Keys, value: Any) -> None:
        if value == old:
            values[keys] = new
        elif isinstance(value, list) and old in value:
            values[keys] = [new if each == old else each for each in value]

    if table == "inertias":
        same(("reference",), content.get("reference"))
        ends = {
            "shafts": ("between",), "gears": ("between",), "gearboxes": ("between",),
            "differentials": ("cage", "left", "right"), "planetary_gears": ("sun", "carrier", "ring"),
            "inputs": ("on",),
        }  # fmt: skip
        for own, keys in ends.items():
            for name, part in content.get(own, {}).items():
                for key in keys:
                    same((own, name, key), part.get(key))
        pairs = content.get("mirror", {}).get("pairs", [])
        if any(old in pair for pair in pairs):
            values["mirror", "pairs"] = [[new if each == old else each for each in pair] for pair in pairs]
    if table == "inputs":
        for name, part in content.get("gearboxes", {}).items():
            same(("gearboxes", name, "capacities"), part.get("capacities"))
    if table in ("inertias", "shafts"):
        for name, part in content.get("sensors", {}).items():
            if (part.get("measures") == "torque") == (table == "shafts"):
                same(("sensors", name, "of"), part.get("of"))
    for number, effect in enumerate(content.get("effects", [])):
        at, place = effect.get("at"), f"{table}.{old}"
        if at == place:
            values["effects", number, "at"] = f"{table}.{new}"
        elif isinstance(at, list) and place in at:
            values["effects", number, "at"] = [f"{table}.{new}" if each == place else each for each in at]
    return values


NAMED_IN_CASE = {  # keys of a case whose values name parts of a table
    "shafts": {"follows"}, "inputs": {"torque_input", "input", "knows"},
    "sensors": {"torque_sensor", "speed_sensor", "sensor", "measures"},
}  # fmt: skip


def _in_case(content: Any, table: str, old: str, new: str, above: Keys = ()) -> dict[Keys, Any]:
    values: dict[Keys, Any] = {}
    entries = content.items() if isinstance(content, Mapping) else enumerate(content)
    for key, value in entries:
        if isinstance(value, Mapping) or (isinstance(value, list) and value and isinstance(value[0], Mapping)):
            values |= _in_case(value, table, old, new, (*above, key))
        elif key in NAMED_IN_CASE.get(table, ()):
            if value == old:
                values[(*above, key)] = new
            elif isinstance(value, list) and old in value:
                values[(*above, key)] = [new if each == old else each for each in value]
    return values
