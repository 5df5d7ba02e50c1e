"""The final fit of a hypothesis: finer integration steps, sharper friction, exact derivatives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from matching.diagnosis.candidates.refit import fit_extended
from matching.diagnosis.fitting.fit import Fit, FitOptions
from matching.diagnosis.fitting.friction_regularisation import FINAL_STEPS, with_sharper_friction
from matching.diagnosis.fitting.polish import polished
from matching.diagnosis.fitting.problem import STEPS_PER_RADIAN
from matching.diagnosis.search.hypothesis import Hypothesis
from matching.diagnosis.search.refinement import with_sharpest_friction
from modelling.common.time_limit import time_is_over

ITERATIONS = 12
WORSE_SHARE, WORSE = 0.01, 10.0  # of χ², and χ²: what finer steps may add; more, and they ended elsewhere


def final_fit(hypothesis: Hypothesis) -> Hypothesis:
    """A hypothesis fitted with steps half as long, ending on a Jacobian of its own point, if that is no worse."""
    if time_is_over():
        return hypothesis
    if not hypothesis.causes:
        return replace(hypothesis, fit=polished(hypothesis.fit))
    model = replace(hypothesis.at_fit(), starts=tuple(hypothesis.fit.starts))
    try:
        fit = fit_extended(model, hypothesis.fit, FitOptions(ITERATIONS), 2 * STEPS_PER_RADIAN)
        fit = polished(with_sharper_friction(fit, FINAL_STEPS))
    except (FloatingPointError, np.linalg.LinAlgError):
        return hypothesis
    finer = with_sharpest_friction(replace(hypothesis, fit=fit))
    return finer if finer.fit.cost < (1 + WORSE_SHARE) * hypothesis.fit.cost + WORSE else hypothesis


def final_fit_on(hypothesis: Hypothesis, base: Fit) -> Hypothesis:
    """A hypothesis of a part of the data fitted to all that a base fit has."""
    model = hypothesis.at_fit()
    fit = fit_extended(model, base, FitOptions()) if hypothesis.causes else base
    return final_fit(Hypothesis(model, fit))
