"""What a controller does on a set of beds and what it asks of them: the figures that the search works with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from matching.frequency.beds.closed_loop import (
    Action,
    BedSet,
    action,
    bed_set,
    closed_matrices,
    damping,
    errors,
    return_difference,
)
from matching.frequency.beds.requirements import Requirements
from matching.frequency.case.case import Case
from modelling.bed.sampled_controller import SampledController

BAND_POINTS = 120  # log-spaced frequencies over the band of the case, for the bed as planned
BED_POINTS = 60  # the same for drawn beds: fewer miss the transmission zeros, where the error is largest
HIGH_POINTS = 120  # log-spaced frequencies above the emulated band, up to half the sampling frequency
NOISE_POINTS = 400  # linear, over which command noise is summed
SINGULAR = 1e-12  # of I + L: a loop on the edge of stability


@dataclass(frozen=True)
class LoopFigures:
    """Of the bed as planned.

    Attributes
    ----------
    modulus_margin, margin_at : float
        Least singular value of I + L above the emulated band, and where, Hz.
    largest_rolled_off : float
        Largest singular value of T = L/(1 + L) where the loop has to have rolled off.
    command_noise : float
        N·m rms of the noisiest dynamometer's command, of the sensors' uncertainties alone.
    """

    modulus_margin: float
    margin_at: float
    largest_rolled_off: float
    command_noise: float


@dataclass(frozen=True)
class Planned:
    """The bed as planned, at the frequencies its figures need."""

    band: BedSet
    high: BedSet
    noise: BedSet
    uncertainty: np.ndarray


def planned(case: Case, required: Requirements, noise: np.ndarray) -> Planned:
    """Prepare the bed as planned; ``noise`` (y,) are the sensors' standard deviations."""
    top = 0.499 / case.loop["sample_time"]
    low = min(required.margin_from, top / 2)
    return Planned(
        bed_set(case, [{}], np.geomspace(*case.band, BAND_POINTS)),
        bed_set(case, [{}], np.geomspace(low, top, HIGH_POINTS)),
        bed_set(case, [{}], (np.arange(NOISE_POINTS) + 0.5) / NOISE_POINTS * top),
        noise,
    )


def loop_figures(bed: Planned, controller: SampledController, required: Requirements) -> LoopFigures:
    """Margin, roll-off and noise of a controller."""
    acting = action(controller, bed.high.frequencies)
    difference = return_difference(bed.high, acting)[0]
    sizes = np.linalg.svd(difference, compute_uv=False)[:, -1]
    closed = np.linalg.solve(difference, np.eye(difference.shape[-1]) - difference)
    rolled_off = bed.high.frequencies >= required.rolled_off_from
    largest = np.linalg.svd(closed[rolled_off], compute_uv=False)[:, 0].max(initial=0.0)
    at = int(np.argmin(sizes))
    noise = _noise(bed, controller)
    return LoopFigures(float(sizes[at]), float(bed.high.frequencies[at]), float(largest), noise)


def _noise(bed: Planned, controller: SampledController) -> float:
    """Root of the summed power of commands for white sensor noise."""
    acting = action(controller, bed.noise.frequencies)
    commands = np.linalg.solve(return_difference(bed.noise, acting)[0], acting.of_readings * bed.uncertainty)
    return float(np.sqrt((np.abs(commands) ** 2).sum(axis=2).mean(axis=0).max()))


@dataclass(frozen=True)
class BedFigures:
    """Of b beds: largest pole magnitude, least damping ratio, response errors to measured and unmeasured torques."""

    largest_pole: np.ndarray
    damping_ratio: np.ndarray
    measured: np.ndarray
    unmeasured: np.ndarray

    def stable(self, neutral: float = 1e-9) -> np.ndarray:
        """Which beds (b,) are stable; a rigid motion that nothing slows stands at 1."""
        return self.largest_pole < 1 + neutral


def bed_figures(beds: BedSet, controller: SampledController, told: Sequence[str]) -> BedFigures:
    """Figures of every bed of a set."""
    acting: Action = action(controller, beds.frequencies)
    size, ratio = damping(np.linalg.eigvals(closed_matrices(beds, controller)), controller.sample_time)
    measured, unmeasured = (np.sqrt(errors(beds, acting, those).mean(axis=1)) for those in (told, ()))
    return BedFigures(size, ratio, measured, unmeasured)
