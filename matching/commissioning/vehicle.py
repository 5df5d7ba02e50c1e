"""The vehicle from recordings of the road: its values and what is not known exactly of them, for the match."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from matching.commissioning.identified import IdentifiedValue, narrowed
from matching.commissioning.ranges import FIT_RANGE_RATIO, around, with_quantities
from matching.diagnosis.verdict.result import Diagnosis
from matching.frequency.case.case import Case, Move
from matching.frequency.case.uncertainty import Box, Uncertain
from modelling.bed.residual_vehicle import cut
from modelling.common.errors import InputError
from modelling.effects.place import place_in_words
from modelling.measurement.read import read_signals
from modelling.model.components import Effect
from modelling.model.quantity import Quantity
from modelling.model.system import System

KNOWN = 0.1  # of half the range of a quantity


@dataclass(frozen=True)
class KnownVehicle:
    """A case whose vehicle has the values of its recordings, what was said of each, and sentences on the rest."""

    case: Case
    values: tuple[IdentifiedValue, ...]
    notes: tuple[str, ...]


def recorded_vehicle(case: Case, recordings: Sequence[Path]) -> tuple[System, tuple[str, ...]]:
    """The vehicle as its recordings are fitted, and notes: without the road's torques, which are not measured.

    Quantities that the model file gives with a range are fitted in it, of others those that ``[uncertainty]`` names,
    in twice its width. What it shares with the rig is taken as known where the bed tells it much better: where the
    half-width under ``[uncertainty]`` is at most a tenth of half the range.

    Raises
    ------
    InputError
        If nothing of the vehicle is uncertain, or a recording cannot be read.
    """
    vehicle = replace(case.vehicle, operating_point=None)
    on_rig = {part.name for part in case.rig.inputs}
    beside = {part.name for part in vehicle.inputs} - on_rig
    recorded = set()
    for path in recordings:
        recorded |= set(read_signals(path, beside, None).channels)
    missing = sorted(beside - recorded)
    places = {f"inputs.{name}" for name in missing}
    vehicle = replace(
        vehicle,
        inputs=tuple(part for part in vehicle.inputs if part.name not in missing),
        effects=tuple(effect for effect in vehicle.effects if places.isdisjoint(effect.places)),
    )
    box = {quantity.name: quantity.half_width for quantity in case.uncertainty.uncertain}
    ranges = {}
    for name, quantity in vehicle.parameters.items():
        width = box.get(f"vehicle.{name}", box.get(f"rig.{name}", 0.0))
        if not quantity.uncertain and width > 0:
            ranges[name] = around(quantity.value, width)
        elif f"rig.{name}" in box and width <= KNOWN * FIT_RANGE_RATIO * _half_range(quantity):
            ranges[name] = Quantity(quantity.value)
    vehicle = with_quantities(vehicle, ranges)
    if not vehicle.uncertain:
        raise InputError(
            "vehicle", "nothing of it is uncertain, so that a recording could tell nothing",
            "give quantities of the vehicle's model file a range, or name them under [uncertainty]",
        )  # fmt: skip
    return vehicle, tuple(f"no recording holds {name}: it is taken as zero on the road" for name in missing)


def known_vehicle(case: Case, fitted: System, diagnosis: Diagnosis) -> KnownVehicle:
    """The case with the vehicle that a diagnosis of its recordings found.

    What vehicle and rig share is the same hardware: it has the vehicle's values in both. Effects that a linear model
    holds enter, those of the car's sensors and inputs do not: they are not those of the bed.

    Raises
    ------
    InputError
        If the values make no system.
    """
    estimates = {
        name: estimate for name, estimate in diagnosis.parameters.items()
        if name in case.vehicle.parameters and math.isfinite(estimate.standard_uncertainty)
    }  # fmt: skip
    values = {name: estimate.value for name, estimate in estimates.items()}
    on_rig = case.rig.parameters
    effects, notes = _effects(fitted, diagnosis)
    there = set(case.rig.places())
    vehicle = case.vehicle.with_values(values).with_effects(*effects)
    rig = case.rig.with_values({name: value for name, value in values.items() if name in on_rig})
    rig = rig.with_effects(*(effect for effect in effects if there.issuperset(effect.places)))
    before = {quantity.name: quantity for quantity in case.uncertainty.uncertain}
    box, rows = dict(before), []
    for name, estimate in estimates.items():
        full = f"rig.{name}" if name in on_rig else f"vehicle.{name}"
        start = case.vehicle.parameters[name]
        stated = before.get(full, Uncertain(full, start.value, _half_range(fitted.parameters[name])))
        box[full] = narrowed(stated, estimate, 0.0)
        rows.append(IdentifiedValue(full, start.value, estimate.value, box[full].half_width))
    made = replace(
        case, vehicle=vehicle, rig=rig, residual_vehicle=cut(vehicle, rig), uncertainty=Box(tuple(box.values())),
        moves=tuple(_moved(move, values) for move in case.moves),
    )  # fmt: skip
    return KnownVehicle(made, tuple(rows), notes)


def _half_range(quantity: Quantity) -> float:
    """Half of a quantity's range over :data:`FIT_RANGE_RATIO`, as a half-width of the box."""
    lower, upper = quantity.lower, quantity.upper
    return 0.0 if lower is None or upper is None else (upper - lower) / 2 / FIT_RANGE_RATIO


def _moved(move: Move, values: dict[str, float]) -> Move:
    """A quantity of the residual vehicle starts from what it is, between bounds as far away as before."""
    name = move.name.removeprefix("residual_vehicle.")
    if name == move.name or name not in values or not move.planned:
        return move
    factor = values[name] / move.planned
    return replace(move, start=values[name], planned=values[name], lower=factor * move.lower, upper=factor * move.upper)


def _effects(fitted: System, diagnosis: Diagnosis) -> tuple[list[Effect], tuple[str, ...]]:
    """What the recordings added: effects that the match takes, and sentences on the others."""
    before = {effect.name for effect in fitted.effects}
    added = [effect for effect in diagnosis.extended.effects if effect.name not in before]
    taken, notes = [], []
    for effect in added:
        named = f"{effect.kind} at {place_in_words(effect.at)} was named"
        if effect.at.split(".")[0] in ("sensors", "inputs"):
            notes.append(f"{named}: it belongs to the car's recording and stays out of the vehicle that is emulated")
        elif effect.law.linear:
            taken.append(effect)
        else:
            notes.append(f"{named}; the match is linear and leaves it out")
    return taken, tuple(notes)
