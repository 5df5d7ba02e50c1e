"""Whether a bed swings on in an open lash where the vehicle comes to rest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from matching.frequency.case.case import Case
from matching.frequency.in_time.closed_loop import BedMotion, BedRun
from matching.frequency.in_time.imperfection import Imperfection

LASHES_RAD = (np.radians(0.5), np.radians(5.0))  # of a drive's whole lash, from new to worn
DRAWN = 4
PULSE_S = (0.2, 0.3)  # torque that closes the lash, and leaves it open
JUDGED_S = 0.5  # at the end
CYCLING = 0.02  # of the vehicle's range, by which the bed's torque swings more than the vehicle's


@dataclass(frozen=True)
class OpenLash:
    """What drawn lashes do on drawn beds.

    Attributes
    ----------
    drawn, cycling : int
        ``cycling`` swing on where the vehicle comes to rest, or are not stable.
    largest_swing, vehicle_swing : float
        N·m rms of the torque at a cut over the last half second, of the worst bed and of the vehicle beside it.
    """

    drawn: int
    cycling: int
    largest_swing: float
    vehicle_swing: float

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return dict(vars(self))


def lash_runs(case: Case, torques: Mapping[str, np.ndarray], known: tuple[str, ...], seed: int) -> list[BedRun]:
    """A pulse at the first input of the rig that is no dynamometer's, on drawn beds with drawn lashes."""
    return drawn_lashes(case, torques, known, DRAWN, seed)


def drawn_lashes(
    case: Case, torques: Mapping[str, np.ndarray], known: tuple[str, ...], count: int, seed: int
) -> list[BedRun]:  # fmt: skip
    """The same for any number of lashes."""
    driven = {dynamometer.torque_input for dynamometer in case.loop.dynamometers}
    inputs = [part.name for part in case.rig.inputs if part.name not in driven]
    inputs.sort(key=lambda name: -np.abs(torques.get(name, np.zeros(1))).max())
    if not inputs:
        return []
    length = len(next(iter(torques.values())))
    time = np.arange(length) * case.loop["sample_time"]
    size = float(np.abs(torques.get(inputs[0], np.zeros(1))).max()) or float(
        max(np.abs(own).max() for own in torques.values())
    )
    pulse = {inputs[0]: size * ((time >= PULSE_S[0]) & (time < PULSE_S[1]))}
    gaps = np.random.default_rng(seed).uniform(*LASHES_RAD, count)
    beds = case.uncertainty.draw(count, seed + 1)
    return [
        BedRun(Imperfection("open lash", case.uncertainty.at(bed), float(gap)), pulse, known)
        for bed, gap in zip(beds, gaps, strict=True)
    ]  # fmt: skip


def open_lash(
    runs: Sequence[BedRun], vehicles: Sequence[np.ndarray], beds: Sequence[BedMotion | None], at: Sequence[int], step: float
) -> OpenLash:  # fmt: skip
    """Judge vehicles (t, y) and beds of runs by the readings ``at`` torques of the cuts."""
    last = slice(-round(JUDGED_S / step), None)
    swings = []
    for vehicle, bed in zip(vehicles, beds, strict=True):
        of_vehicle = float(np.std(vehicle[last][:, at], axis=0).max())
        of_bed = np.inf if bed is None else float(np.std(bed.readings[last][:, at], axis=0).max())
        swings.append((of_bed, of_vehicle, CYCLING * float(np.ptp(vehicle[:, at], axis=0).max())))
    worst = max(swings, key=lambda row: row[0] - row[1])
    cycling = sum(bed > vehicle + more for bed, vehicle, more in swings)
    return OpenLash(len(runs), cycling, worst[0], worst[1])
