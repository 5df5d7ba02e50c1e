"""Margin, roll-off and noise of a sampled law on the bed as planned, by dynamic stiffness."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from matching.frequency.case.case import Case
from matching.frequency.independent.beds_check import Judge
from matching.frequency.independent.chain import NotCovered
from modelling.controller.law import ControlLaw

POINTS = 240  # log-spaced frequencies from the band's lower edge to half the sampling frequency
HIGHEST_SHARE = 0.499  # of the sampling frequency


@dataclass(frozen=True)
class LoopCheck:
    """Least singular value of I + L from where it counts on and where (Hz), largest of T, noise of commands (k,), N·m.

    NaN where the case holds what this room does not know.
    """

    modulus_margin: float
    margin_at: float
    largest_rolled_off: float
    command_noise: tuple[float, ...]


def check_loop(
    case: Case, law: ControlLaw, uncertainty: np.ndarray, margin_from: float, rolled_off_from: float
) -> LoopCheck:
    """Judge a law on the bed as planned.

    Parameters
    ----------
    uncertainty : ndarray (y,)
        Standard deviations of the readings, SI.
    margin_from, rolled_off_from : float
        Hz, from where on the margin counts and T has to be small.
    """
    top = HIGHEST_SHARE / law.sample_time
    f = np.geomspace(min(case.band[0], top / 2), top, POINTS)
    try:
        difference, of_readings = Judge(case, law, f).planned()
    except NotCovered:
        return LoopCheck(np.nan, np.nan, np.nan, (np.nan,) * len(law.dynamometers))
    sizes = np.linalg.svd(difference, compute_uv=False)[:, -1]
    sizes[f < min(margin_from, f[-1])] = np.inf
    at = int(np.argmin(sizes))
    T = np.linalg.solve(difference, np.eye(difference.shape[-1]) - difference)[f >= rolled_off_from]
    power = (np.abs(np.linalg.solve(difference, of_readings * uncertainty)) ** 2).sum(axis=2)
    # a sample's noise is spread evenly up to half the sampling frequency; below the band it counts as at its edge
    noise = np.sqrt((np.trapezoid(power, f, axis=0) + power[0] * f[0]) / f[-1])
    rolled_off = float(np.linalg.svd(T, compute_uv=False).max(initial=0.0)) if len(T) else 0.0
    return LoopCheck(float(sizes[at]), float(f[at]), rolled_off, tuple(noise.tolist()))
