"""The residual vehicle model (RVM): what the vehicle has and the rig lacks, cut out of the vehicle, never retyped.

Components are the same where they carry the same name in both files. The cut runs through the shafts that both
have and that end on an inertia only the vehicle has: the shaft stays on the rig, its torque drives the residual
vehicle, and the speed of the inertia behind the cut is what the dynamometer has to follow.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from modelling.common.errors import InputError, listed
from modelling.linear.reference_motion import speeds_of, torques_of
from modelling.model.components import Effect, Input, OperatingPoint, Sensor
from modelling.model.system import System


@dataclass(frozen=True)
class Interface:
    """One cut.

    Attributes
    ----------
    shaft : str
        The shaft both have, cut at its outer end.
    vehicle_end, rig_end : str
        The inertia behind the cut in the vehicle, and the one that stands in its place on the rig.
    factor : float
        Torque that enters the inertia for 1 N·m transmitted by the shaft: 1 at its second end, −1/ratio at its first.
    """

    shaft: str
    vehicle_end: str
    rig_end: str
    factor: float

    @property
    def torque(self) -> str:
        """Name of the residual vehicle's input: the torque that the interface carries into it."""
        return f"{self.shaft}_torque"

    @property
    def speed(self) -> str:
        """Name of the residual vehicle's sensor: the speed that the dynamometer has to follow."""
        return f"{self.vehicle_end}_interface_speed"


@dataclass(frozen=True)
class ResidualVehicle:
    """The residual vehicle: a system for each connected part, interfaces to the rig, the vehicle it was cut from."""

    parts: tuple[System, ...]
    interfaces: tuple[Interface, ...]
    vehicle: System

    def part_of(self, interface: Interface) -> System:
        """The part that an interface drives."""
        return next(part for part in self.parts if any(driven.name == interface.torque for driven in part.inputs))


def cut(vehicle: System, rig: System) -> ResidualVehicle:
    """Cut the residual vehicle out of the vehicle.

    Raises
    ------
    InputError
        If the rig lacks nothing, shares nothing, or the cut cannot run through shafts both have.
    """
    on_rig = {part.name for part in rig.inertias}
    only = {part.name for part in vehicle.inertias} - on_rig
    if not only:
        raise InputError(
            "rig",
            "has every inertia of the vehicle",
            "components with one name are taken as the same; nothing is left to emulate",
        )
    if len(only) == len(vehicle.inertias):
        raise InputError(
            "rig", "shares no inertia with the vehicle", "what stands on the rig keeps the vehicle's names"
        )
    interfaces = tuple(_interfaces(vehicle, rig, only))
    if not interfaces:
        raise InputError(
            "rig",
            "shares no shaft that leads to what it lacks",
            "keep the cut shafts, e.g. the side shafts, under one name in both",
        )
    parts = []
    for group in _groups(vehicle, only):
        parts.append(_part(vehicle, group, [interface for interface in interfaces if interface.vehicle_end in group]))
    without_interface = [
        name
        for part in parts
        if not any(interface.vehicle_end in {i.name for i in part.inertias} for interface in interfaces)
        for name in (i.name for i in part.inertias)
    ]
    if without_interface:
        raise InputError(
            "vehicle",
            f"{listed(without_interface)} would hang on no interface",
            "the cut must run through shafts that both have",
        )
    return ResidualVehicle(tuple(parts), interfaces, vehicle)


