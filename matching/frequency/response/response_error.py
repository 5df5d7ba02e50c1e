"""How far the compared responses of rig and vehicle are apart: the response error and its figures.

The error is the root mean square of |log(H_rig/H_vehicle)|, complex logarithm, phase by its principal value, over the
band (logarithm of frequency) and the compared functions. H_vehicle is the continuous vehicle; torques enter the
continuous rig, whose controller samples and holds (:mod:`matching.frequency.response.sampled_data`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from matching.frequency.case.case import Case
from matching.frequency.loop.parts import Parts
from matching.frequency.response.band import BandNodes, antiresonances, converged_nodes, resonances
from matching.frequency.response.responses import ComparedBed
from modelling.bed.feed_forward import FeedForward


@dataclass(frozen=True)
class FunctionError:
    """Root mean squares over the band for one compared function; None where the rig without control has no path."""

    input: str
    sensor: str
    before: float | None
    after: float
    unmeasured: float

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return {
            "input": self.input, "sensor": self.sensor, "before": self.before, "after": self.after,
            "unmeasured": self.unmeasured,
        }  # fmt: skip


@dataclass(frozen=True)
class ErrorFigures:
    """Response errors of a tuned bed, over the band and the compared functions together and by function.

    Attributes
    ----------
    before : float or None
        The rig without control over the functions that have a path there; None where none has.
    after, unmeasured : float
        The matched rig, and the same by feedback alone, over all compared functions.
    after_same_functions : float or None
        The matched rig over the functions of ``before``.
    nodes : BandNodes
        Frequencies at which these means have converged to 1 %.
    """

    band: tuple[float, float]
    before: float | None
    after: float
    after_same_functions: float | None
    unmeasured: float
    functions: tuple[FunctionError, ...]
    nodes: BandNodes


@dataclass(frozen=True)
class _Squares:
    """|log(H/H_vehicle)|² (f, h) of rig without control, matched rig and feedback alone; NaN where there is no path."""

    before: np.ndarray
    after: np.ndarray
    unmeasured: np.ndarray

    @classmethod
    def of(cls, bed: ComparedBed, frequencies: np.ndarray) -> _Squares:
        compared = bed.at(frequencies)
        return cls(
            *(
                log_squares(controlled, compared.vehicle)
                for controlled in (compared.rig, compared.matched, compared.unmeasured)
            )
        )


def log_squares(rig: np.ndarray, vehicle: np.ndarray) -> np.ndarray:
    """|log(H_rig/H_vehicle)|², complex logarithm, principal value; arrays of one shape, such as (f, h)."""
    with np.errstate(invalid="ignore"):  # NaN where a torque has no path
        return np.abs(np.log(rig / vehicle)) ** 2


def error_figures(case: Case, parts: Parts | None = None, feed_forward: FeedForward | None = None) -> ErrorFigures:
    """Response errors over the band of a tuned case.

    Parameters
    ----------
    case, parts, feed_forward
        As for :class:`matching.frequency.response.responses.ComparedBed`.

    Raises
    ------
    InputError
        If a model cannot be made linear or the feed-forward has no solution.
    """
    return figures_of(ComparedBed(case, parts, feed_forward))


def figures_of(bed: ComparedBed) -> ErrorFigures:
    """Response errors over the band of a bed's case."""
    nodes = nodes_of(bed)
    squares = _Squares.of(bed, nodes.frequencies)
    before, after, unmeasured = (
        nodes.root_mean(values) for values in (squares.before, squares.after, squares.unmeasured)
    )
    path = ~np.isnan(before)
    functions = tuple(
        FunctionError(
            source, sensor, float(before[h]) if path[h] else None, float(after[h]), float(unmeasured[h])
        )
        for h, (source, sensor) in enumerate(bed.pairs)
    )  # fmt: skip
    return ErrorFigures(
        band=bed.case.band,
        before=pooled(before[path]) if path.any() else None,
        after=pooled(after),
        after_same_functions=pooled(after[path]) if path.any() else None,
        unmeasured=pooled(unmeasured),
        functions=functions,
        nodes=nodes,
    )


def pooled(errors: Sequence[float] | np.ndarray) -> float:
    """Root mean square of the errors (h,) of several functions."""
    return float(np.sqrt(np.mean(np.square(errors))))


def nodes_of(bed: ComparedBed) -> BandNodes:
    """Nodes over the band of a bed's case at which the errors of every compared function have converged."""

    def squares(frequencies: np.ndarray) -> np.ndarray:
        at_nodes = _Squares.of(bed, frequencies)
        together = np.hstack([at_nodes.before, at_nodes.after, at_nodes.unmeasured])
        return together[:, ~np.isnan(together[0])]

    return converged_nodes(bed.case.band, squares, _breaks(bed))


def _breaks(bed: ComparedBed) -> np.ndarray:
    """Resonances of vehicle and rig and antiresonances of the vehicle's compared functions, Hz."""
    vehicle = bed.vehicle.space
    zeros = [antiresonances(vehicle, source, sensor) for source, sensor in dict.fromkeys(bed.pairs)]
    return np.concatenate([resonances(vehicle), resonances(bed.parts.rig.space), *zeros])
