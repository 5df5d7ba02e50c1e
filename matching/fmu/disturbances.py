"""What moves a bed's readings where no shaft opens: noise, encoders, torques that step unmeasured or late, the road."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from matching.fmu.deviations import BedEvents, LinearBed, no_events
from matching.frequency.case.case import Case
from matching.frequency.in_time.imperfection import DEMAND_FACTOR, DEMAND_LATE_S
from matching.frequency.in_time.sensing import ANGLE_OF_A_COUNT
from modelling.bed.observer.model import NOISE
from modelling.controller.opened_shaft import WATCHED_SAMPLES

FOLLOWED_SAMPLES = 120  # of what a step or a wrong reading does: the observer has followed it then


@dataclass(frozen=True)
class Disturbances:
    """What moves the readings where no shaft opens: windows (i, WATCHED_SAMPLES · y) of deviations, newest first.

    ``noise``: independent parts with a standard deviation of 1; ``steps``: the largest torques at once, at each of
    ``count`` times and beds.
    """

    noise: np.ndarray
    steps: np.ndarray
    count: int


def disturbances(case: Case, beds: Sequence[LinearBed], scale: float) -> Disturbances:
    """Noise of the bed as planned, and steps of torque on all of them."""
    noise = windows(beds[0].run(_wrong_readings(case, beds[0]))[0])
    steps = [windows(bed.run(_torque_steps(case, bed, scale))[0]) for bed in beds]
    size = noise.shape[-1]
    count = sum(len(of_bed) for of_bed in steps)
    return Disturbances(noise.reshape(-1, size), np.concatenate(steps).reshape(-1, size), count)


def windows(off: np.ndarray) -> np.ndarray:
    """Deviations (t, y, e) as (t − WATCHED_SAMPLES + 1, e, WATCHED_SAMPLES · y), the newest sample first."""
    count = len(off) - WATCHED_SAMPLES + 1
    shifted = [off[WATCHED_SAMPLES - 1 - i : WATCHED_SAMPLES - 1 - i + count] for i in range(WATCHED_SAMPLES)]
    return np.concatenate(shifted, axis=1).transpose(0, 2, 1)


def _wrong_readings(case: Case, bed: LinearBed) -> BedEvents:
    """One wrong reading of every sensor: its noise, and what a count of an encoder does to two samples."""
    law, sensors = bed.law, {sensor.name: sensor for sensor in case.rig.sensors}
    of_law = [sensors[name] for name in law.sensors]
    events = no_events(bed, FOLLOWED_SAMPLES, 2 * len(of_law))
    count = ANGLE_OF_A_COUNT / law.sample_time / np.sqrt(12.0)  # an angle that is even over a count
    at = WATCHED_SAMPLES - 1
    for i, sensor in enumerate(of_law):
        events.errors[at, i, 2 * i] = sensor.uncertainty or NOISE[sensor.measures]
        if sensor.measures == "speed":
            events.errors[at : at + 2, i, 2 * i + 1] = count, -count
    return events


def _torque_steps(case: Case, bed: LinearBed, scale: float) -> BedEvents:
    """Every torque at once: those of the rig not measured, and measured but late and large; those of the road."""
    law = bed.law
    driven = {dynamometer.torque_input for dynamometer in case.loop.dynamometers}
    on_rig = [part.name for part in case.rig.inputs if part.name not in driven]
    sizes = torque_sizes(case, bed, scale)
    steps = [(name, False) for name in on_rig] + [(name, True) for name in law.known]
    events, at = no_events(bed, FOLLOWED_SAMPLES, len(steps)), WATCHED_SAMPLES - 1
    for e, (name, known) in enumerate(steps):
        size, late = sizes[name], round(DEMAND_LATE_S / law.sample_time) if known else 0
        if name in on_rig:
            factor = DEMAND_FACTOR if known else 1.0
            events.torques[at + late :, :, e] = factor * size * bed.inputs[name]
        if known:
            events.known[at:, law.known.index(name), e] = size
    return events


def torque_sizes(case: Case, bed: LinearBed, scale: float) -> dict[str, float]:
    """N·m by which each torque steps: over the manoeuvre, or what balances flange torques of ``scale``, if larger."""
    balance = bed.balancing()
    sizes = {}
    for name in (*balance, *bed.law.known):
        manoeuvre = case.manoeuvre.get(name)
        planned = 0.0 if manoeuvre is None else abs(manoeuvre.amplitude)
        sizes[name] = max(planned, scale * float(np.abs(balance[name]).sum()) if name in balance else scale)
    return sizes
