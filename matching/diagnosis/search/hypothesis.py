"""A hypothesis: causes with the fit of the model they extend, and how far its residual is from noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from matching.diagnosis.candidates.cause import Cause, ExtendedModel
from matching.diagnosis.fitting.fit import Fit
from matching.diagnosis.fitting.residual_statistics import (
    BLOCK_LENGTHS,
    WhitenessTest,
    effective_share,
    shares_of_ranges,
    whiteness,
)
from matching.diagnosis.fitting.reweighting import iteratively_reweighted, power_left_by
from modelling.effects import EFFECTS

NOISE_SIGMA = 5.0  # standard deviations of a mean square beyond which it is more than noise
NOISE_EXCESS = 0.006  # power beyond that of the noise, in times it, that matters
INDEPENDENT = 0.8  # share of independent samples in what is white
NOISE_EXCESS_ABRUPT = 0.02  # the same where torques jump: χ² is too rough to reach its very minimum
MOST_LOST = 1.5  # times the pooled error of fitted data that a fit in its own balanced weights may have


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """Causes and the fit with them.

    Attributes
    ----------
    model : ExtendedModel
        What the fit began from.
    fit : Fit
    screened : float
        Decrease of χ² that the screening promised for the last cause.
    """

    model: ExtendedModel
    fit: Fit
    screened: float = 0.0

    @property
    def causes(self) -> tuple[Cause, ...]:
        """The causes, in the order they were found."""
        return self.model.causes

    @property
    def places(self) -> set[tuple[str, str]]:
        """Kind and place of each cause."""
        return {(cause.kind, cause.at) for cause in self.causes}

    @cached_property
    def mean_squares(self) -> np.ndarray:
        """(y,) mean square of each sensor's error in times its noise; NaN without readings."""
        square = np.sum([np.sum(part**2, axis=0) for part in self.fit.errors], axis=0)
        count = self.fit.problem.data.readings_by_sensor
        return np.where(count, square / np.maximum(count, 1), np.nan)

    @cached_property
    def chi_square(self) -> float:
        """How much the fit leaves, in times the noise: χ².

        Where sensors are weighted by what the model leaves of them: the number of readings times the geometric mean of
        what it leaves of each, fast and slow (:func:`power_left`). It does not depend on the weights that the fit had.
        """
        data = self.fit.problem.data
        if self.fit.problem.weighting is None:
            return self.fit.cost
        logarithms = np.log(power_left_by(self.fit))
        return data.readings_count * float(np.exp(logarithms @ data.readings_by_sensor / data.readings_count))

    @property
    def misfit(self) -> float:
        """Root mean square of all errors in times the noise."""
        count = self.fit.problem.data.readings_by_sensor
        return float(np.sqrt(np.nansum(self.mean_squares * count) / count.sum()))

    @property
    def cost(self) -> float:
        """χ² and ln of the number of readings for each variable (Schwarz, Annals of Statistics 6, 1978)."""
        return self.chi_square + len(self.fit.v) * float(np.log(self.fit.problem.data.readings_count))

    def at_fit(self) -> ExtendedModel:
        """The model at fitted values and bounds, to begin another fit."""
        values = self.model.values | self.fit.values
        return replace(self.model, bounds=self.fit.problem.bounds, values=values, starts=())

    def whiteness(self) -> list[WhitenessTest]:
        """The error of each sensor against white noise of its stated uncertainty."""
        return self._whiteness

    @cached_property
    def _whiteness(self) -> list[WhitenessTest]:
        parts = [
            np.where(segment.measured, errors, np.nan)
            for errors, segment in zip(self.fit.errors, self.fit.problem.data.segments, strict=True)
        ]
        return [whiteness([part[:, j] for part in parts]) for j in range(len(self.fit.problem.data.noise))]


def with_balanced_sensors(hypothesis: Hypothesis) -> Hypothesis:
    """A hypothesis with its sensors weighted by what it leaves of them; itself where noise alone weights them.

    Where what is left is slow, its memory takes the place of parameters that hold the slow part: the next fit lets it
    grow, and so on. A fit that loses its way so is not taken.
    """
    if hypothesis.fit.problem.weighting is None:
        return hypothesis
    balanced = iteratively_reweighted(hypothesis.fit)
    lost = pooled_error(balanced) > MOST_LOST * pooled_error(hypothesis.fit)
    return hypothesis if lost else replace(hypothesis, fit=balanced)


def pooled_error(fit: Fit) -> float:
    """Root mean square over the sensors of the error of fitted data over the sensor's range."""
    segments = fit.problem.data.segments
    left = [np.where(segment.measured, part, np.nan) for part, segment in zip(fit.errors, segments, strict=True)]
    readings = [segment.readings for segment in segments]
    shares = shares_of_ranges(np.concatenate(left), np.concatenate(readings), fit.problem.data.noise)
    return float(np.sqrt(np.nanmean(shares**2)))


def at_noise(hypothesis: Hypothesis) -> bool:
    """Whether every sensor's residual is white noise of the stated uncertainty, as far as it matters."""
    tests = hypothesis.whiteness()
    return not any(scales.any() for scales in _beyond_noise(hypothesis.fit, tests))


def scatters_only(hypothesis: Hypothesis) -> bool:
    """Whether every sensor's residual is white noise, of whatever size: nothing in it that a cause could explain.

    An encoder reads to its resolution; where its uncertainty is stated smaller, what the right model leaves is more
    than noise of that size, and without any pattern.
    """
    if at_noise(hypothesis):
        return True
    parts = [
        np.where(segment.measured, errors, np.nan)
        for errors, segment in zip(hypothesis.fit.errors, hypothesis.fit.problem.data.segments, strict=True)
    ]
    sizes = np.maximum(np.sqrt(np.nan_to_num(hypothesis.mean_squares)), 1.0)
    tests = [whiteness([part[:, j] / size for part in parts]) for j, size in enumerate(sizes)]
    if any(scales.any() for scales in _beyond_noise(hypothesis.fit, tests)):
        return False
    columns = (part[:, j] for part in parts for j in range(part.shape[1]))
    return all(effective_share(column) > INDEPENDENT for column in columns if np.isfinite(column).any())


def sensors_beyond_noise(hypothesis: Hypothesis) -> list[tuple[int, int]]:
    """Sensors (index) whose residual is more than noise, with the number of samples over which that shows best."""
    tests = hypothesis.whiteness()
    out = []
    for j, (test, scales) in enumerate(zip(tests, _beyond_noise(hypothesis.fit, tests), strict=True)):
        if scales.any():
            out.append((j, BLOCK_LENGTHS[int(np.argmax(np.where(scales, test.score, 0)))]))
    return out


def _beyond_noise(fit: Fit, tests: Sequence[WhitenessTest]) -> list[np.ndarray]:
    """For each sensor, at which block lengths (l,) its residual is more than white noise of the stated uncertainty."""
    abrupt = any(EFFECTS[effect.kind].abrupt for effect in fit.problem.system.effects)
    excess = NOISE_EXCESS_ABRUPT if abrupt else NOISE_EXCESS
    return [(test.score > NOISE_SIGMA) & (test.excess > excess) for test in tests]


def share_explained(parent: Hypothesis, child: Hypothesis) -> float:
    """Share of the misfit beyond noise that a further cause explains; 1 where there is hardly any misfit."""
    excess = parent.chi_square - parent.fit.problem.data.readings_count
    decrease = parent.chi_square - child.chi_square
    return min(decrease / excess, 1.0) if excess > max(decrease, 0.0) else float(decrease > 0)
