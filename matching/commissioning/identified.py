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


def identified_case(case: Case, diagnosis: Diagnosis) -> Identified:
    """The case with the values that a diagnosis of :func:`matching.commissioning.bed_system.bed_system` found.

    What vehicle and rig share has the bed's values in both. The rig stands as it is now, so nothing of it moves any
    more. Effects that a linear model holds enter rig and vehicle; of others only the notes speak.

    Raises
    ------
    InputError
        If the values make no system.
    """
    estimates = {
        name: diagnosis.parameters[key] for name, key in names_in_system(case).items() if key in diagnosis.parameters
    }
    known = {name: estimate for name, estimate in estimates.items() if math.isfinite(estimate.standard_uncertainty)}
    of_rig = {name.removeprefix("rig."): estimate.value for name, estimate in known.items() if name.startswith("rig.")}
    effects, notes = _linear_effects(case, diagnosis)
    shared = {name: value for name, value in of_rig.items() if name in case.vehicle.parameters}
    places = set(case.vehicle.places())
    rig = case.rig.with_values(of_rig).with_effects(*effects)
    vehicle = case.vehicle.with_values(shared).with_effects(*(effect for effect in effects if effect.at in places))
    loop = case.loop
    hold = loop["dead_time"] - loop.command_delay()
    values = {}
    if "loop.dead_time" in known:
        values["dead_time"] = known["loop.dead_time"].value + hold
    for name in ("inverter_lag", "torque_sensor_lag"):
        if f"loop.{name}" in known:
            values[name] = known[f"loop.{name}"].value
    dynamometers = tuple(
        replace(dynamometer, torque_gain=known[f"dynamometers.{dynamometer.name}{GAIN}"].value)
        if f"dynamometers.{dynamometer.name}{GAIN}" in known else dynamometer
        for dynamometer in loop.dynamometers
    )  # fmt: skip
    loop = replace(loop.with_values(values), dynamometers=dynamometers)
    box = Box(tuple(_narrowed(quantity, known.get(quantity.name), hold) for quantity in case.uncertainty.uncertain))
    moves = tuple(move for move in case.moves if not move.name.startswith("rig."))
    made = replace(
        case, rig=rig, vehicle=vehicle, residual_vehicle=cut(vehicle, rig), loop=loop, uncertainty=box, moves=moves
    )
    return Identified(made, notes)


def _narrowed(quantity: Uncertain, estimate: Estimate | None, hold: float) -> Uncertain:
    """What is still not known of a quantity; gains of dynamometers are relative to their calibration."""
    if estimate is None:
        return quantity
    value = estimate.value
    # what the recording does not narrow stays as uncertain as it was
    spread = quantity.half_width if estimate.note else COVERAGE * estimate.standard_uncertainty
    least = LEAST_DELAY if quantity.name == "loop.dead_time" else LEAST_SHARE * abs(value)
    half_width = min(max(spread, least), WIDER * quantity.half_width)
    if quantity.name.endswith(GAIN):
        return Uncertain(quantity.name, 1.0, half_width / value)
    return Uncertain(quantity.name, value + hold if quantity.name == "loop.dead_time" else value, half_width)


def _linear_effects(case: Case, diagnosis: Diagnosis) -> tuple[list[Effect], tuple[str, ...]]:
    """Effects of the diagnosis that a linear model holds, at shafts and inertias; sentences on all others."""
    before = set(bed_system(case).effects)
    added = [effect for effect in diagnosis.extended.effects if effect.name not in {known.name for known in before}]
    linear = [effect for effect in added if effect.law.linear and effect.at.split(".")[0] in ("shafts", "inertias")]
    return linear, tuple(_left_out(effect) for effect in added if effect not in linear)


def _left_out(effect: Effect) -> str:
    """What has to be done about an effect that the match does not take."""
    if effect.at.startswith("sensors."):
        return (
            f"{effect.kind} at {effect.at} was named: mend the sensor or its time stamps, for controller and "
            "verification take its readings as they are"
        )
    return f"{effect.kind} at {effect.at} was named; the match is linear and leaves it out"
