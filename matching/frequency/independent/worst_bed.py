"""The worst bed of a box: ascent by the gradient of the least damping, from the worst of the drawn beds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from matching.frequency.case.uncertainty import Box

STARTS = 2  # drawn beds with the least damping
ROUNDS = 4  # of the ascent at most, each with a gradient of its own
DIFFERENCE = 0.02  # of a half-width
SHARES = (1.0, 0.5, 0.25)  # of the way to the corner that the gradient points to
WORTH_A_ROUND = 0.02  # relative fall of the damping below which no other round follows
NAMED = 4  # quantities that the least damping depends on most


class DampingJudge(Protocol):
    """Whoever tells the least damping ratio of a bed by its values."""

    def damping(self, values: Mapping[str, float]) -> float:
        """Least damping ratio of any mode."""


@dataclass(frozen=True)
class WorstBed:
    """The bed of the box with the least damping that was met.

    Attributes
    ----------
    damping_ratio : float
        Negative where it is not stable.
    values : mapping
        SI, by name.
    named : tuple of str
        Quantities that its damping depends on most, most first.
    """

    damping_ratio: float
    values: Mapping[str, float]
    named: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return {
            "damping_ratio": self.damping_ratio, "stable": self.damping_ratio > 0, "values": dict(self.values),
            "depends_most_on": list(self.named),
        }  # fmt: skip


def worst_bed(judge: DampingJudge, box: Box, positions: np.ndarray) -> WorstBed | None:
    """Look for the bed with the least damping; None where nothing is uncertain.

    Parameters
    ----------
    positions : ndarray (b, p)
        Drawn beds in the box, least damped first.
    """
    if not box.uncertain or not len(positions):
        return None

    def least(position: np.ndarray) -> float:
        return judge.damping(box.at(position))

    found = [_descended(least, position) for position in positions[:STARTS]]
    ratio, position, slopes = min(found, key=lambda one: one[0])
    order = np.argsort(-np.abs(slopes))[:NAMED]
    return WorstBed(ratio, box.at(position), tuple(box.uncertain[i].name for i in order))


def _descended(
    of: Callable[[np.ndarray], float], position: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray]:  # value, position (p,), slopes (p,)
    """The least value met on the way from a position, towards the corners that the gradients point to."""
    value, slopes = of(position), np.zeros(len(position))
    for _ in range(ROUNDS):
        inward = np.where(position > 0, -DIFFERENCE, DIFFERENCE)
        slopes = np.array([of(position + step) - value for step in np.diag(inward)]) / inward
        tried = [position + share * (-np.sign(slopes) - position) for share in SHARES]
        values = [of(one) for one in tried]
        best = int(np.argmin(values))
        if values[best] > value - WORTH_A_ROUND * abs(value):
            break
        value, position = values[best], tried[best]
    return value, position, slopes
