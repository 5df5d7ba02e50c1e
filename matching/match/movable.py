"""The quantities of a case that may be set or moved, by name, with their mirror images."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
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
    for name, size in rig.dimensions.items():
        if f"{name.rpartition('.')[0]}.stiffness" in specimen or name.rpartition(".")[0] in specimen:
            continue
        image = mirror_image(name, rig)
        together = (f"rig.{name}",) if image == name or image not in rig.dimensions else (f"rig.{name}", f"rig.{image}")
        quantities[f"rig.{name}"] = Movable(size.value, "m", together)
    for name, spec in loop.quantities.items():
        quantities[f"loop.{name}"] = Movable(loop.values[name], spec.unit, (f"loop.{name}",))
    return quantities


# --- Dimensions of the rig's shafts: what they change.


def with_sizes(rig: System, values: Mapping[str, float]) -> dict[str, float]:
    """Values of a case by name, SI, and next to them the stiffness and inertias that dimensions among them make.

    See :meth:`modelling.system.System.with_sizes`.
    """
    of_rig = {name.removeprefix("rig."): value for name, value in values.items() if name.startswith("rig.")}
    return {**{f"rig.{name}": value for name, value in rig.with_sizes(of_rig).items()}, **values}


def changed_by(rig: System, names: Iterable[str]) -> set[str]:
    """Names of quantities that change with some, these themselves too: of a dimension stiffness and inertias."""
    sizes = {name: rig.dimensions[name].value for one in names if (name := one.removeprefix("rig.")) in rig.dimensions}
    return {*names, *(f"rig.{name}" for name in rig.with_sizes(sizes))}
