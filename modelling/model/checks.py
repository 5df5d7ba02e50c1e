"""Checks that components make a system: names, ends, signs, and that all are connected."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping

from modelling.common.errors import InputError, listed, unknown
from modelling.effects import EFFECTS, Kind
from modelling.model.components import TABLES, Components, Effect, Sensor
from modelling.model.quantity import Quantity
from modelling.units import INPUT_UNITS, SENSOR_UNITS, in_unit

MOST_COMPONENTS = 10_000  # a chain of 3000 inertias has 6000; a model of them takes some ten seconds
_NAME = re.compile(r"\w[\w-]{0,199}")


def check(system: Components) -> None:
    """Check values, references and connections of a system.

    Raises
    ------
    InputError
        Naming the key that is wrong.
    """
    if not system.inertias:
        raise InputError("inertias", "the model has none", "at least one [inertias.NAME] with J is needed")
    size = sum(len(getattr(system, table)) for table in (*TABLES, "effects"))
    if size > MOST_COMPONENTS:
        raise InputError("model", f"has {size} components and effects", f"at most {MOST_COMPONENTS} are handled")
    _names(system)
    inertias = dict.fromkeys(part.name for part in system.inertias)
    for part in system.inertias:
        _sign(f"inertias.{part.name}.J", part.J, positive=True)
        _sign(f"inertias.{part.name}.drag", part.drag)
    for shaft in system.shafts:
        _ends(f"shafts.{shaft.name}.between", shaft.between, inertias)
        _sign(f"shafts.{shaft.name}.stiffness", shaft.stiffness)
        _sign(f"shafts.{shaft.name}.damping", shaft.damping)
        _ratio(f"shafts.{shaft.name}.ratio", shaft.ratio)
    for gear in system.gears:
        _ends(f"gears.{gear.name}.between", gear.between, inertias)
        _ratio(f"gears.{gear.name}.ratio", gear.ratio)
    for differential in system.differentials:
        ends = (differential.cage, differential.left, differential.right)
        _ends(f"differentials.{differential.name}", ends, inertias)
    for source in system.inputs:
        if source.on not in inertias:
            raise unknown(source.on, list(inertias), f"inputs.{source.name}.on")
    _imposed(system)
    shafts = dict.fromkeys(part.name for part in system.shafts)
    for sensor in system.sensors:
        _sensor(sensor, shafts if sensor.measures == "torque" else inertias)
    for pair in system.mirror:
        _ends("mirror.pairs", pair, inertias)
    mirrored = [name for pair in system.mirror for name in pair]
    if len(set(mirrored)) < len(mirrored):
        raise InputError("mirror.pairs", "an inertia stands in two pairs", "each inertia has one mirror image")
    if system.reference and system.reference not in inertias:
        raise unknown(system.reference, list(inertias), "reference")
    _effects(system)
    _connected(system, inertias)
    _operating_point(system, inertias)


def _names(system: Components) -> None:
    for table in TABLES:
        names = set()
        for part in getattr(system, table):
            if not _NAME.fullmatch(part.name):
                raise InputError(
                    f"{table}.{part.name[:40]!r}", "is no usable name", "use up to 200 letters, digits, _ and -"
                )
            if part.name in names:
                raise InputError(f"{table}.{part.name}", "the name is taken twice", "names must differ within a table")
            names.add(part.name)
    both = {part.name for part in system.inputs} & {part.name for part in system.sensors}
    if both:
        raise InputError(
            f"sensors.{min(both)}", "an input has the same name", "inputs and sensors share the columns of a recording"
        )
    taken = {source.name for source in system.inputs} | {sensor.name for sensor in system.sensors}
    for source in system.inputs:
        if source.reference in taken:
            raise InputError(
                f"inputs.{source.name}.reference", f"{source.reference!r} is an input or a sensor",
                "name the channel with what the controller was to follow",
            )  # fmt: skip


def _sign(where: str, quantity: Quantity, positive: bool = False) -> None:
    low = quantity.value if quantity.lower is None else min(quantity.lower, quantity.value)
    if low < 0 or (positive and low == 0):
        bound = "greater than 0" if positive else "0 or more"
        raise InputError(where, f"{low:g} is not possible", f"{bound} is needed")


def _ratio(where: str, quantity: Quantity | None) -> None:
    if quantity is None:
        return
    low, high = (quantity.value if end is None else end for end in (quantity.lower, quantity.upper))
    if low <= 0 <= high:
        raise InputError(where, "a ratio of 0 connects nothing", "write speed(first)/speed(second)")


def _ends(where: str, ends: tuple[str, ...], inertias: Collection[str]) -> None:
    for end in ends:
        if end not in inertias:
            raise unknown(end, list(inertias), where)
    if len(set(ends)) < len(ends):
        raise InputError(where, f"joins {ends[0]!r} to itself", "name different inertias")


def _imposed(system: Components) -> None:
    """Check that inputs measure a motion only where it is imposed, and one each."""
    imposed = {e.at.split(".")[1] for e in system.effects if e.kind in EFFECTS and EFFECTS[e.kind].imposes_motion}
    driven = set[str]()
    for source in system.inputs:
        if source.measures not in (None, *INPUT_UNITS):
            raise unknown(str(source.measures), list(INPUT_UNITS), f"inputs.{source.name}.measures")
        if source.measures in (None, "torque") and not (source.measures is None and source.on in imposed):
            continue
        where = f"inputs.{source.name}"
        if source.on not in imposed:
            right = f"[[effects]] imposed_motion at inertias.{source.on}, or a torque"
            raise InputError(f"{where}.measures", f"nothing imposes the motion of {source.on!r}", right)
        if source.on in driven:
            raise InputError(f"{where}.on", f"the motion of {source.on!r} is recorded twice", "one input for it")
        driven.add(source.on)


def _sensor(part: Sensor, known: Collection[str]) -> None:
    where = f"sensors.{part.name}"
    if part.measures not in SENSOR_UNITS:
        raise unknown(part.measures, list(SENSOR_UNITS), f"{where}.measures")
    if part.of not in known:
        raise unknown(part.of, list(known), f"{where}.of")
    if part.uncertainty is not None and not part.uncertainty > 0:
        raise InputError(f"{where}.uncertainty", f"{part.uncertainty:g} is not possible", "greater than 0 is needed")


def _effects(system: Components) -> None:
    names = set[tuple[str, str]]()
    places: dict[str, dict[str, None]] = {}
    for number, effect in enumerate(system.effects, 1):
        where = f"effects[{number}]"
        if effect.kind not in EFFECTS:
            raise unknown(effect.kind, sorted(EFFECTS), f"{where}.kind")
        kind = EFFECTS[effect.kind]
        if effect.kind not in places:
            places[effect.kind] = dict.fromkeys(kind.places(system))
        for place in effect.places:
            if place not in places[effect.kind]:
                raise unknown(place, list(places[effect.kind]), f"{where}.at")
        if len(effect.places) > 1 or kind.follows:
            _shared(kind, effect, where)
        _effect(kind, effect, system, where)
        for place in effect.places:
            if (effect.kind, place) in names:
                raise InputError(where, f"{effect.kind} stands twice at {place}", "one of a kind at a place")
            names.add((effect.kind, place))


def _shared(kind: Kind, effect: Effect, where: str) -> None:
    """Check that several places can share an effect.

    Raises
    ------
    InputError
        If the kind cannot be shared, or a place stands twice.
    """
    if kind.follows:
        _followed(effect, where)
    elif not kind.shareable:
        shareable = listed(sorted(name for name, other in EFFECTS.items() if other.shareable))
        raise InputError(
            f"{where}.at", f"{effect.kind} cannot be shared by several places", f"one place; {shareable} can"
        )
    if len(set(effect.places)) < len(effect.places):
        raise InputError(f"{where}.at", "names a place twice", "each place once")


def _followed(effect: Effect, where: str) -> None:
    """Check that an effect names the inertia it acts on and the one it follows.

    Raises
    ------
    InputError
        If these are not two.
    """
    if len(effect.places) != 2:
        raise InputError(
            f"{where}.at", f"{effect.kind} needs two inertias", 'at = ["inertias.acted_on", "inertias.followed"]'
        )


def _effect(kind: Kind, effect: Effect, system: Components, where: str) -> None:
    """Check keys and bounds of one effect.

    Raises
    ------
    InputError
        Naming the key that is wrong.
    """
    quantities = dict(effect.parameters)
    for key in quantities:
        if key not in kind.parameters:
            raise unknown(key, list(kind.parameters), f"{where} ({effect.kind})")
    for key, parameter in kind.parameters.items():
        if key not in quantities:
            if parameter.optional:
                continue
            raise InputError(
                f"{where} ({effect.kind})",
                f"{key!r} is missing",
                f"give a number{in_unit(kind.unit(key, effect.at, system))}",
            )
        value = quantities[key].value
        if not parameter.lower <= value <= parameter.upper:
            raise InputError(
                f"{where}.{key}",
                f"{value:g} is not possible",
                f"{parameter.lower:g} … {parameter.upper:g} is needed",
            )
    if fault := kind.fault(effect.at, {key: quantity.value for key, quantity in quantities.items()}):
        raise InputError(f"{where} ({effect.kind})", fault, "see docs/files.md")


def _connected(system: Components, inertias: Collection[str]) -> None:
    joined: dict[str, set[str]] = {name: set() for name in inertias}
    for first, second in [part.between for part in system.shafts] + [part.between for part in system.gears]:
        joined[first].add(second)
        joined[second].add(first)
    for part in system.differentials:
        for end in (part.left, part.right):
            joined[part.cage].add(end)
            joined[end].add(part.cage)
    groups: list[set[str]] = []
    for name in inertias:
        if not any(name in group for group in groups):
            groups.append(_reached(name, joined))
    driven = {source.on for source in system.inputs}
    apart = [name for group in groups[1:] if not group & driven for name in inertias if name in group]
    if apart or (len(groups) > 1 and not groups[0] & driven):
        raise InputError(
            "inertias",
            f"{listed(apart or list(groups[1]))} are not connected to {next(iter(inertias))!r}",
            "add the missing shaft or gear; parts that stand apart each need an input that drives them",
        )


def _reached(start: str, joined: Mapping[str, set[str]]) -> set[str]:
    """All that is connected to an inertia, itself included."""
    reached, todo = {start}, [start]
    while todo:
        new = joined[todo.pop()] - reached
        reached |= new
        todo.extend(new)
    return reached


def _operating_point(system: Components, inertias: Collection[str]) -> None:
    point, inputs = system.operating_point, [source.name for source in system.inputs]
    for name, _ in point.speeds if point else ():
        if name not in inertias:
            raise unknown(name, list(inertias), "operating_point.speed")
    for name, _ in point.torques if point else ():
        if name not in inputs:
            raise unknown(name, inputs, "operating_point.torque")
