"""What beds emulate: the residual vehicle cut out of the vehicle; feed-forward across the dead time; torque curves."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from modelling.effects.sensors_and_actuators import AllPass
from modelling.errors import InputError, listed
from modelling.linear.steady_motion import speeds_of, torques_of
from modelling.system import Effect, Input, OperatingPoint, Quantity, Sensor, System
from modelling.topology import Joint, connected_parts, joints
from modelling.units import to_si

# --- The model-based feed-forward: a model of rig and vehicle that commands the dynamometers ahead of the dead time.
#
# It runs in the controller on measured torques. :mod:`modelling.bed.controllers` makes it.


@dataclass(frozen=True)
class FeedForward:
    """Rig, actuators and residual vehicle in discrete time, with the optimal feedback on the predicted state.

    State ξ: ξ⁺ = A·ξ + B·u(k − delay) + W·w, y = C·ξ + D·w. Torques vary linearly between samples: then ξ, which is
    [x; commands of the last step] less what the newest torques did, is exact (first-order hold).

    Attributes
    ----------
    A, B, W, C, D : ndarray
        (x, x), (x, u), (x, w), (y, x), (y, w).
    F, G : ndarray (u, x), (u, w)
        u(k) = −F·ξ(k + delay) − G·w(k), with ξ predicted.
    delay : int
        Whole samples of dead time; the rest of it is in A and B.
    sample_time : float
        s.
    measured, outputs : tuple of str
        Names of w and y: the rig's sensors, each dynamometer's lagged torque ``NAME torque`` and speed ``NAME speed``.
    """

    A: np.ndarray
    B: np.ndarray
    W: np.ndarray
    C: np.ndarray
    D: np.ndarray
    F: np.ndarray
    G: np.ndarray
    delay: int
    sample_time: float
    measured: tuple[str, ...]
    outputs: tuple[str, ...]

    def gains(self) -> tuple[np.ndarray, np.ndarray]:
        """Gains of the command on what is known now: (u, x + delay·u) on [state; commands on their way], (u, w).

        Commands on their way stand oldest first: the prediction across the dead time in one product.
        """
        powers = [np.eye(len(self.A))]
        for _ in range(self.delay):
            powers.append(self.A @ powers[-1])
        pending = [power @ self.B for power in reversed(powers[:-1])]
        held = sum((power @ self.W for power in powers[:-1]), np.zeros_like(self.W))
        return -self.F @ np.hstack([powers[-1], *pending]), -self.F @ held - self.G


# --- The residual vehicle model (RVM): what the vehicle has and the rig lacks, cut out of the vehicle, never retyped.
#
# Components are the same where they carry the same name in both files. The cut runs through the shafts that both
# have and that end on an inertia only the vehicle has: the shaft stays on the rig, its torque drives the residual
# vehicle, and the speed of the inertia behind the cut is what the dynamometer has to follow.


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

    def cut_at(self, shaft: str) -> Interface:
        """The interface whose cut runs through a shaft."""
        return next(cut for cut in self.interfaces if cut.shaft == shaft)

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
    names = [part.name for part in vehicle.inertias if part.name in only]
    clutches = [Joint(f"gearboxes.{box.name}", box.between) for box in vehicle.gearboxes]
    for group in map(set, connected_parts(names, [*joints(vehicle), *clutches])):
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
    for joint in joints(vehicle):
        ends = set(joint.ends)
        if joint.rigid and ends & only and ends - only:
            raise InputError(
                f"vehicle: {joint.place}", "is a rigid joint across the cut", "put the cut through a shaft"
            )
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
        gearboxes=tuple(part for part in vehicle.gearboxes if inside(*part.between)),
        differentials=tuple(part for part in vehicle.differentials if inside(*part.ends)),
        planetary_gears=tuple(part for part in vehicle.planetary_gears if inside(*part.ends)),
        inputs=inputs,
        sensors=sensors,
        mirror=tuple(pair for pair in vehicle.mirror if inside(*pair)),
        effects=tuple(effect for effect in vehicle.effects if _place(effect) in kept),
        title=f"Residual vehicle of {vehicle.title or 'the vehicle'}",
        reference="",
        operating_point=_operating_point(vehicle, group, interfaces),
    )


# --- The specimen alone: what the vehicle has in front of the cuts, each cut shaft ending on an inertia that is turned.

TURNING_INERTIA = 1e5  # kg·m²: so heavy that no shaft changes its speed in a step, and its momentum shows the torque


def turning_input(end: str) -> str:
    """Name of the input that turns the end of a cut shaft."""
    return f"turning_{end}"


def specimen_of(residual: ResidualVehicle) -> System:
    """What the vehicle has in front of the cuts; the ends of the cut shafts are turned by inputs of their own."""
    vehicle = residual.vehicle
    ends = {cut.vehicle_end for cut in residual.interfaces}
    near = {part.name for part in vehicle.inertias} - {part.name for one in residual.parts for part in one.inertias}
    group, cut_shafts = near | ends, {cut.shaft for cut in residual.interfaces}

    def inside(*names: str) -> bool:
        return set(names) <= near

    shafts = tuple(part for part in vehicle.shafts if inside(*part.between) or part.name in cut_shafts)
    own = tuple(part for part in vehicle.inputs if part.on in near)
    kept = {f"inertias.{name}" for name in near}
    kept |= {f"shafts.{part.name}" for part in shafts} | {f"inputs.{part.name}" for part in own}
    read = group | {shaft.name for shaft in shafts}
    point = vehicle.operating_point
    if point is not None:
        speeds, torques = speeds_of(vehicle), torques_of(vehicle)
        point = OperatingPoint(
            tuple((name, speeds[name]) for name in sorted(ends)), tuple((part.name, torques[part.name]) for part in own)
        )
    return replace(
        vehicle,
        inertias=tuple(
            replace(part, J=Quantity(TURNING_INERTIA), drag=Quantity(0.0)) if part.name in ends else part
            for part in vehicle.inertias if part.name in group
        ),
        shafts=shafts,
        gears=tuple(part for part in vehicle.gears if inside(*part.between)),
        differentials=tuple(part for part in vehicle.differentials if inside(*part.ends)),
        planetary_gears=tuple(part for part in vehicle.planetary_gears if inside(*part.ends)),
        inputs=own + tuple(Input(turning_input(cut.vehicle_end), cut.vehicle_end) for cut in residual.interfaces),
        sensors=tuple(part for part in vehicle.sensors if part.of in read),
        mirror=(),
        effects=tuple(effect for effect in vehicle.effects if _place(effect) in kept),
        title=f"Specimen of {vehicle.title or 'the vehicle'}",
        reference="",
        operating_point=point,
    )  # fmt: skip


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


# --- Delays of inputs and sensors in the models of a case: those of inputs are taken out, those of sensors get states.


class WithoutDelays(NamedTuple):
    """Vehicle and rig that a linear model holds, and a sentence for each delay."""

    vehicle: System
    rig: System
    sentences: tuple[str, ...]


def without_exact_delays(vehicle: System, rig: System) -> WithoutDelays:
    """Vehicle and rig that a linear model holds, and what was delayed.

    Torques count from where they act: an input that vehicle and rig have late alike is late in neither. A sensor that
    is late gets an all-pass: the controller reads it late, and vehicle and bed are compared as they read.

    Raises
    ------
    InputError
        If the two have another delay at one place, or an input of the rig alone has one: that of a dynamometer.
    """
    delays = [_delays(system) for system in (vehicle, rig)]
    places = [set(system.places()) for system in (vehicle, rig)]
    sentences = []
    for place in sorted({*delays[0], *delays[1]}):
        here, there = (by_place.get(place, 0.0) for by_place in delays)
        of_sensor = place.startswith("sensors.")
        if place not in places[0] and not of_sensor:
            raise InputError(
                f"rig: {place}",
                "is delayed inside the control loop",
                "state it as dead_time under [loop], or under [dynamometers.NAME]",
            )
        if place in places[0] and place in places[1] and here != there:
            raise InputError(
                f"rig: {place}",
                f"is delayed by {1e3 * there:g} ms, in the vehicle by {1e3 * here:g} ms",
                "what both have under one name is the same hardware: give both the same delay",
            )
        late = f"{place} is delayed by {1e3 * max(here, there):g} ms"
        sentences.append(
            f"{late}: the controller reads it so, and responses are compared as it reads" if of_sensor else
            f"{late}, in vehicle and rig alike: manoeuvre and feed-forward count from the torque that acts"
        )  # fmt: skip
    return WithoutDelays(_with_states(vehicle), _with_states(rig), tuple(sentences))


def _delays(system: System) -> dict[str, float]:
    delays: dict[str, float] = {}
    for effect in system.effects:
        if effect.law.only_delays:
            for place in effect.places:
                delays[place] = delays.get(place, 0.0) + sum(quantity.value for _, quantity in effect.parameters)
    return delays


def _with_states(system: System) -> System:
    def kept() -> Iterator[Effect]:
        for effect in system.effects:
            if not effect.law.only_delays:
                yield effect
            elif effect.at.startswith("sensors.") and effect.parameters[0][1].value > 0:
                yield Effect(AllPass.kind, effect.at, effect.parameters)

    return replace(system, effects=tuple(kept()))


# --- A vehicle whose part beyond the cut is a residual vehicle of the user's own, simpler than the vehicle's.

MASSLESS = 1e-3  # of an inertia: what is left of it where it is taken out
RIGID = 1e3  # times a stiffness: as good as no shaft at all


def with_residual_vehicle(vehicle: System, residual: ResidualVehicle, simple: System) -> System:
    """The vehicle as far as the bed has it, and beyond the cut the user's residual vehicle ``own``.

    Raises
    ------
    InputError
        If ``own`` lacks an inertia where a cut ends, or names one that the bed has.
    """
    beyond = {part.name for system in residual.parts for part in system.inertias}
    ends, names = [interface.vehicle_end for interface in residual.interfaces], {part.name for part in simple.inertias}
    if missing := [name for name in ends if name not in names]:
        raise InputError(
            "inertias", f"lack {listed(missing)}", "the shafts of the cut end there, named as in the vehicle"
        )
    near = {part.name for part in vehicle.inertias} - beyond
    if twice := sorted(names & near):
        raise InputError("inertias", f"hold {listed(twice)}, which the bed has", "only what lies beyond the cut")
    kept = [part for part in vehicle.inertias if part.name in near]
    shafts = [part for part in vehicle.shafts if set(part.between) & near]
    places = {f"inertias.{part.name}" for part in kept} | {f"shafts.{part.name}" for part in shafts}
    inputs = [part for part in vehicle.inputs if part.on in near]
    sensors = [part for part in vehicle.sensors if part.of in near or part.of in {shaft.name for shaft in shafts}]
    places |= {f"inputs.{part.name}" for part in inputs} | {f"sensors.{part.name}" for part in sensors}
    return replace(
        vehicle,
        inertias=(*kept, *simple.inertias),
        shafts=(*shafts, *simple.shafts),
        gears=(*_within(vehicle.gears, near), *simple.gears),
        differentials=(*(part for part in vehicle.differentials if set(part.ends) <= near), *simple.differentials),
        planetary_gears=(
            *(part for part in vehicle.planetary_gears if set(part.ends) <= near),
            *simple.planetary_gears,
        ),
        inputs=(*inputs, *simple.inputs),
        sensors=(*sensors, *(part for part in simple.sensors if part.name not in {sensor.name for sensor in sensors})),
        effects=(*(effect for effect in vehicle.effects if set(effect.places) <= places), *simple.effects),
        mirror=(*(pair for pair in vehicle.mirror if set(pair) <= near), *simple.mirror),
        operating_point=None,  # that of the vehicle may name what the simple one lacks
    )  # fmt: skip


def own_part(simple: System, residual: ResidualVehicle) -> System:
    """The user's residual vehicle out of a vehicle that has it: what lies beyond the cut, without the interfaces."""
    names = {part.name for system in residual.parts for part in system.inertias}
    taken = {name for cut in residual.interfaces for name in (cut.torque, cut.speed)}
    systems = residual.parts

    def every(table: str) -> tuple:
        return tuple(part for system in systems for part in getattr(system, table) if part.name not in taken)

    return replace(
        simple,
        inertias=every("inertias"), shafts=every("shafts"), gears=every("gears"),
        differentials=every("differentials"), planetary_gears=every("planetary_gears"),
        inputs=every("inputs"), sensors=every("sensors"),
        effects=tuple(effect for system in systems for effect in system.effects),
        mirror=tuple(pair for pair in simple.mirror if set(pair) <= names), reference="", operating_point=None,
    )  # fmt: skip


