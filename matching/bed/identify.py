"""A case known from recordings: of its vehicle on the road, of its bed without emulation."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from matching.bed.simulated_bed import (
    CONSTANT,
    FIT_RANGE_RATIO,
    around,
    as_states,
    bed_system,
    friction_names,
    is_taken,
    names_in_system,
    own_times,
    with_faults,
    with_quantities,
)
from matching.bed.stated import Deviation
from matching.diagnosis.diagnose import diagnose
from matching.diagnosis.result import Diagnosis
from matching.diagnosis.statistics import Estimate
from matching.match.box import LARGEST_SHARE, Box, Uncertain
from matching.match.case import Case, Move
from matching.match.case_file import case_files
from modelling.bed.bed import OWN_TIMES, Dynamometer
from modelling.bed.vehicle import cut
from modelling.display import Displayed
from modelling.effects.effect import place_in_words
from modelling.effects.sensors_and_actuators import SensorGain
from modelling.errors import InputError
from modelling.model_file import dumps
from modelling.recordings.read import Channel, contents_of, read_recording, read_signals
from modelling.recordings.recording import Recording
from modelling.resources import TimeLimit, limited
from modelling.system import Effect, Quantity, System
from modelling.writing import strict_json

# --- A case with what a diagnosis of its bed found: values, uncertainties, calibrations, effects.

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
    found : bool
        Whether the recording tells it; a value at the end of its range is none that was found.
    """

    name: str
    before: float
    after: float
    half_width: float
    found: bool = True

    def to_dict(self) -> dict[str, Any]:
        """A row of ``identification.json``."""
        return dict(vars(self))


@dataclass(frozen=True)
class Identified:
    """A case after identification, and sentences on what of the diagnosis it could not take."""

    case: Case
    notes: tuple[str, ...]


