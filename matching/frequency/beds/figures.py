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
from modelling.bed.observer_controller import ObserverController

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


@dataclass(frozen=True)
class LoopCurves:
    """Of the bed as planned, at all its frequencies (f,).

    Attributes
    ----------
    difference : ndarray (f, k, k)
        I + L.
    margin, closed : ndarray (f,)
        Least singular value of I + L, largest of T.
    noise : ndarray (f, k, y)
        Commands for the sensors' standard deviations.
    """

    difference: np.ndarray
    margin: np.ndarray
    closed: np.ndarray
    noise: np.ndarray


def loop_curves(bed: Planned, acting: Action) -> LoopCurves:
    """Return difference, complementary sensitivity and noise of the bed as planned, which the requirements limit."""
    difference = return_difference(bed.every, acting)[0]
    identity = np.eye(difference.shape[-1])
    inverse = np.linalg.inv(difference)
    return LoopCurves(
        difference,
        np.linalg.svd(difference, compute_uv=False)[:, -1],
        np.linalg.svd(inverse - identity, compute_uv=False)[:, 0],
        inverse @ (acting.of_readings * bed.uncertainty),
    )


def command_noise(curves: LoopCurves, frequencies: np.ndarray) -> np.ndarray:
    """N·m rms (k,): a sample's noise is spread evenly up to half the sampling frequency."""
    power = (np.abs(curves.noise) ** 2).sum(axis=2)
    return np.sqrt(noise_weights(frequencies) @ power)


def noise_weights(f: np.ndarray) -> np.ndarray:
    """Weights (f,) of a mean over all frequencies up to the last; below the first it counts as there."""
    edges = np.r_[0.0, (f[1:] + f[:-1]) / 2, f[-1]]
    return np.diff(edges) / f[-1]


def counted(bed: Planned, required: Requirements) -> tuple[np.ndarray, np.ndarray]:
    """At which frequencies (f,) the margin counts, and at which the roll-off."""
    f = bed.every.frequencies
    return f >= min(required.margin_from, f[-1]), f >= required.rolled_off_from


def loop_figures(bed: Planned, controller: ObserverController, required: Requirements) -> LoopFigures:
    """Margin, roll-off and noise of a controller."""
    f = bed.every.frequencies
    curves = loop_curves(bed, action(controller, f))
    margin, rolled_off = counted(bed, required)
    at = int(np.argmin(np.where(margin, curves.margin, np.inf)))
    largest = curves.closed[rolled_off].max(initial=0.0)
    return LoopFigures(
        float(curves.margin[at]), float(f[at]), float(largest), tuple(command_noise(curves, f).tolist())
    )  # fmt: skip


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


def bed_figures(beds: BedSet, controller: ObserverController, known: Sequence[str]) -> BedFigures:
    """Figures of every bed of a set."""
    acting = action(controller, beds.frequencies)
    size, ratio = damping(np.linalg.eigvals(closed_matrices(beds.sampled, controller)), controller.sample_time)
    measured, unmeasured = (np.sqrt(errors(beds, acting, those).mean(axis=1)) for those in (known, ()))
    return BedFigures(size, ratio, measured, unmeasured)