def _interfaces(vehicle: System, rig: System, only: set[str]) -> Iterable[Interface]:
    shared = {shaft.name: shaft for shaft in rig.shafts}
    rigid = [(part.name, set(part.between)) for part in vehicle.gears]
    rigid += [(part.name, {part.cage, part.left, part.right}) for part in vehicle.differentials]
    for name, ends in rigid:
        if ends & only and ends - only:
            raise InputError(f"vehicle: {name}", "is a rigid joint across the cut", "put the cut through a shaft")
    for shaft in vehicle.shafts:
        beyond = [end for end in shaft.between if end in only]
        if len(beyond) != 1:
            continue
        if shaft.name not in shared:
            raise InputError(
                f"vehicle: shafts.{shaft.name}",
                f"leads to {beyond[0]!r}, which the rig lacks, and is not on the rig itself",
                "the rig must have the shaft the cut runs through, under the same name",
            )
        place = shaft.between.index(beyond[0])
        on_rig = shared[shaft.name]
        if on_rig.between[1 - place] != shaft.between[1 - place]:
            raise InputError(
                f"rig: shafts.{shaft.name}.between",
                f"starts at {on_rig.between[1 - place]!r}, in the vehicle at {shaft.between[1 - place]!r}",
                "a shared shaft keeps its inner end",
            )
        ratio = 1.0 if shaft.ratio is None else shaft.ratio.value
        yield Interface(shaft.name, beyond[0], on_rig.between[place], 1.0 if place == 1 else -1 / ratio)


def _groups(vehicle: System, only: set[str]) -> list[set[str]]:
    """Connected groups of the inertias the rig lacks, in the order of the file."""
    joined: dict[str, set[str]] = {name: set() for name in only}
    for ends in _joints(vehicle):
        inside = [end for end in ends if end in only]
        for end in inside:
            joined[end].update(inside)
    groups: list[set[str]] = []
    for part in vehicle.inertias:
        if part.name not in only or any(part.name in group for group in groups):
            continue
        group, todo = {part.name}, [part.name]
        while todo:
            new = joined[todo.pop()] - group
            group |= new
            todo.extend(new)
        groups.append(group)
    return groups


def _joints(system: System) -> Iterable[tuple[str, ...]]:
    yield from (part.between for part in system.shafts)
    yield from (part.between for part in system.gears)
    yield from ((part.cage, part.left, part.right) for part in system.differentials)


def _part(vehicle: System, group: set[str], interfaces: list[Interface]) -> System:
    def inside(*ends: str) -> bool:
        return set(ends) <= group

    shafts = tuple(part for part in vehicle.shafts if inside(*part.between))
    inputs = tuple(part for part in vehicle.inputs if part.on in group) + tuple(
        Input(interface.torque, interface.vehicle_end) for interface in interfaces
    )
    kept = (
        {f"inertias.{name}" for name in group}
        | {f"shafts.{part.name}" for part in shafts}
        | {f"inputs.{part.name}" for part in inputs}
    )
    sensors = tuple(part for part in vehicle.sensors if part.of in group or part.of in {shaft.name for shaft in shafts})
    sensors += tuple(Sensor(interface.speed, "speed", interface.vehicle_end) for interface in interfaces)
    return replace(
        vehicle,
        inertias=tuple(part for part in vehicle.inertias if part.name in group),
        shafts=shafts,
        gears=tuple(part for part in vehicle.gears if inside(*part.between)),
        differentials=tuple(part for part in vehicle.differentials if inside(part.cage, part.left, part.right)),
        inputs=inputs,
        sensors=sensors,
        mirror=tuple(pair for pair in vehicle.mirror if inside(*pair)),
        effects=tuple(effect for effect in vehicle.effects if _place(effect) in kept),
        title=f"Residual vehicle of {vehicle.title or 'the vehicle'}",
        reference="",
        operating_point=_operating_point(vehicle, group, interfaces),
    )


def _operating_point(vehicle: System, group: set[str], interfaces: list[Interface]) -> OperatingPoint | None:
    """Where the cuts turn as in the vehicle under the part's torques there; the interfaces' torques follow."""
    if vehicle.operating_point is None:
        return None
    speeds, torques = speeds_of(vehicle), torques_of(vehicle)
    return OperatingPoint(
        tuple((interface.vehicle_end, speeds[interface.vehicle_end]) for interface in interfaces),
        tuple((part.name, torques[part.name]) for part in vehicle.inputs if part.on in group),
    )


def _place(effect: Effect) -> str:
    return ".".join(effect.at.split(".")[:2])
