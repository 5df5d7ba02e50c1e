"""The worst beds of a box: descent by the gradient of the damping, ascent of the error, from the worst drawn beds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from matching.frequency.case.uncertainty import Box

STARTS = 2  # drawn beds with the least damping
ROUNDS = 4  # of the descent at most, each with a gradient of its own
ERROR_ROUNDS = 2  # of the error's, which takes longer to work out
DIFFERENCE = 0.02  # of a half-width
SHARES = (1.0, 0.5, 0.25)  # of the way to the corner that the gradient points to
WORTH_A_ROUND = 0.02  # relative fall below which no other round follows
NAMED = 4  # quantities that a figure depends on most


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


@dataclass(frozen=True)
class LargestError:
    """The bed of the box with the largest response error to unmeasured torques that was met; as :class:`WorstBed`."""

    unmeasured: float
    values: Mapping[str, float]
    named: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return {"unmeasured": self.unmeasured, "values": dict(self.values), "depends_most_on": list(self.named)}


def worst_bed(
    damping: Callable[[Mapping[str, float]], float], box: Box, positions: np.ndarray
) -> WorstBed | None:  # fmt: skip
    """Look for the bed with the least damping; None where nothing is uncertain.

    Parameters
    ----------
    damping : callable
        Least damping ratio of any mode of a bed, by its values.
    positions : ndarray (b, p)
        Drawn beds in the box, least damped first.
    """
    if not box.uncertain or not len(positions):
        return None
    descents = [_descended(lambda at: damping(box.at(at)), position, ROUNDS) for position in positions[:STARTS]]
    ratio, position, slopes = min(descents, key=lambda descent: descent[0])
    return WorstBed(ratio, box.at(position), _named(box, slopes))


def largest_error(
    error: Callable[[Mapping[str, float]], float], box: Box, position: np.ndarray
) -> LargestError | None:  # fmt: skip
    """Look for the bed with the largest error; None where nothing is uncertain.

    Parameters
    ----------
    error : callable
        Response error of a bed, by its values; infinite where it is not stable, which no ascent goes to.
    position : ndarray (p,)
        The drawn bed with the largest error.
    """
    if not box.uncertain:
        return None

    def to_lower(at: np.ndarray) -> float:
        value = error(box.at(at))
        return -value if np.isfinite(value) else 0.0

    lowered, end, slopes = _descended(to_lower, position, ERROR_ROUNDS)
    return LargestError(-lowered, box.at(end), _named(box, slopes))


def _named(box: Box, slopes: np.ndarray) -> tuple[str, ...]:
    return tuple(box.uncertain[i].name for i in np.argsort(-np.abs(slopes))[:NAMED])


def _descended(
    of: Callable[[np.ndarray], float], position: np.ndarray, rounds: int
) -> tuple[float, np.ndarray, np.ndarray]:  # value, position (p,), slopes (p,)
    """The least value met on the way from a position, towards the corners that the gradients point to."""
    value, slopes = of(position), np.zeros(len(position))
    for _ in range(rounds):
        inward = np.where(position > 0, -DIFFERENCE, DIFFERENCE)
        slopes = np.array([of(position + step) - value for step in np.diag(inward)]) / inward
        tried = [position + share * (-np.sign(slopes) - position) for share in SHARES]
        values = [of(place) for place in tried]
        best = int(np.argmin(values))
        if values[best] > value - WORTH_A_ROUND * abs(value):
            break
        value, position = values[best], tried[best]
    return value, position, slopes
