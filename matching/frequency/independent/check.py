"""What the independent method says of a tuned case, beside what the search and the verification found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from matching.frequency.case.case import Case
from matching.frequency.independent.chain import Chain, NotCovered
from matching.frequency.independent.closed_loop import IndependentLoop, plain_response

MARGIN_TOLERANCE = 1e-3  # of the modulus margin: both sides look for its minimum on grids of their own
RESPONSE_TOLERANCE = 1e-6  # relative: the same linear equations, solved in two ways
LOWEST, HIGHEST = 1e-3, 5e3  # Hz, between which the margin is looked for


@dataclass(frozen=True)
class IndependentCheck:
    """The tuned case by dynamic stiffness.

    Attributes
    ----------
    not_covered : str
        What of the case this method does not know; all else is None then.
    unstable_poles : int or None
        Closed-loop poles in the right half plane.
    modulus_margin, margin_frequency : float or None
        Least singular value of I + L, and where, Hz.
    vehicle_difference, rig_difference : float or None
        Largest relative difference of the responses of vehicle and controlled rig (unmeasured torques) from those
        that the verification reports.
    """

    not_covered: str
    unstable_poles: int | None = None
    modulus_margin: float | None = None
    margin_frequency: float | None = None
    vehicle_difference: float | None = None
    rig_difference: float | None = None

    def disagreements(self, stable: bool, modulus_margin: float) -> list[str]:
        """Sentences on where it differs from a verdict on stability and a modulus margin."""
        if self.not_covered:
            return []
        assert self.modulus_margin is not None
        differences = []
        if (self.unstable_poles == 0) != stable:
            differences.append(f"{self.unstable_poles} closed-loop poles in the right half plane by dynamic stiffness")
        if stable and abs(self.modulus_margin - modulus_margin) > MARGIN_TOLERANCE:
            differences.append(
                f"a modulus margin of {self.modulus_margin:.4f} by dynamic stiffness, {modulus_margin:.4f} here"
            )
        for name, difference in (("vehicle", self.vehicle_difference), ("controlled rig", self.rig_difference)):
            if difference is not None and not difference <= RESPONSE_TOLERANCE:
                differences.append(f"responses of the {name} that differ by {difference:.2g} by dynamic stiffness")
        return differences

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return dict(vars(self))


def check(case: Case, frequencies: np.ndarray, vehicle: np.ndarray, controlled: np.ndarray) -> IndependentCheck:
    """Judge a tuned case.

    Parameters
    ----------
    frequencies : ndarray (f,)
        Hz.
    vehicle, controlled : ndarray (f, h)
        Responses of the vehicle and of the rig to unmeasured torques as the verification has them, for the compared
        functions of the case.
    """
    try:
        loop, reference = IndependentLoop(case), Chain(case.vehicle)
        s = 2j * np.pi * np.asarray(frequencies)
        pairs = [(pair.input, pair.sensor) for pair in case.compared]
        of_vehicle = np.stack([plain_response(reference, s, *pair) for pair in pairs], axis=1)
        of_rig = np.stack([loop.response(s, *pair) for pair in pairs], axis=1)
        unstable = loop.unstable_poles()
    except NotCovered as reason:
        return IndependentCheck(not_covered=str(reason))
    margin, where = _margin(loop)
    return IndependentCheck(
        "", unstable, margin, where, _difference(of_vehicle, vehicle), _difference(of_rig, controlled)
    )


def _difference(first: np.ndarray, second: np.ndarray) -> float:
    """Largest difference (f, h), relative to each function's largest magnitude."""
    return float((np.abs(first - second) / np.abs(first).max(axis=0)).max())


def _margin(loop: IndependentLoop) -> tuple[float, float]:
    """Least singular value of I + L over a fine grid, its lowest minima refined; and where, Hz."""

    def least(f: np.ndarray) -> np.ndarray:
        return np.linalg.svd(loop.return_difference(2j * np.pi * f), compute_uv=False)[:, -1]

    grid = np.geomspace(LOWEST, HIGHEST, 3000)
    sizes = least(grid)
    inner = np.flatnonzero((sizes[1:-1] <= sizes[:-2]) & (sizes[1:-1] <= sizes[2:])) + 1
    best = float(sizes.min()), float(grid[np.argmin(sizes)])
    for i in inner[np.argsort(sizes[inner])][:8]:
        minimum = scipy.optimize.minimize_scalar(
            lambda f: float(least(np.array([f]))[0]), bounds=(grid[i - 1], grid[i + 1]), method="bounded",
            options={"xatol": 1e-7 * grid[i]},
        )  # fmt: skip
        best = min(best, (float(minimum.fun), float(minimum.x)))
    return best
