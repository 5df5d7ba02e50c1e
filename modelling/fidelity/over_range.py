"""Error over range: root mean square of a difference over the range of the signal that is wanted. One rule for all.

A signal rests where its range is within :class:`RestSettings`. What rests in both has no error and is left out. What is
to rest and moves is off by its motion over the largest range of a signal of its kind, and by infinity where there is
none. A signal that is not finite is off by infinity, so it passes nowhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np


@dataclass(frozen=True)
class RestSettings:
    """When a signal rests.

    Attributes
    ----------
    smallest : float
        Of a range, SI (N·m, rad/s, rad/s², rad): less is rounding of a simulation. Chosen by trial: rounding leaves
        1e-12, the smallest motion of the shipped cases is 1e-3.
    uncertainties : float
        A range of so many standard uncertainties of the sensor says nothing: noise alone has it.
    """

    smallest: float = 1e-9
    uncertainties: float = 4.0


REST = RestSettings()


@dataclass(frozen=True)
class OverRange:
    """Errors of y signals, of one motion or of b side by side.

    Attributes
    ----------
    error : ndarray (y, …)
        Root mean square over range; NaN where the signal rests in both, infinite where it is not finite.
    resting : ndarray of bool (y, …)
        Which signals rest, in what is wanted.
    """

    error: np.ndarray
    resting: np.ndarray

    @property
    def largest(self) -> np.ndarray:
        """Of all signals (…); 0 where all rest."""
        return np.max(np.where(np.isnan(self.error), 0.0, self.error), axis=0, initial=0.0)

    def by_name(self, names: Sequence[str]) -> dict[str, float]:
        """Of one motion, without the signals that rest."""
        return {name: float(value) for name, value in zip(names, self.error, strict=True) if not np.isnan(value)}


def at_rest(
    signals: np.ndarray, uncertainty: Sequence[float | None] | None = None, settings: RestSettings = REST
) -> np.ndarray:  # fmt: skip
    """Which signals (t, y, …) rest, bool (y, …); ``uncertainty`` (y,) as in :func:`error_over_range`."""
    span = np.ptp(signals, axis=0)
    return ~(span > _floor(uncertainty, span, settings))


def _floor(uncertainty: Sequence[float | None] | None, span: np.ndarray, settings: RestSettings) -> np.ndarray:
    """The range (y, 1, …) within which each signal rests."""
    u = np.array([each or 0.0 for each in (uncertainty or [0.0] * len(span))])
    floor: np.ndarray = np.maximum(settings.smallest, settings.uncertainties * u)
    return floor.reshape(-1, *[1] * (span.ndim - 1))


def error_over_range(
    wanted: np.ndarray, found: np.ndarray, *, kinds: Sequence[str] | None = None,
    uncertainty: Sequence[float | None] | None = None, part: np.ndarray | slice | None = None,
    settings: RestSettings = REST,
) -> OverRange:  # fmt: skip
    """Errors of ``found`` (t, y, …) against ``wanted`` (t, y, …), SI.

    Parameters
    ----------
    kinds : sequence of str (y), optional
        What each signal measures: a signal that is to rest is compared with the ranges of those of its kind; without it
        each is of a kind of its own.
    uncertainty : sequence of float or None (y), optional
        Standard uncertainty of each sensor where ``found`` carries its noise, SI.
    part : index of samples, optional
        Over which the error is taken; the range is that of the whole.
    """
    count = wanted.shape[1]
    within = slice(None) if part is None else part
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        off = np.sqrt(np.mean(np.square(found[within] - wanted[within]), axis=0))
        span, moved = np.ptp(wanted, axis=0), np.ptp(found, axis=0)
    rest = _floor(uncertainty, span, settings)
    resting = ~(span > rest)
    named = np.array(kinds if kinds is not None else [str(number) for number in range(count)])
    scale = np.where(resting, 0.0, span)
    largest = np.stack([scale[named == kind].max(axis=0) for kind in named]) if count else scale
    over = np.where(resting, largest, span)
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        error = np.where(over > 0, off / over, np.inf)
    error = np.where(resting & (moved <= rest) & (off <= rest), np.nan, error)
    finite = np.isfinite(off) & np.isfinite(span) & np.isfinite(moved)
    return OverRange(np.where(finite, error, np.inf), resting & finite)


@dataclass(frozen=True)
class PartSettings:
    """Into which parts a drive is cut: minutes around it are not to average away an error that lasts a second.

    Attributes
    ----------
    window : float
        s, of the windows that follow each other.
    after : float
        s, by which a manoeuvre outlasts the last change of its torques: several periods of a driveline's shuffle.
    longest : float
        s: torques that change for longer are no manoeuvre; the windows judge them.
    """

    window: float = 10.0
    after: float = 2.0
    longest: float = 10.0


PARTS = PartSettings()


def parts_of(torques: Sequence[np.ndarray], step: float, settings: PartSettings = PARTS) -> list[slice]:
    """Parts of a drive whose torques (t,) are given at samples of ``step`` s: windows, and manoeuvres."""
    count = max(len(torque) for torque in torques)
    size = max(round(settings.window / step), 1)
    pieces = max(count // size, 1)
    edges = [*(number * size for number in range(pieces)), count]
    windows = [slice(first, last) for first, last in pairwise(edges)]
    changes = np.zeros(count, bool)
    for torque in torques:
        changes[1 : len(torque)] |= np.diff(torque) != 0
    at = np.flatnonzero(changes)
    after, manoeuvres = round(settings.after / step), []
    if len(at):
        cuts = np.flatnonzero(np.diff(at) > after)
        for first, last in zip(np.r_[at[0], at[cuts + 1]], np.r_[at[cuts], at[-1]], strict=True):
            part = slice(int(max(first - 1, 0)), int(min(last + after, count)))
            if (part.stop - part.start) * step <= settings.longest + settings.after:
                manoeuvres.append(part)
    return [*windows, *manoeuvres]


def worst_part(
    wanted: np.ndarray, found: np.ndarray, parts: Sequence[slice], *, kinds: Sequence[str] | None = None,
    uncertainty: Sequence[float | None] | None = None, settings: RestSettings = REST,
) -> OverRange:  # fmt: skip
    """Errors of each signal in the part of a drive where they are largest; the range is that of the whole drive."""
    each = [
        error_over_range(wanted, found, kinds=kinds, uncertainty=uncertainty, part=part, settings=settings)
        for part in parts
    ]
    errors = np.stack([one.error for one in each])
    worst = np.where(np.isnan(errors), -np.inf, errors).max(axis=0)
    return OverRange(np.where(np.isneginf(worst), np.nan, worst), each[0].resting)
