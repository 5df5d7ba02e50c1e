"""The quantities of a case that may be set or moved, by name, with their mirror images."""

from __future__ import annotations

from typing import NamedTuple

from modelling.bed.bed import Loop
from modelling.bed.vehicle import ResidualVehicle
from modelling.system import Quantity, System, mirror_image


class Movable(NamedTuple):
    """Start (SI) and SI unit of a quantity, and the names that move together: itself and its mirror image."""

    start: float
    unit: str
    together: tuple[str, ...]


def movable(rig: System, residual: ResidualVehicle, loop: Loop) -> dict[str, Movable]:
    """Every quantity that may move, by name.

    What the rig shares with the vehicle is the specimen and does not move.
    """
    shared = {cut.shaft for cut in residual.interfaces}
    vehicle_side: dict[str, Quantity] = {}
    units: dict[str, str] = {}
    for part in residual.parts:
        vehicle_side |= part.parameters
        units |= part.units
    quantities: dict[str, Movable] = {}
    mirrors = {name: mirror_image(name, residual.vehicle) for name in vehicle_side}
    for name, value in vehicle_side.items():
        full = f"residual_vehicle.{name}"
        image = mirrors[name]
        together = (full,) if image == name else (full, f"residual_vehicle.{image}")
        quantities[full] = Movable(value.value, units[name], together)
    specimen = set(residual.vehicle.parameters) | {f"shafts.{name}" for name in shared}
    for name, value in rig.parameters.items():
        if name in specimen:
            continue
        full, image = f"rig.{name}", mirror_image(name, rig)
        together = (full,) if image == name else (full, f"rig.{image}")
        quantities[full] = Movable(value.value, rig.units[name], together)
    for name, spec in loop.quantities.items():
        quantities[f"loop.{name}"] = Movable(loop.values[name], spec.unit, (f"loop.{name}",))
    return quantities
