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
EXCESS = 0.02  # of the vehicle's range, by which the bed's torque swings more than the vehicle's
DECAYING = 0.95  # swing over that of the half second before: below it the bed comes to rest as well


@dataclass(frozen=True)
class OpenLash:
    """What drawn lashes do on drawn beds.

    Attributes
    ----------
    drawn, limit_cycles : int
        ``limit_cycles`` swing on where the vehicle comes to rest, or are not stable.
    largest_swing, vehicle_swing : float
        N·m rms of the torque at a cut over the last half second, of the worst bed and of the vehicle beside it.
    """

    drawn: int
    limit_cycles: int
    largest_swing: float
    vehicle_swing: float

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return dict(vars(self))


def lash_runs(
    case: Case, torques: Mapping[str, np.ndarray], known: tuple[str, ...], seed: int, count: int = DRAWN
) -> list[BedRun]:
    """A pulse at the input of the rig that the manoeuvre drives hardest, on ``count`` drawn beds with drawn lashes.

    ``torques`` are those of the manoeuvre, (t,) in N·m by input.
    """
    driven = {dynamometer.torque_input for dynamometer in case.loop.dynamometers}
    inputs = [part.name for part in case.rig.inputs if part.name not in driven]
    inputs.sort(key=lambda name: -np.abs(torques.get(name, np.zeros(1))).max())
    if not inputs:
        return []
    length = len(next(iter(torques.values())))
    time = np.arange(length) * case.loop["sample_time"]
    size = float(np.abs(torques.get(inputs[0], np.zeros(1))).max()) or float(
        max(np.abs(torque).max() for torque in torques.values())
    )
    pulse = {inputs[0]: size * ((time >= PULSE_S[0]) & (time < PULSE_S[1]))}
    gaps = np.random.default_rng(seed).uniform(*LASHES_RAD, count)
    beds = case.uncertainty.draw(count, seed + 1)
    return [
        BedRun(Imperfection("open lash", case.uncertainty.at(bed), float(gap)), pulse, known)
        for bed, gap in zip(beds, gaps, strict=True)
    ]  # fmt: skip


def open_lash(
    vehicles: Sequence[np.ndarray], beds: Sequence[BedMotion | None], at: Sequence[int], step: float
) -> OpenLash:
    """Judge vehicles (t, y) and beds of lashes by the readings ``at``, torques at the cuts; ``step`` in s."""
    count = min(round(JUDGED_S / step), len(vehicles[0]) // 2)
    before, last = slice(-2 * count, -count), slice(-count, None)
    swings, limit_cycles = [], 0
    for vehicle, bed in zip(vehicles, beds, strict=True):
        of_vehicle, of_bed = _swing(vehicle[last][:, at]), np.inf
        if bed is not None:
            of_bed = _swing(bed.readings[last][:, at])
            decaying = of_bed < DECAYING * _swing(bed.readings[before][:, at])
            least = of_vehicle + EXCESS * float(np.ptp(vehicle[:, at], axis=0).max())
        limit_cycles += bed is None or (of_bed > least and not decaying)
        swings.append((of_bed, of_vehicle))
    worst = max(swings, key=lambda pair: pair[0] - pair[1])
    return OpenLash(len(beds), limit_cycles, *worst)


def _swing(torques: np.ndarray) -> float:
    """Largest standard deviation of torques (t, k)."""
    return float(np.std(torques, axis=0).max())
