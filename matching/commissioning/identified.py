"""A case with what a diagnosis of its bed found: values, uncertainties, calibrations, effects."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from matching.commissioning.bed_system import bed_system, names_in_system
from matching.commissioning.ranges import FIT_RANGE_RATIO
from matching.commissioning.sensor_faults import CONSTANT, as_states, is_taken, with_faults
from matching.diagnosis.fitting.uncertainty import Estimate
from matching.diagnosis.verdict.result import Diagnosis
from matching.frequency.case.case import Case
from matching.frequency.case.uncertainty import LARGEST_SHARE, Box, Uncertain
from modelling.bed.residual_vehicle import cut
from modelling.effects.place import place_in_words
from modelling.model.components import Effect
from modelling.model.system import System

COVERAGE = 2.0  # half-width of the box over the standard uncertainty
LEAST_SHARE = 0.002  # of a value: half-widths are no smaller, for a model is never as exact as its noise says
LEAST_DELAY = 2e-5  # s: the same for the dead time
GAIN = ".torque_gain"


@dataclass(frozen=True)
class IdentifiedValue:
    """A quantity before and after an identification.

    Attributes
    ----------
    name : str
        As ``[uncertainty]`` has it.
    before, after : float
        SI.
    half_width : float
        Of the interval that is left after it, k = 2, SI.
    """

    name: str
    before: float
    after: float
    half_width: float

    def to_dict(self) -> dict[str, Any]:
        """A row of ``identification.json``."""
        return dict(vars(self))


@dataclass(frozen=True)
class Identified:
    """A case after identification, and sentences on what of the diagnosis it could not take."""

    case: Case
    notes: tuple[str, ...]


def identified_case(case: Case, diagnosis: Diagnosis) -> Identified:
    """The case with the values that a diagnosis of :func:`matching.commissioning.bed_system.bed_system` found.

    What vehicle and rig share has the bed's values in both. The rig stands as it is now, so nothing of it moves any
    more. Effects that a linear model holds enter rig and vehicle, those of sensors as well: a sensor that is late or
    reads with a factor is read so by the next controller. Of other effects only the notes speak.

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
    faults = [effect for effect in effects if is_taken(effect)]
    others = [effect for effect in effects if not is_taken(effect)]
    shared = {name: value for name, value in of_rig.items() if name in case.vehicle.parameters}
    places = set(case.vehicle.places())
    rig = with_faults(case.rig.with_values(of_rig), faults).with_effects(*others)
    vehicle = with_faults(case.vehicle.with_values(shared), faults)
    vehicle = vehicle.with_effects(*(effect for effect in others if places.issuperset(effect.places)))
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
    box = Box((
        *(narrowed(quantity, known.get(quantity.name), hold) for quantity in case.uncertainty.uncertain),
        *_of_faults(rig, faults, diagnosis, {quantity.name for quantity in case.uncertainty.uncertain}),
    ))  # fmt: skip
    moves = tuple(move for move in case.moves if not move.name.startswith("rig."))
    made = replace(
        case, rig=rig, vehicle=vehicle, residual_vehicle=cut(vehicle, rig), loop=loop, uncertainty=box, moves=moves
    )
    return Identified(made, notes)


def narrowed(quantity: Uncertain, estimate: Estimate | None, hold: float) -> Uncertain:
    """What is still not known of a quantity; gains of dynamometers are relative to their calibration.

    ``hold`` (s) is what the loop's dead time counts beside the delay of a recording.
    """
    if estimate is None:
        return quantity
    value = estimate.value
    # what the recording does not narrow stays as uncertain as it was
    spread = quantity.half_width if estimate.note else COVERAGE * estimate.standard_uncertainty
    least = LEAST_DELAY if quantity.name == "loop.dead_time" else LEAST_SHARE * abs(value)
    half_width = min(max(spread, least), FIT_RANGE_RATIO * quantity.half_width)
    if quantity.name.endswith(GAIN):
        return Uncertain(quantity.name, 1.0, half_width / value)
    return Uncertain(quantity.name, value + hold if quantity.name == "loop.dead_time" else value, half_width)


def _of_faults(rig: System, faults: Sequence[Effect], diagnosis: Diagnosis, known: set[str]) -> Iterator[Uncertain]:
    """What is not known exactly of the faults of sensors."""
    for fault in faults:
        ((key, _),) = fault.parameters
        estimate = diagnosis.parameters.get(f"{fault.name}.{key}")
        name = f"{as_states(fault).name}.{key}"
        if estimate is None or f"rig.{name}" in known or not math.isfinite(estimate.standard_uncertainty):
            continue
        value = rig.parameters[name].value
        least = max(COVERAGE * estimate.standard_uncertainty, LEAST_SHARE * abs(value))
        yield Uncertain(f"rig.{name}", value, min(least, LARGEST_SHARE * abs(value)))


def _linear_effects(case: Case, diagnosis: Diagnosis) -> tuple[list[Effect], tuple[str, ...]]:
    """Effects of the diagnosis that a linear model holds, at shafts, inertias and sensors; sentences on all others."""
    before = set(bed_system(case).effects)
    added = [effect for effect in diagnosis.extended.effects if effect.name not in {known.name for known in before}]
    linear = [
        effect for effect in added
        if is_taken(effect) or (effect.law.linear and effect.at.split(".")[0] in ("shafts", "inertias"))
    ]  # fmt: skip
    return linear, tuple(
        _said(effect, effect in linear) for effect in added if effect not in linear or is_taken(effect)
    )


def _said(effect: Effect, taken: bool) -> str:
    """What becomes of an effect that is no part of the bed's mechanics, or that the match leaves out."""
    named = f"{effect.kind} at {place_in_words(effect.at)} was named"
    if taken:
        return f"{named}: the next match reads the sensor so, and compares vehicle and bed by what it reads"
    if effect.kind in CONSTANT:
        return f"{named}: the controller acts on deviations and does not see it, unless it changes while the bed runs"
    if effect.at.startswith("sensors."):
        return f"{named}: mend the sensor or its time stamps, for the match takes its readings as they are"
    return f"{named}; the match is linear and leaves it out"
