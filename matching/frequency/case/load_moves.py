"""Which quantities of a case may move, and reading which of them do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from matching.frequency.case.case import Move
from matching.frequency.case.tables import table_of
from modelling.bed.loop import Loop
from modelling.bed.residual_vehicle import ResidualVehicle
from modelling.common.errors import InputError, unknown
from modelling.model.mirror import mirror_image
from modelling.model.quantity import Quantity
from modelling.model.system import System
from modelling.units import to_si

_KEYS = {"start", "planned", "lower", "upper"}


def read_moves(
    data: Mapping[str, Any], rig: System, residual: ResidualVehicle, loop: Loop, where: str
) -> tuple[Move, ...]:
    """What may move, each quantity with its mirror image.

    Raises
    ------
    InputError
        Naming file and key.
    """
    table = table_of(data, "move", where)
    places = movable(rig, residual, loop)
    made: list[Move] = []
    for name, entry in table.items():
        place = f"{where}: move.{name!r}"
        if name not in places:
            raise unknown(name, list(places), place)
        start, unit, together = places[name]
        if not isinstance(entry, dict) or not {"lower", "upper"} <= set(entry) <= _KEYS:
            raise InputError(
                place, "has no bounds", "write { lower = …, upper = … }, and start = … if it shall start elsewhere"
            )
        low, high = (to_si(entry[key], unit, f"{place}.{key}") for key in ("lower", "upper"))
        planned = to_si(entry["planned"], unit, f"{place}.planned") if "planned" in entry else start
        planned = min(max(planned, low), high)
        begin = to_si(entry["start"], unit, f"{place}.start") if "start" in entry else planned
        if not low < high or not low <= begin <= high:
            raise InputError(
                place,
                f"bounds {low:g} … {high:g} with start {begin:g} cross",
                "lower ≤ start ≤ upper and lower < upper is needed",
            )
        if low < _floor(name, loop) or (low == 0 and name.rsplit(".", 1)[1] in ("J", "ratio")):
            raise InputError(f"{place}.lower", f"{low:g} is not possible", "a physical bound is needed")
        taken = {other for move in made for other in move.together}
        if name in taken:
            raise InputError(place, "moves already with its mirror image", "name one of the pair")
        made.append(Move(name, together, begin, low, high, unit, planned))
    return tuple(made)


def as_planned(rig: System, moves: Sequence[Move], data: Mapping[str, Any]) -> System:
    """The rig as it was planned: a tuned case brings the tuned rig, and states under ``planned`` what that was."""
    stated = [move for move in moves if "planned" in data["move"][move.name] and move.name.startswith("rig.")]
    planned = {name.removeprefix("rig."): move.planned for move in stated for name in move.together}
    return rig.with_values(planned, designed=True)


def _floor(name: str, loop: Loop) -> float:
    if name.startswith("loop."):
        return loop.quantities[name.removeprefix("loop.")].lower
    return 0.0


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
