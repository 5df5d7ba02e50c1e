"""A case with what a diagnosis of its bed found: values, uncertainties, calibrations, effects."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from matching.commissioning.bed_system import WIDER, bed_system, names_in_system
from matching.diagnosis.fitting.uncertainty import Estimate
from matching.diagnosis.verdict.result import Diagnosis
from matching.frequency.case.case import Case
from matching.frequency.case.uncertainty import Box, Uncertain
from modelling.bed.residual_vehicle import cut
from modelling.model.components import Effect

COVERAGE = 2.0  # half-width of the box over the standard uncertainty
LEAST_SHARE = 0.002  # of a value: half-widths are no smaller, for a model is never as exact as its noise says
LEAST_DELAY = 2e-5  # s: the same for the dead time
GAIN = ".torque_gain"


@dataclass(frozen=True)
class Identified:
    """A case after identification, and sentences on what of the diagnosis it could not take."""

    case: Case
    notes: tuple[str, ...]


def identified_case(case: Case, found: Diagnosis) -> Identified:
    """The case with the values that a diagnosis of :func:`matching.commissioning.bed_system.bed_system` found.

    What vehicle and rig share has the bed's values in both. The rig stands as it is now, so nothing of it moves any
    more. Effects that a linear model holds enter rig and vehicle; of others only the notes speak.

    Raises
    ------
    InputError
        If the values make no system.
    """
    estimates = {name: found.parameters[key] for name, key in names_in_system(case).items() if key in found.parameters}
    known = {name: one for name, one in estimates.items() if math.isfinite(one.standard_uncertainty)}
    of_rig = {name.removeprefix("rig."): one.value for name, one in known.items() if name.startswith("rig.")}
    effects, notes = _linear_effects(case, found)
    shared = {name: value for name, value in of_rig.items() if name in case.vehicle.parameters}
    places = set(case.vehicle.places())
    rig = case.rig.with_values(of_rig).with_effects(*effects)
    vehicle = case.vehicle.with_values(shared).with_effects(*(one for one in effects if one.at in places))
    loop = case.loop
    hold = loop["dead_time"] - loop.command_delay()
    values = {}
    if "loop.dead_time" in known:
        values["dead_time"] = known["loop.dead_time"].value + hold
    for name in ("inverter_lag", "torque_sensor_lag"):
        if f"loop.{name}" in known:
            values[name] = known[f"loop.{name}"].value
    dynamometers = tuple(
        replace(own, torque_gain=known[f"dynamometers.{own.name}{GAIN}"].value)
        if f"dynamometers.{own.name}{GAIN}" in known else own
        for own in loop.dynamometers
    )  # fmt: skip
    loop = replace(loop.with_values(values), dynamometers=dynamometers)
    box = Box(tuple(_narrowed(one, known.get(one.name), hold) for one in case.uncertainty.uncertain))
    moves = tuple(move for move in case.moves if not move.name.startswith("rig."))
    made = replace(
        case, rig=rig, vehicle=vehicle, residual_vehicle=cut(vehicle, rig), loop=loop, uncertainty=box, moves=moves
    )
    return Identified(made, notes)


def _narrowed(one: Uncertain, found: Estimate | None, hold: float) -> Uncertain:
    """What is still not known of a quantity; gains of dynamometers are relative to their calibration."""
    if found is None:
        return one
    value = found.value
    # what the recording does not narrow stays as uncertain as it was
    spread = one.half_width if found.note else COVERAGE * found.standard_uncertainty
    least = LEAST_DELAY if one.name == "loop.dead_time" else LEAST_SHARE * abs(value)
    half_width = min(max(spread, least), WIDER * one.half_width)
    if one.name.endswith(GAIN):
        return Uncertain(one.name, 1.0, half_width / value)
    return Uncertain(one.name, value + hold if one.name == "loop.dead_time" else value, half_width)


def _linear_effects(case: Case, found: Diagnosis) -> tuple[list[Effect], tuple[str, ...]]:
    """Effects of the diagnosis that a linear model holds, at shafts and inertias; sentences on all others."""
    before = set(bed_system(case).effects)
    added = [one for one in found.extended.effects if one.name not in {own.name for own in before}]
    linear = [one for one in added if one.law.linear and one.at.split(".")[0] in ("shafts", "inertias")]
    notes = tuple(
        f"{one.kind} at {one.at} was named; the match is linear and leaves it out" for one in added if one not in linear
    )
    return linear, notes
