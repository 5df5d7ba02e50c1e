"""Runs on a bed: the identification recording under a slow speed hold, and the proof of the controlled bed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from matching.commissioning.fmu_bed import FmuBed, FmuController, columns, held_as_linear
from matching.excitation.result import ExcitationPlan
from matching.excitation.signals import fade
from matching.frequency.case.case import Case
from modelling.common.errors import InputError
from modelling.controller.law import ControlLaw
from modelling.controller.settings import EMULATION, FAULTS, SPEED_HOLD
from modelling.controller.supervised import SupervisedController
from modelling.measurement.write import csv_text

SETTLING = 2.0  # s of speed hold before anything is recorded
PROOF_PERIODS = 16.0  # of the lowest frequency of the band
SHORTEST_PROOF = 20.0  # s
PROOF_SHARE = 0.8  # of the manoeuvre's largest torque: peak of the proof's excitation
LARGEST_TRIES = 30  # draws of the phases


def excited_recording(bed: FmuBed, case: Case, plan: ExcitationPlan) -> str:
    """Text of the CSV recording of a planned excitation on a bed."""
    step, k = case.loop["sample_time"], len(case.loop.dynamometers)
    speeds = [bed.sensors.index(dynamometer.speed_sensor) for dynamometer in case.loop.dynamometers]
    proportional, integral = (np.array([own[i] for own in plan.hold.values()]) for i in (0, 1))
    before = round(SETTLING / step)
    demands = np.vstack([np.zeros((before, len(plan.inputs))), plan.torques])
    bed.begin(plan.speed)
    sent, readings, total = np.zeros_like(demands), np.zeros((len(demands), len(bed.sensors))), np.zeros(k)
    for i, demand in enumerate(demands):
        readings[i] = bed.readings()
        error = plan.speed - readings[i, speeds]
        sent[i] = demand
        sent[i, :k] += proportional * error + total
        total += integral * step * error
        bed.step(sent[i], step)
    return _csv(case, bed, step, held_as_linear(sent)[before:], readings[before:], plan.inputs)


@dataclass(frozen=True)
class Proof:
    """What excites the controlled bed: torques (t, e) by name of the compared inputs, N·m, at steps (s)."""

    inputs: tuple[str, ...]
    torques: np.ndarray
    step: float


def proof(case: Case, seed: int = 0) -> Proof:
    """Random-phase multisines on every compared torque, together, over the band.

    Raises
    ------
    InputError
        If the manoeuvre has none of a compared torque, so that its size is not known.
    """
    step = case.loop["sample_time"]
    lasts = max(PROOF_PERIODS / case.band[0], SHORTEST_PROOF)
    count, rng = round(lasts / step), np.random.default_rng(seed)
    f = np.fft.rfftfreq(count, step)
    inside = (f >= 0.7 * case.band[0]) & (f <= 1.2 * case.band[1])
    names = tuple(dict.fromkeys(pair.input for pair in case.compared))
    found = []
    for name in names:
        manoeuvre = case.manoeuvre.get(name)
        peak = 0.0 if manoeuvre is None else float(np.abs(manoeuvre.torque(manoeuvre.time())).max())
        if peak == 0:
            raise InputError(f"manoeuvre.{name}", "is missing", "its largest torque says how large the proof may be")
        amplitude = np.where(inside, 1.0, 0.0)
        waves = np.fft.irfft(amplitude * np.exp(2j * np.pi * rng.random((LARGEST_TRIES, len(f)))), count)
        wave = waves[np.argmin(np.abs(waves).max(axis=1) / waves.std(axis=1))] * fade(count, step)
        found.append(PROOF_SHARE * peak * wave / np.abs(wave).max())
    return Proof(names, np.stack(found, axis=1), step)


def proof_csv(wanted: Proof) -> str:
    """Text of the proof's torques as CSV."""
    time = np.arange(len(wanted.torques)) * wanted.step
    return csv_text(time, columns(wanted.inputs, wanted.torques), dict.fromkeys(wanted.inputs, "N*m"))


def proof_recording(  # bed and controller are both stepped: one more than six
    bed: FmuBed,
    case: Case,
    law: ControlLaw,
    controller: FmuController | SupervisedController,
    wanted: Proof,
    speed: float,
) -> str:
    """Text of the CSV recording of the controlled bed under a proof's torques, emulation on.

    Raises
    ------
    InputError
        If the controller's watchdogs end the emulation.
    """
    step = wanted.step
    k, before = len(law.dynamometers), round(SETTLING / step)
    drives = [name for name in bed.inputs if name not in {own.torque_input for own in case.loop.dynamometers}]
    at = [bed.sensors.index(name) for name in law.sensors]
    torques = np.vstack([np.zeros((before, len(wanted.inputs))), wanted.torques])
    readings, hold = np.zeros((len(torques), len(bed.sensors))), np.full(k, speed)
    bed.begin(speed)
    for i, torque in enumerate(torques):
        now = dict(zip(wanted.inputs, torque, strict=True))
        readings[i] = bed.readings()
        known = np.array([now.get(name, 0.0) for name in law.known])
        answer = controller.step(readings[i, at], known, SPEED_HOLD if i < before // 2 else EMULATION, hold, i)
        if answer.fault:
            raise InputError(
                "bed", f"{(i - before) * step:.3f} s after the start the controller gave up: {FAULTS[answer.fault]}",
                "look at the recording, limits and watchdogs",
            )  # fmt: skip
        bed.step(np.concatenate([answer.commands, [now.get(name, 0.0) for name in drives]]), step)
    return _csv(case, bed, step, held_as_linear(torques)[before:], readings[before:], wanted.inputs)


def _csv(
    case: Case, bed: FmuBed, step: float, torques: np.ndarray, readings: np.ndarray, inputs: tuple[str, ...]
) -> str:
    units = {sensor.name: sensor.unit for sensor in case.rig.sensors} | dict.fromkeys(inputs, "N*m")
    return csv_text(
        np.arange(len(torques)) * step, {**columns(inputs, torques), **columns(bed.sensors, readings)}, units
    )
