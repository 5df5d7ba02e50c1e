"""A hypothesis: causes with the fit of the model they extend, and how far its residual is from noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from matching.diagnosis.candidates.cause import Cause, ExtendedModel
from matching.diagnosis.fitting.fit import Fit
from matching.diagnosis.fitting.residual_statistics import BLOCK_LENGTHS, WhitenessTest, whiteness
from modelling.effects import EFFECTS

NOISE_SIGMA = 5.0  # standard deviations of a mean square beyond which it is more than noise
NOISE_EXCESS = 0.006  # power beyond that of the noise, in times it, that matters
NOISE_EXCESS_ABRUPT = 0.02  # the same where torques jump: χ² is too rough to reach its very minimum


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

    @property
    def cost(self) -> float:
        """χ² and ln of the number of readings for each variable (Schwarz, Annals of Statistics 6, 1978)."""
        return self.fit.cost + len(self.fit.v) * float(np.log(self.fit.problem.data.readings_count))

    def at_fit(self) -> ExtendedModel:
        """The model at fitted values and bounds, to begin another fit."""
        values = self.model.values | self.fit.values
        return replace(self.model, bounds=self.fit.problem.bounds, values=values, starts=())

    def whiteness(self) -> list[WhitenessTest]:
        """The residual of each sensor against white noise."""
        parts = [
            np.where(segment.measured, residual, np.nan)
            for residual, segment in zip(self.fit.by_sensor(), self.fit.problem.data.segments, strict=True)
        ]
        return [whiteness([part[:, j] for part in parts]) for j in range(len(self.fit.problem.data.noise))]


def at_noise(hypothesis: Hypothesis) -> bool:
    """Whether every sensor's residual is white noise of the stated uncertainty, as far as it matters."""
    tests = hypothesis.whiteness()
    return not any(scales.any() for scales in _beyond_noise(hypothesis.fit, tests))


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
    excess = parent.fit.cost - parent.fit.problem.data.readings_count
    decrease = parent.fit.cost - child.fit.cost
    return min(decrease / excess, 1.0) if excess > max(decrease, 0.0) else float(decrease > 0)