def identified_case(case: Case, diagnosis: Diagnosis) -> Identified:
    """The case with the values that a diagnosis of :func:`matching.bed.simulated_bed.bed_system` found.

    What vehicle and rig share has the bed's values in both. The rig stands as it is now, so nothing of it moves any
    more. Effects that a linear model holds enter rig and vehicle, those of sensors as well: a sensor that is late or
    reads with a factor is read so by the next controller. Of other effects only the notes speak.
    """
    estimates = {
        name: diagnosis.parameters[key] for name, key in names_in_system(case).items() if key in diagnosis.parameters
    }
    # a value at the end of its range is none that was found, in a model that does not explain the recording
    unexplained = diagnosis.verdict == "unexplained"
    known = {
        name: estimate for name, estimate in estimates.items()
        if math.isfinite(estimate.standard_uncertainty) and not (unexplained and estimate.note)
    }  # fmt: skip
    for name in OWN_TIMES:
        known |= _together(case, diagnosis, name, unexplained)
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
    common = {name: known[f"loop.{name}"].value for name in OWN_TIMES if f"loop.{name}" in known}
    values = {name: value + hold * (name == "dead_time") for name, value in common.items()}
    own = [_own_times(case, dynamometer, diagnosis, values, hold) for dynamometer in loop.dynamometers]
    dynamometers = tuple(
        replace(dynamometer, torque_gain=known[f"dynamometers.{dynamometer.name}{GAIN}"].value, **times)
        if f"dynamometers.{dynamometer.name}{GAIN}" in known else replace(dynamometer, **times)
        for dynamometer, times in zip(loop.dynamometers, own, strict=True)
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


def _together(case: Case, diagnosis: Diagnosis, name: str, unexplained: bool) -> dict[str, Estimate]:
    """The loop's own value of a delay or a lag of the dynamometers: their mean, and the largest uncertainty of one."""
    own = [own_times(dynamometer) for dynamometer in case.loop.dynamometers]
    keys = [names[name] for names in own if name in names]
    found = [diagnosis.parameters[key] for key in keys if key in diagnosis.parameters]
    told = [one for one in found if math.isfinite(one.standard_uncertainty) and not (unexplained and one.note)]
    if not told or len(told) < len(keys):
        return {}
    note = next((one.note for one in told if one.note), "")
    mean, most = float(np.mean([one.value for one in told])), max(one.standard_uncertainty for one in told)
    return {f"loop.{name}": Estimate(mean, most, note)}


def _own_times(
    case: Case, dynamometer: Dynamometer, diagnosis: Diagnosis, common: dict[str, float], hold: float
) -> dict[str, Any]:
    """Dead time and lags of a dynamometer, s, where the loop has several: each inverter has its own."""
    if len(case.loop.dynamometers) == 1:
        return {name: None for name in common if getattr(dynamometer, name) is not None}
    names = own_times(dynamometer)
    return {
        name: diagnosis.parameters[names[name]].value + hold * (name == "dead_time") for name in common if name in names
    }


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
    before = {effect.name for effect in bed_system(case, turning=True).effects}
    added = [effect for effect in diagnosis.extended.effects if effect.name not in before]
    linear = [
        effect for effect in added
        if is_taken(effect)
        or ((effect.law.linear or effect.law.free_play) and effect.at.split(".")[0] in ("shafts", "inertias"))
    ]  # fmt: skip
    return linear, tuple(
        _said(effect, effect in linear)
        for effect in added
        if effect not in linear or is_taken(effect) or effect.law.free_play
    ) + _frictions(case, diagnosis)


def _frictions(case: Case, diagnosis: Diagnosis) -> tuple[str, ...]:
    """Sentences on torques that resist in steady motion: a match about that motion does not depend on them."""
    found = {at: diagnosis.parameters[key] for at, key in friction_names(case).items() if key in diagnosis.parameters}
    return tuple(
        f"friction of {one.value:.2g} ± {COVERAGE * one.standard_uncertainty:.1g} N·m at inertias.{at} while it turns: "
        "the match is about steady motion and does not depend on it"
        for at, one in found.items()
        if one.value > TOLD * one.standard_uncertainty and one.value > LEAST_FRICTION * case.largest_torque
    )


TOLD = 5.0  # standard uncertainties from which a friction is told
LEAST_FRICTION = 0.01  # of the largest torque of a manoeuvre: less is none that anybody looks for


def _said(effect: Effect, taken: bool) -> str:
    """What becomes of an effect that is no part of the bed's mechanics, or that the match leaves out."""
    named = f"{effect.kind} at {place_in_words(effect.at)} was named"
    if effect.law.free_play:
        return f"{named}: the next match has it closed, and the next proof keeps it closed by a mean torque"
    if taken:
        return f"{named}: the next match reads the sensor so, and compares vehicle and bed by what it reads"
    if effect.kind in CONSTANT:
        return f"{named}: the controller acts on deviations and does not see it, unless it changes while the bed runs"
    if effect.at.startswith("sensors."):
        return f"{named}: mend the sensor or its time stamps, for the match takes its readings as they are"
    return f"{named}; the match is linear and leaves it out"


# --- A case with what the check of the channels measured: the first match begins from it.


def measured_case(case: Case, measured: Sequence[Deviation]) -> tuple[Case, tuple[IdentifiedValue, ...]]:
    """The case with the values that the check of its bed's channels measured, and a row of each.

    Every dynamometer has its own delay, lags and gain; their uncertainty (k = 2) is the half-width of the box. What
    vehicle and rig share has the bed's values in both. A sensor that reads with a factor is read so.
    """
    known = {one.name: one for one in measured if one.told}
    loop, box, rows = case.loop, {one.name: one for one in case.uncertainty.uncertain}, list[IdentifiedValue]()

    def row(name: str, one: Deviation) -> float:
        least = LEAST_DELAY if name.endswith("dead_time") else LEAST_SHARE * abs(one.value)
        width = max(COVERAGE * one.uncertainty, least)
        rows.append(IdentifiedValue(name, one.stated, one.value, width))
        return width

    own, half = dict[str, dict[str, float]](), dict[str, float]()
    for part in loop.dynamometers:
        whole = f"dynamometers.{part.name}"
        own[part.name] = {}
        for key in (*OWN_TIMES, "torque_gain"):
            one = known.get(f"{whole}.{key}")
            if one is None:
                continue
            own[part.name][key] = one.value
            width = row(f"{whole}.{key}", one)
            if key == "torque_gain" and f"{whole}{GAIN}" in box:
                box[f"{whole}{GAIN}"] = Uncertain(f"{whole}{GAIN}", 1.0, width / one.value)
            elif key in OWN_TIMES:
                half[key] = max(half.get(key, 0.0), width)
    common = {}
    for key in OWN_TIMES:
        if key not in half or f"loop.{key}" not in box:
            continue
        told = all(key in times for times in own.values())
        for part in loop.dynamometers:  # one that is not told keeps its stated value
            stated = getattr(part, key)
            own[part.name].setdefault(key, loop[key] if stated is None else stated)
        common[key] = float(np.mean([times[key] for times in own.values()]))
        share = min(half[key], box[f"loop.{key}"].half_width) if told else box[f"loop.{key}"].half_width
        box[f"loop.{key}"] = Uncertain(f"loop.{key}", common[key], share)
    single = len(loop.dynamometers) == 1
    dynamometers = []
    for part in loop.dynamometers:
        times: dict[str, Any] = {key: None if single else own[part.name][key] for key in common
                 if not single or getattr(part, key) is not None}  # fmt: skip
        gain = own[part.name].get("torque_gain", part.torque_gain)
        dynamometers.append(replace(part, torque_gain=gain, **times))
    loop = replace(loop.with_values(common), dynamometers=tuple(dynamometers))
    of_rig = {}
    for name, one in known.items():
        if name.startswith("rig.") and name in box:
            of_rig[name.removeprefix("rig.")] = one.value
            box[name] = Uncertain(name, one.value, min(row(name, one), LARGEST_SHARE * one.value))
    faults = [
        Effect(SensorGain.kind, name.removesuffix(".gain"), (("factor", Quantity(one.value)),))
        for name, one in known.items() if name.startswith("sensors.") and one.beyond
    ]  # fmt: skip
    shared = {name: value for name, value in of_rig.items() if name in case.vehicle.parameters}
    rig = with_faults(case.rig.with_values(of_rig), faults)
    vehicle = with_faults(case.vehicle.with_values(shared), faults)
    made = replace(
        case, rig=rig, vehicle=vehicle, residual_vehicle=cut(vehicle, rig), loop=loop,
        uncertainty=Box(tuple(box.values())),
    )  # fmt: skip
    return made, tuple(rows)


# --- The vehicle from recordings of the road: its values and what is not known exactly of them, for the match.

KNOWN = 0.1  # of half the range of a quantity


@dataclass(frozen=True)
class KnownVehicle:
    """A case whose vehicle has the values of its recordings, what was said of each, and sentences on the rest."""

    case: Case
    values: tuple[IdentifiedValue, ...]
    notes: tuple[str, ...]


def recorded_vehicle(
    case: Case, recordings: Sequence[Path], channels: Mapping[str, Channel] | None = None
) -> tuple[System, tuple[str, ...]]:
    """The vehicle as its recordings are fitted, and notes: without the road's torques, which are not measured.

    Quantities that the model file gives with a range are fitted in it, of others those that ``[uncertainty]`` names,
    in twice its width. What it shares with the rig is taken as known where the bed tells it much better: where the
    half-width under ``[uncertainty]`` is at most a tenth of half the range.
    """
    vehicle = replace(case.vehicle, operating_point=None)
    on_rig = {part.name for part in case.rig.inputs}
    beside = {part.name for part in vehicle.inputs} - on_rig
    recorded = set()
    for path in recordings:
        recorded |= set(read_signals(path, beside, channels).channels)
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
        found = not estimate.note
        rows.append(IdentifiedValue(full, start.value, estimate.value, box[full].half_width, found))
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


# --- From recordings

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Identification:
    """A case with what recordings say of it.

    Attributes
    ----------
    case : Case
        With the values found, and under ``[uncertainty]`` what is still not known of them.
    diagnosis : Diagnosis
    values : tuple of IdentifiedValue
        One a quantity.
    notes : tuple of str
        What of the diagnosis the case does not hold, and whether it ended early.
    ended_early : float or None
        The seconds that the diagnosis was allowed, where they ended it.
    """

    case: Case
    diagnosis: Diagnosis
    values: tuple[IdentifiedValue, ...]
    notes: tuple[str, ...]
    ended_early: float | None

    def to_dict(self) -> dict[str, Any]:
        """Verdict, causes, values and notes as JSON holds them."""
        causes = [cause for cause in self.diagnosis.to_dict()["causes"] if cause["in_model"]]
        return {
            "verdict": self.diagnosis.verdict,
            "causes": [{key: cause[key] for key in ("kind", "at", "evidence")} for cause in causes],
            "notes": list(self.notes), "values": [value.to_dict() for value in self.values],
            "torque_gains": {part.name: part.torque_gain for part in self.case.loop.dynamometers},
            "ended_early": self.ended_early,
        }  # fmt: skip

    def files(self) -> dict[str, str]:
        """Texts of the case file with its models, the diagnosis, and the extended model."""
        diagnosis = {"extended.toml": dumps(self.diagnosis.extended)}
        return diagnosis | {"diagnosis.json": strict_json(self.diagnosis.to_dict())} | case_files(self.case)


def vehicle_from_recordings(
    case: Case, recordings: Sequence[Path], progress: Progress, seconds: float | None,
    channels: Mapping[str, Channel] | None = None,
) -> Identification:  # fmt: skip
    """The case with the vehicle that recordings of the road show.

    ``seconds``: of the diagnosis, see :func:`_diagnosed`.
    """
    system, notes = recorded_vehicle(case, recordings, channels)
    read = [read_recording(path, system, channels) for path in recordings]
    diagnosis, limit = _diagnosed(system, read, progress, seconds)
    known = known_vehicle(case, system, diagnosis)
    early = _ended_early(limit)
    ended = limit.seconds if early else None
    return Identification(known.case, diagnosis, known.values, (*early, *notes, *known.notes), ended)


def bed_from_recordings(
    case: Case, recordings: Sequence[Path], progress: Progress = lambda _: None, seconds: float | None = None,
    *, closed: bool = False, last: float | None = None, channels: Mapping[str, Channel] | None = None,
) -> Identification:  # fmt: skip
    """The case with the bed that recordings show: torque commands and every sensor of the rig.

    ``seconds``: of the diagnosis, see :func:`_diagnosed`. ``closed``: a mean torque kept free play closed; ``last`` (s)
    of a recording are taken, None: all of it.
    """
    read = [read_recording(path, bed_system(case), channels) for path in recordings]
    if last is not None:
        read = [one.cut(max(float(one.time[-1]) - last, float(one.time[0])), float(one.time[-1])) for one in read]
    system = recorded_bed_system(case, read, closed=closed)
    diagnosis, limit = _diagnosed(system, read, progress, seconds)
    made = identified_case(case, diagnosis)
    after = {quantity.name: quantity for quantity in made.case.uncertainty.uncertain}
    values = tuple(_identified(quantity, after[quantity.name], case, made.case, diagnosis)
                   for quantity in case.uncertainty.without("vehicle.").uncertain)  # fmt: skip
    early = _ended_early(limit)
    return Identification(made.case, diagnosis, values, (*early, *made.notes), limit.seconds if early else None)


def recorded_bed_system(case: Case, recordings: Sequence[Recording], *, closed: bool = False) -> System:
    """The bed of recordings: with friction where all rotors turn all the time, without free play where it is closed."""
    speeds = [one.speed_sensor for one in case.loop.dynamometers]
    turning = all(
        name in one.channels and np.nanmin(np.abs(one[name])) > TURNING * np.nanmax(np.abs(one[name]))
        for one in recordings for name in speeds
    )  # fmt: skip
    system = bed_system(case, turning=turning)
    if closed:
        system = replace(system, effects=tuple(effect for effect in system.effects if not effect.law.free_play))
    return system


TURNING = 0.1  # of the largest speed of a rotor: what stays above it does not come to rest


def _identified(before: Uncertain, after: Uncertain, case: Case, made: Case, diagnosis: Diagnosis) -> IdentifiedValue:
    """A quantity before and after; the torque gain of a dynamometer as the case states it, not relative to that."""
    keys = [names_in_system(case).get(before.name, "")]
    of_loop = before.name.removeprefix("loop.")
    if of_loop in OWN_TIMES:
        own = [own_times(dynamometer) for dynamometer in case.loop.dynamometers]
        keys = [names[of_loop] for names in own if of_loop in names]
    found = all(key in diagnosis.parameters and not diagnosis.parameters[key].note for key in keys)
    if not before.name.endswith(GAIN):
        return IdentifiedValue(before.name, before.value, after.value, after.half_width, found)
    name = before.name.removeprefix("dynamometers.").removesuffix(GAIN)
    gains = [next(own.torque_gain for own in one.loop.dynamometers if own.name == name) for one in (case, made)]
    return IdentifiedValue(before.name, gains[0], gains[1], after.half_width * gains[1], found)


def _diagnosed(
    system: System, read: Sequence[Recording], progress: Progress, seconds: float | None
) -> tuple[Diagnosis, TimeLimit]:
    """The diagnosis of recordings, and whether its time was over.

    After 0.7 of the seconds no further cause is searched for, after all of them every fit ends where it is: what is
    then left takes some seconds more.
    """
    with limited(seconds, of_processor=True) as limit:
        return diagnose(system, read, None, progress), limit


def _ended_early(limit: TimeLimit) -> tuple[str, ...]:
    """A sentence on a diagnosis that its time ended."""
    if not limit.ended_at:
        return ()
    ended = f"the time of the diagnosis was over ({limit.seconds:g} s of processor time, --diagnosis-limit)"
    if limit.ended_at < 1:
        return (f"{ended}: its causes are the best that it had until then",)
    return (f"{ended}: causes and values are the best that it had until then, and less certain than they state",)


@dataclass(frozen=True)
class FromRecordings(Displayed):
    """A case known from recordings of bed and vehicle, each None where it was not recorded."""

    case: Case
    bed: Identification | None
    vehicle: Identification | None

    def to_dict(self) -> dict[str, Any]:
        """As ``identification.json`` holds it."""
        return {name: None if part is None else part.to_dict() for name, part in self._parts()}

    def files(self) -> dict[str, str]:
        """Texts of the case file with its models, ``identification.json``, and a folder for bed and vehicle each."""
        files = {
            f"{name}/{file}": text
            for name, part in self._parts() if part is not None
            for file, text in part.files().items()
        }  # fmt: skip
        return files | case_files(self.case) | {"identification.json": strict_json(self.to_dict())}

    def _parts(self) -> tuple[tuple[str, Identification | None], ...]:
        return ("bed", self.bed), ("vehicle", self.vehicle)


def recordings_read(
    case: Case, vehicle: Sequence[Path], bed: Sequence[Path], channels: Mapping[str, Channel] | None = None
) -> dict[str, str]:
    """What recordings of vehicle and bed hold, in words, by file; nothing is fitted."""
    _check_any(vehicle, bed)
    of_bed = bed_system(case)
    contents = {str(path): contents_of(read_recording(path, of_bed, channels), of_bed) for path in bed}
    if vehicle:
        system, notes = recorded_vehicle(case, vehicle, channels)
        contents |= {
            str(path): "; ".join((contents_of(read_recording(path, system, channels), system), *notes))
            for path in vehicle
        }
    return contents


def _check_any(vehicle: Sequence[Path], bed: Sequence[Path]) -> None:
    if not (vehicle or bed):
        raise InputError("--vehicle, --bed", "no recording is given", "give one of the vehicle or of the bed")


def identify(
    case: Case,
    vehicle: Sequence[Path],
    bed: Sequence[Path],
    progress: Progress = lambda _: None,
    seconds: float | None = None,
    channels: Mapping[str, Channel] | None = None,
) -> FromRecordings:
    """The case as recordings of vehicle and bed show it; the bed, whose commands are known, comes first.

    ``seconds``: of each diagnosis at most; None: as many as it needs. ``channels``: names in the recordings.
    """
    _check_any(vehicle, bed)
    of_bed = of_vehicle = None
    if bed:
        tell = lambda step: progress(f"bed: {step}")  # noqa: E731
        of_bed = bed_from_recordings(case, bed, tell, seconds, channels=channels)
        case = of_bed.case
    if vehicle:
        tell = lambda step: progress(f"vehicle: {step}")  # noqa: E731
        of_vehicle = vehicle_from_recordings(case, vehicle, tell, seconds, channels)
        case = of_vehicle.case
    return FromRecordings(case, of_bed, of_vehicle)
