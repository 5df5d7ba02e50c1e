"""The worst beds of a box: descent by the gradients of dampings, ascent of the error, from planned and drawn beds.

The least damped mode may be one of the residual vehicle that no bed moves, and another one fall below it in a corner
of the box. So the descent follows those modes that their gradients promise to be damped least in a corner.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from matching.frequency.case.uncertainty import Box

STARTS = 1  # drawn beds with the least damping, beside the bed as planned
ROUNDS = 4  # of the descent at most, each with a gradient of its own
ERROR_ROUNDS = 2  # of the error's, which takes longer to work out
DIFFERENCE = 0.02  # of a half-width
SHARES = (1.0, 0.5, 0.25)  # of the way to the corner that the gradient points to
DEPENDS = 1e-6  # relative change over a half-width below which a figure does not depend on anything: rounding
FOLLOWED = 4  # figures whose corners are tried in a round
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
    dampings: Callable[[Mapping[str, float]], np.ndarray], box: Box, positions: np.ndarray
) -> WorstBed | None:  # fmt: skip
    """Look for the bed with the least damping; None where nothing is uncertain.

    Parameters
    ----------
    dampings : callable
        Damping ratios (m,) of the least damped modes of a bed, least first, by its values.
    positions : ndarray (b, p)
        Drawn beds in the box, least damped first.
    """
    if not box.uncertain or not len(positions):
        return None
    starts = [np.zeros(len(box.uncertain)), *positions[:STARTS]]
    descents = [_descended(lambda at: dampings(box.at(at)), position, ROUNDS) for position in starts]
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

    def to_lower(at: np.ndarray) -> np.ndarray:
        value = error(box.at(at))
        return np.array([-value if np.isfinite(value) else 0.0])

    lowered, end, slopes = _descended(to_lower, position, ERROR_ROUNDS)
    return LargestError(-lowered, box.at(end), _named(box, slopes))


def _named(box: Box, slopes: np.ndarray) -> tuple[str, ...]:
    return tuple(box.uncertain[i].name for i in np.argsort(-np.abs(slopes))[:NAMED])


def _descended(
    of: Callable[[np.ndarray], np.ndarray], position: np.ndarray, rounds: int
) -> tuple[float, np.ndarray, np.ndarray]:  # value, position (p,), slopes (p,)
    """The least value met on the way from a position, towards the corners that the gradients of figures point to.

    ``of`` gives figures (m,), least first; one that depends on nothing has no gradient but rounding.
    """
    figures, named = of(position), np.zeros(len(position))
    for _ in range(rounds):
        inward = np.where(position > 0, -DIFFERENCE, DIFFERENCE)
        slopes = np.array([of(position + step) - figures for step in np.diag(inward)]) / inward[:, None]
        depends = np.flatnonzero(np.abs(slopes).max(axis=0) > DEPENDS * np.abs(figures))
        if not len(depends):
            break
        in_corner = (figures - np.abs(slopes).sum(axis=0))[depends]
        pointing = slopes.T[depends[np.argsort(in_corner, kind="stable")[:FOLLOWED]]]
        tried = [(slope, position + share * (-np.sign(slope) - position)) for slope in pointing for share in SHARES]
        ends = [of(place) for _, place in tried]
        best = int(np.argmin([end[0] for end in ends]))
        named = tried[best][0]
        if ends[best][0] > figures[0] - WORTH_A_ROUND * abs(figures[0]):
            break
        figures, position = ends[best], tried[best][1]
    return float(figures[0]), position, named