def without_part(vehicle: System, place: str) -> System:
    """The vehicle without a part: an inertia as good as massless, a shaft as good as rigid, or without an effect."""
    if place.startswith("effects."):
        name = place.removeprefix("effects.")
        return replace(vehicle, effects=tuple(effect for effect in vehicle.effects if effect.name != name))
    key, factor = ("J", MASSLESS) if place.startswith("inertias.") else ("stiffness", RIGID)
    return vehicle.with_values({f"{place}.{key}": vehicle.parameters[f"{place}.{key}"].value * factor})


def parts_left_out(simple: System, residual: ResidualVehicle) -> list[str]:
    """Inertias, shafts and effects beyond the cut of the vehicle that the simple one does not have under their name."""
    known = {f"inertias.{part.name}" for part in simple.inertias} | {f"shafts.{part.name}" for part in simple.shafts}
    known |= {f"effects.{effect.name}" for effect in simple.effects}
    every = [f"inertias.{part.name}" for system in residual.parts for part in system.inertias]
    every += [f"shafts.{part.name}" for system in residual.parts for part in system.shafts]
    every += [f"effects.{effect.name}" for system in residual.parts for effect in system.effects]
    return [place for place in every if place not in known]


def _within(parts: Iterable, names: set[str]) -> list:
    return [part for part in parts if set(part.between) <= names]


