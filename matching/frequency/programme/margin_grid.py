"""Where in s the modulus margin and the least damping are held."""

from __future__ import annotations

import casadi as ca
import numpy as np

from matching.frequency.case.case import Case
from modelling.modal.modes import modes

MARGIN_RESERVE = 1.002  # on the modulus margin, for what lies between grid points
GRID_HZ = np.concatenate(
    [
        np.geomspace(0.02, 5, 18, endpoint=False),
        np.geomspace(5, 150, 64, endpoint=False),
        np.geomspace(150, 500, 12),
    ]
)  # where the modulus margin is held from the start
SLOTS = 30  # frequencies beside that grid, where a solution turns out to miss the margin
UNUSED_HZ = 600.0  # of a slot that is not needed: there the loop has no gain left
SURVEY_HZ = np.geomspace(0.02, 500, 1200)  # where a missed margin is looked for
RAY_HZ = np.geomspace(0.3, 150, 30)  # |s|/2π on the ray of least damping


def margin_points(case: Case, extra: ca.MX) -> ca.MX:
    """Where the margin is held and how far, (3, f): on the grid, at ``extra`` frequencies in Hz, and on the ray."""
    near = np.array([mode.frequency for mode in modes(case.rig) if 0 < mode.frequency < 400])
    omega = 2 * np.pi * np.concatenate([GRID_HZ, *(near * part for part in (0.96, 1.0, 1.04))])
    least, zeta, ray = case.limits["modulus_margin"] * MARGIN_RESERVE, case.limits["damping_ratio"], 2 * np.pi * RAY_HZ
    on_grid = np.vstack([0 * omega, omega, np.full(len(omega), least)])
    on_ray = np.vstack([-zeta * ray, ray * np.sqrt(1 - zeta**2), np.full(len(ray), least / 2)])
    slots = extra.numel()
    added = ca.vertcat(ca.MX(1, slots), 2 * np.pi * extra.T, ca.MX(ca.DM.ones(1, slots) * least))
    return ca.horzcat(ca.MX(ca.DM(on_grid)), ca.densify(added), ca.MX(ca.DM(on_ray)))


def survey_points(case: Case) -> np.ndarray:
    """The dense grid on which a missed margin is looked for: s and least distance (3, f)."""
    least = np.full(len(SURVEY_HZ), case.limits["modulus_margin"] * MARGIN_RESERVE)
    return np.vstack([0 * SURVEY_HZ, 2 * np.pi * SURVEY_HZ, least])
