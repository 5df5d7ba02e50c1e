"""Whether a cause earns its place on data that no fit has used.

What a further parameter takes of the fitted data it may take from the error of the model, which does not repeat. A
cause is kept only if the error of all sensors together falls on unseen data and that of none rises beyond its
uncertainty and beyond a slight part of that fall.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from matching.diagnosis.fitting.holdout import Holdout, holdout_residuals
from matching.diagnosis.fitting.residual_statistics import mean_square, shares_of_ranges
from matching.diagnosis.fitting.reweighting import power_left
from matching.diagnosis.search.hypothesis import Hypothesis

BLOCKS = 16  # of the unseen data, whose errors are compared in pairs
CERTAIN = 2.0  # standard errors of the mean difference from which a sensor is worse
WORSE_RATIO = 1.04  # mean square, from which it matters
SLIGHT_RISE = 0.005  # of what all sensors together gain, in squares of shares of their ranges
AT_NOISE = 1.1  # mean square in times the noise; a sensor at its noise is not worse

UNSEEN_ERRORS = (FloatingPointError, np.linalg.LinAlgError)  # of a model that does not simulate unseen data


@dataclass(frozen=True)
class UnseenError:
    """Errors of one hypothesis on unseen data.

    Attributes
    ----------
    blocks : ndarray (b, y)
        Mean squares over blocks of the data, in times the noise; NaN without readings.
    shares : ndarray (y,)
        Root mean square error of each sensor over its range; NaN where it has no readings or never changes.
    power_left : float
        Geometric mean over the sensors of what is left of each, fast and slow, in times the noise.
    """

    blocks: np.ndarray
    shares: np.ndarray
    power_left: float

    @property
    def pooled(self) -> float:
        """Root mean square over the sensors of the error over the sensor's range; NaN without any."""
        known = self.shares[np.isfinite(self.shares)]
        return float(np.sqrt(np.mean(known**2))) if len(known) else np.nan

    @property
    def mean_squares(self) -> np.ndarray:
        """(y,) mean square of each sensor."""
        known = np.isfinite(self.blocks)
        return np.where(known, self.blocks, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)


class UnseenData:
    """Held-out data and the errors of hypotheses on them, each simulated once."""

    def __init__(self, holdout: Holdout):
        self.holdout = holdout
        self._known: dict[int, tuple[Hypothesis, UnseenError | None]] = {}

    def error(self, hypothesis: Hypothesis) -> UnseenError | None:
        """The errors of a hypothesis; None where it does not simulate the data."""
        key = id(hypothesis)
        if key not in self._known:
            self._known[key] = hypothesis, self._simulated(hypothesis)
        return self._known[key][1]

    def may_gain(self, child: Hypothesis, parent: Hypothesis) -> bool:
        """Whether a hypothesis that may lack further causes meets unseen data better than another.

        Where sensors are weighted by the model's residual, the slow part of the error, which a further cause may
        explain, counts no more than the part that the error's past does not predict.
        """
        after, before = self.error(child), self.error(parent)
        if after is None or before is None or child.fit.problem.weighting is None:
            return self.gains(child, parent)
        return bool(after.power_left < before.power_left)

    def gains(self, child: Hypothesis, parent: Hypothesis) -> bool:
        """Whether the pooled error of a hypothesis is smaller than that of another."""
        after, before = self.error(child), self.error(parent)
        if after is None or before is None:
            return before is None
        return bool(after.pooled < before.pooled)

    def earns_place(self, child: Hypothesis, parent: Hypothesis) -> bool:
        """Whether the pooled error falls and that of no sensor rises beyond its uncertainty."""
        return self.gains(child, parent) and not self.worse_sensors(child, parent)

    def worse_sensors(self, child: Hypothesis, parent: Hypothesis) -> list[int]:
        """Sensors (index) whose error is larger than that of another hypothesis beyond its uncertainty.

        Block by block, the difference of the mean squares: its mean against its standard error. A rise that is slight
        against what all sensors together gain does not count: beside a cause that is still missing, the right one may
        move a little of its error to another sensor.
        """
        after, before = self.error(child), self.error(parent)
        if after is None or before is None or after.blocks.shape != before.blocks.shape:
            return []
        worse = []
        gained = float(before.pooled**2 - after.pooled**2) * np.isfinite(after.shares).sum()
        rises = after.shares**2 - before.shares**2
        for j in range(after.blocks.shape[1]):
            rise = after.blocks[:, j] - before.blocks[:, j]
            rise = rise[np.isfinite(rise)]
            square, square_before = after.mean_squares[j], before.mean_squares[j]
            if len(rise) < 2 or square < AT_NOISE or square < WORSE_RATIO * square_before:
                continue
            if rises[j] < SLIGHT_RISE * gained:
                continue
            if rise.mean() > CERTAIN * rise.std(ddof=1) / np.sqrt(len(rise)):
                worse.append(j)
        return worse

    def _simulated(self, hypothesis: Hypothesis) -> UnseenError | None:
        try:
            residuals = holdout_residuals(self.holdout.simulate(hypothesis.fit))
        except UNSEEN_ERRORS:
            return None
        if not residuals or not all(np.isfinite(part[~np.isnan(part)]).all() for part in residuals):
            return None
        data = hypothesis.fit.problem.data
        readings = np.concatenate([segment.readings for segment in self.holdout.data.segments])
        total = np.concatenate(residuals)
        blocks = np.array([mean_square(part) for part in np.array_split(total, min(BLOCKS, len(total)))])
        shares = shares_of_ranges(total, readings, data.noise)
        pooled = np.isfinite(shares)
        if not pooled.any():
            return UnseenError(blocks, shares, np.nan)
        left = power_left([np.nan_to_num(part) for part in residuals], [np.isfinite(part) for part in residuals])
        return UnseenError(blocks, shares, float(np.exp(np.mean(np.log(left[pooled])))))