# --- Torque curve

EXAMPLE = 'write [["0 1/min", 1500], ["1000 1/min", 1500], ["3000 1/min", 500]]: speed and torque, speeds rising'


@dataclass(frozen=True)
class TorqueCurve:
    """Largest torque (N·m) over speed (rad/s), straight between the points, alike for both directions.

    Below the first speed its torque holds; the last speed is the largest that is allowed.
    """

    speeds: tuple[float, ...]
    torques: tuple[float, ...]

    def at(self, speed: np.ndarray) -> np.ndarray:
        """Largest torque (b,), N·m, at speeds (b,) of any sign, rad/s; beyond the last speed that of the last."""
        return np.interp(np.abs(speed), self.speeds, self.torques)

    def used(self, torque: np.ndarray, speed: np.ndarray) -> float:
        """Largest share of it that torques (t,) at speeds (t,) take."""
        return float((np.abs(torque) / self.at(speed)).max())


def read_torque_curve(value: Any, where: str) -> TorqueCurve:
    """A curve from a list of pairs of speed and torque.

    Raises
    ------
    InputError
        Naming what is wrong.
    """
    if not isinstance(value, Sequence) or isinstance(value, str) or not value:
        raise InputError(where, "is no list of pairs", EXAMPLE)
    if not all(isinstance(pair, list) and len(pair) == 2 for pair in value):
        raise InputError(where, "is no list of pairs", EXAMPLE)
    speeds = tuple(to_si(pair[0], "rad/s", where) for pair in value)
    torques = tuple(to_si(pair[1], "N*m", where) for pair in value)
    if min(speeds) < 0 or any(b <= a for a, b in pairwise(speeds)) or not speeds[-1] > 0:
        raise InputError(where, "its speeds do not rise from 0 or more", EXAMPLE)
    if not min(torques) > 0:
        raise InputError(where, f"a torque of {min(torques):g} N·m is not possible", "greater than 0 is needed")
    return TorqueCurve(speeds, torques)
