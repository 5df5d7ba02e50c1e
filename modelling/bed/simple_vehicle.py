"""A vehicle whose part beyond the cut is a residual vehicle of the user's own, simpler than the vehicle's."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from modelling.bed.residual_vehicle import ResidualVehicle
from modelling.common.errors import InputError, listed
from modelling.model.system import System

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
        differentials=(
            *(part for part in vehicle.differentials if {part.cage, part.left, part.right} <= near),
            *simple.differentials,
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
        differentials=every("differentials"), inputs=every("inputs"), sensors=every("sensors"),
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
