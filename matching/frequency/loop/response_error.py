"""How far the compared responses of rig and vehicle are apart: the response error and its figures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from matching.frequency.case.case import Case
from matching.frequency.loop.linear_body import body
from matching.frequency.loop.parts import Parts, parts_of
from matching.frequency.loop.responses import Responses, responses
from modelling.bed.feed_forward import FeedForward

POINTS = 80  # log-spaced frequencies of the response error


@dataclass(frozen=True)
class FunctionError:
    """Root mean squares over the band for one compared function; None where the free rig has no path."""

    input: str
    sensor: str
    before: float | None
    after: float
    unmeasured: float

    def to_dict(self) -> dict[str, Any]:
        """As ``result.json`` holds it."""
        return {
            "input": self.input, "sensor": self.sensor, "before": self.before, "after": self.after,
            "unannounced": self.unmeasured,
        }  # fmt: skip


@dataclass(frozen=True)
class PooledError:
    """Root mean squares over band and functions of |log(H_rig/H_vehicle)|; None without a function.

    ``before`` is the free rig over the functions that have a path there; ``after`` the matched rig over all compared
    functions, ``after_like_before`` over those of ``before``; ``unmeasured`` the feedback alone.
    """

    before: float | None
    after: float
    after_like_before: float | None
    unmeasured: float


@dataclass(frozen=True)
class ErrorFigures(PooledError):
    """The pooled error, phases by their principal value, and the same by function.

    ``unwrapped`` is the pooled error with the phase followed along the frequency, as a check.
    """

    band: tuple[float, float]
    functions: tuple[FunctionError, ...]
    unwrapped: PooledError


def response_error(rig: np.ndarray, vehicle: np.ndarray) -> float:
    """Root mean square of |log(H_rig/H_vehicle)|, complex logarithm, principal value; arrays of one shape."""
    return float(np.sqrt(np.mean(_squares(rig, vehicle))))


def error_figures(case: Case, parts: Parts | None = None, feed_forward: FeedForward | None = None) -> ErrorFigures:
    """Response errors over the band of a case, at 80 log-spaced frequencies.

    Parameters
    ----------
    case, parts, feed_forward
        As for :func:`matching.frequency.loop.responses.responses`.

    Raises
    ------
    InputError
        If a model cannot be made linear or the feed-forward has no solution.
    """
    parts = parts_of(case) if parts is None else parts
    points = np.geomspace(*case.band, POINTS)
    fine, where = _fine(points, case, parts)
    curves = responses(case, fine, parts, feed_forward)
    functions = tuple(
        FunctionError(
            source, sensor,
            _root(_squares(curves.rig, curves.vehicle)[where, h]),
            _certain(_squares(curves.matched, curves.reference)[where, h]),
            _certain(_squares(curves.unmeasured, curves.vehicle)[where, h]),
        )
        for h, (source, sensor) in enumerate(curves.pairs)
    )  # fmt: skip
    pooled = _pooled(curves, where, _squares)
    unwrapped = _pooled(curves, where, _unwrapped_squares)
    return ErrorFigures(**vars(pooled), band=case.band, functions=functions, unwrapped=unwrapped)


def _pooled(
    curves: Responses, where: np.ndarray, squares: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> PooledError:
    path = ~np.isnan(curves.rig[0])
    after = squares(curves.matched, curves.reference)[where]
    return PooledError(
        before=_root(squares(curves.rig, curves.vehicle)[where][:, path]),
        after=_certain(after),
        after_like_before=_root(after[:, path]),
        unmeasured=_certain(squares(curves.unmeasured, curves.vehicle)[where]),
    )


def _fine(points: np.ndarray, case: Case, parts: Parts) -> tuple[np.ndarray, np.ndarray]:
    """The points with more about every resonance, where the phase turns fast; and where the points stand among them."""
    rates = np.concatenate([np.linalg.eigvals(parts.rig.space.A), np.linalg.eigvals(body(case.vehicle).space.A)])
    centres = np.abs(rates[rates.imag > 0]) / (2 * np.pi)
    near = np.concatenate([centre * (1 + np.linspace(-0.15, 0.15, 31)) for centre in centres])
    near = near[(near > points[0]) & (near < points[-1])]
    fine = np.unique(np.concatenate([points, near]))
    return fine, np.searchsorted(fine, points)


def _squares(rig: np.ndarray, vehicle: np.ndarray) -> np.ndarray:
    return np.abs(np.log(rig / vehicle)) ** 2


def _unwrapped_squares(rig: np.ndarray, vehicle: np.ndarray) -> np.ndarray:
    """As :func:`_squares`, the phase followed along the first axis from its principal value at the start."""
    ratio = rig / vehicle
    return np.log(np.abs(ratio)) ** 2 + np.unwrap(np.angle(ratio), axis=0) ** 2


def _root(squares: np.ndarray) -> float | None:
    """Root of the mean; None where there is nothing or no path."""
    return None if not squares.size or np.isnan(squares).any() else float(np.sqrt(squares.mean()))


def _certain(squares: np.ndarray) -> float:
    return float(np.sqrt(squares.mean()))
