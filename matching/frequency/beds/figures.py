"""What a controller does on a set of beds and what it asks of them: the figures that the search works with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from matching.frequency.beds.closed_loop import (
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

PLAN_POINTS = 240  # log-spaced frequencies from the band's lower edge to half the sampling frequency
BED_POINTS = 60  # over the band, for drawn beds: fewer miss the transmission zeros, where the error is largest


@dataclass(frozen=True)
class LoopFigures:
    """Of the bed as planned.

    Attributes
    ----------
    modulus_margin, margin_at : float
        Least singular value of I + L from where it counts on, and where, Hz.
    largest_rolled_off : float
        Largest singular value of T = L/(1 + L) where the loop has to have rolled off.
    command_noise : tuple of float (k)
        N·m rms of each dynamometer's command, of the sensors' uncertainties alone.
    """

    modulus_margin: float
    margin_at: float
    largest_rolled_off: float
    command_noise: tuple[float, ...]


@dataclass(frozen=True)
class Planned:
    """The bed as planned: over the band, and at all frequencies that margin, roll-off and noise need.

    ``uncertainty`` (y,) are the standard deviations of the sensors.
    """

    band: BedSet
    every: BedSet
    uncertainty: np.ndarray


def planned(case: Case, uncertainty: np.ndarray) -> Planned:
    """Prepare the bed as planned; ``uncertainty`` (y,): standard uncertainties of the controller's sensors, SI."""
    top = 0.499 / case.loop["sample_time"]
    every = np.geomspace(min(case.band[0], top / 2), top, PLAN_POINTS)
    return Planned(
        bed_set(case, [{}], np.geomspace(*case.band, 2 * BED_POINTS)), bed_set(case, [{}], every), uncertainty
    )  # fmt: skip


def loop_figures(
    bed: Planned, controller: SampledController, required: Requirements, ahead: np.ndarray | None = None
) -> LoopFigures:  # fmt: skip
    """Margin, roll-off and noise of a controller; ``ahead`` (f, m, w) as for :func:`action`."""
    f = bed.every.frequencies
    acting = action(controller, f, ahead)
    difference = return_difference(bed.every, acting)[0]
    sizes = np.linalg.svd(difference, compute_uv=False)[:, -1]
    sizes[f < min(required.margin_from, f[-1])] = np.inf
    identity = np.eye(difference.shape[-1])
    closed = np.linalg.solve(difference, identity - difference)[f >= required.rolled_off_from]
    largest = np.linalg.svd(closed, compute_uv=False)[:, 0].max(initial=0.0) if len(closed) else 0.0
    at = int(np.argmin(sizes))
    commands = np.linalg.solve(difference, acting.of_readings * bed.uncertainty)
    power = (np.abs(commands) ** 2).sum(axis=2)
    # a sample's noise is spread evenly up to half the sampling frequency; below the band it counts as at its edge
    noise = np.sqrt((np.trapezoid(power, f, axis=0) + power[0] * f[0]) / f[-1])
    return LoopFigures(float(sizes[at]), float(f[at]), float(largest), tuple(noise.tolist()))


@dataclass(frozen=True)
class BedFigures:
    """Of b beds, each (b,): largest pole, least damping ratio, response errors to measured, unmeasured torques."""

    largest_pole: np.ndarray
    damping_ratio: np.ndarray
    measured: np.ndarray
    unmeasured: np.ndarray

    def stable(self, neutral: float = 1e-9) -> np.ndarray:
        """Which beds (b,) are stable; a rigid motion that nothing slows stands at 1."""
        return self.largest_pole < 1 + neutral


def bed_figures(
    beds: BedSet, controller: SampledController, told: Sequence[str], ahead: np.ndarray | None = None
) -> BedFigures:  # fmt: skip
    """Figures of every bed of a set; ``ahead`` (f, m, w) as for :func:`action`."""
    acting = action(controller, beds.frequencies, ahead)
    size, ratio = damping(np.linalg.eigvals(closed_matrices(beds, controller)), controller.sample_time)
    measured, unmeasured = (np.sqrt(errors(beds, acting, those).mean(axis=1)) for those in (told, ()))
    return BedFigures(size, ratio, measured, unmeasured)
