"""Response errors of the controlled bed, and whether the match predicted them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from matching.bed_test.local_rational import MeasuredResponse
from matching.bed_test.result import COVERAGE_FACTOR, ErrorJudgement

UNKNOWN_VARIANCE = 0.1  # of a response over its square: beyond it nothing is said at that frequency
LARGEST_UNKNOWN = 0.2  # share of the band that may be left out of an error
NEGLIGIBLE = 0.1  # of what the case allows: a smaller error is none that the prediction could be blamed for
CORRECTED = 0.5  # of what the spectral lines change: half-width of what is left after its correction


@dataclass(frozen=True)
class Figures:
    """Mean squares over the logarithm of frequency: error, its variance, prediction; share of the band left out.

    ``resolution`` is by how much the recordings' spectral lines alone change the mean square of the prediction,
    ``vehicles`` (b,) by how much it changes against vehicles drawn from what is not known of them.
    """

    square: float
    variance: float
    predicted: float
    unknown: float
    resolution: float = 0.0
    vehicles: np.ndarray = field(default_factory=lambda: np.zeros(0), repr=False)

    @property
    def known(self) -> bool:
        """Whether enough of the band is determined."""
        return self.unknown <= LARGEST_UNKNOWN

    @classmethod
    def of(
        cls,
        values: np.ndarray,
        variances: np.ndarray,
        vehicle: np.ndarray,
        matched: np.ndarray,
        measured: MeasuredResponse,
        drawn: np.ndarray | None = None,
    ) -> Figures:
        """Of one function (f,), and of drawn vehicles (b, f)."""
        with np.errstate(invalid="ignore", divide="ignore"):
            relative = variances / np.abs(values) ** 2
            error = np.abs(np.log(values / vehicle)) ** 2
        expected = np.abs(np.log(matched / vehicle)) ** 2
        good = np.isfinite(error) & (relative < UNKNOWN_VARIANCE)
        weights = np.gradient(np.log(measured.frequencies))
        weights /= weights.sum()
        unknown = float(weights[~good].sum())
        if unknown > LARGEST_UNKNOWN:
            return cls(math.nan, math.nan, float(weights @ expected), unknown)
        share = np.where(good, weights, 0.0) / weights[good].sum()
        error, relative = np.where(good, error, 0.0), np.where(good, relative, 0.0)
        # |e + n|² has the mean |e|² + v and the variance 2|e|²v + v²; neighbours share spectral lines
        clean = np.maximum(error - relative, 0.0)
        overlap = np.maximum(measured.windows / np.gradient(measured.frequencies), 1.0)
        variance = float(np.sum(share**2 * (2 * clean * relative + relative**2) * overlap))
        square, others = float(share @ error), np.zeros(0)
        if drawn is not None and len(drawn):
            others = np.abs(np.log(np.where(good, values, vehicle) / drawn)) ** 2 @ share - square
        return cls(square - float(share @ relative), variance, float(share @ expected), unknown, vehicles=others)


def judged(name: str, figures: Sequence[Figures], expected: float, allowed: float) -> ErrorJudgement:
    """One judgement of several functions together, of which those count that the recordings show.

    ``as_predicted`` where the error is no larger than predicted within its uncertainty, and surely no larger than
    allowed; ``short`` where it is larger than predicted beyond its uncertainty. Predicted counts as: the match itself,
    or what 95 % of the beds drawn from ``[uncertainty]`` keep below as far as the case allows it.

    Parameters
    ----------
    expected : float
        Error that 95 % of drawn beds keep below.
    allowed : float
        By the case.
    """
    shown = [figure for figure in figures if figure.known]
    resolved = len(shown) / len(figures)
    predicted = math.sqrt(float(np.mean([figure.predicted for figure in shown or figures])))
    if not shown:
        return ErrorJudgement(name, math.nan, math.nan, predicted, expected, allowed, resolved, "undetermined")
    # the prediction, sent through the same lines, shows what they change: it is taken off, and half of it stays unsure
    lines = float(np.mean([figure.resolution for figure in shown]))
    square = max(float(np.mean([figure.square for figure in shown])) - lines, 0.0)
    rest = CORRECTED * abs(lines) / math.sqrt(3)
    spread = math.hypot(math.sqrt(sum(figure.variance for figure in shown)) / len(shown), rest)
    if shown[0].vehicles.size:  # the same drawn vehicles for all functions
        changes = np.mean([figure.vehicles for figure in shown], axis=0)
        spread = math.hypot(spread, float(np.sqrt(np.mean(changes**2))))
    value = math.sqrt(square)
    uncertainty = math.sqrt(square + spread) - value
    limit = max(predicted, NEGLIGIBLE * allowed, min(expected, allowed))
    expanded = COVERAGE_FACTOR * uncertainty
    if value - expanded > limit:
        status = "short"
    else:
        status = "as_predicted" if value + expanded <= max(limit, allowed) else "undetermined"
    return ErrorJudgement(name, value, uncertainty, predicted, expected, allowed, resolved, status)
