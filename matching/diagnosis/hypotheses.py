"""Hypotheses: causes with a fit, how far that is from noise, and the fits that a comparison or an answer needs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from matching.diagnosis.causes import Cause, ExtendedModel
from matching.diagnosis.descent import (
    FINAL_STEPS,
    MOST_STEPS_A_SAMPLE,
    Fit,
    FitOptions,
    iteratively_reweighted,
    polished,
    power_left_by,
    solve,
    with_sharper_friction,
)
from matching.diagnosis.screening import fit_extended
from matching.diagnosis.statistics import (
    BLOCK_LENGTHS,
    Estimate,
    WhitenessTest,
    covariance,
    effective_share,
    shares_of_ranges,
    whiteness,
)
from modelling.effects import EFFECTS
from modelling.effects.effect import SimplerEffect
from modelling.errors import FitError
from modelling.resources import time_is_over

# --- A hypothesis: causes with the fit of the model they extend, and how far its residual is from noise.

NOISE_SIGMA = 5.0  # standard deviations of a mean square beyond which it is more than noise
NOISE_EXCESS = 0.006  # power beyond that of the noise, in times it, that matters
SAME_INSTANT = 0.05  # of a sample: how well the channels of a row belong to the same instant
INDEPENDENT = 0.8  # share of independent samples in what is white
NOISE_EXCESS_ABRUPT = 0.02  # the same where torques jump: χ² is too rough to reach its very minimum
SMOOTH_FRICTION = 10.0  # times the noise, root mean square: friction that turns too smoothly leaves less (trial)
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
    def chi_square_per_reading(self) -> float:
        """Mean square of the residual, at least 1: no gain counts that is small beside what remains."""
        return max(1.0, self.chi_square / max(self.fit.problem.data.readings_count, 1))

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
        data, parts = self.fit.problem.data, of_the_same_instant(self.fit)
        known = [None] * len(data.noise) if data.rounding is None else list(data.rounding)
        return [whiteness([part[:, j] for part in parts], known[j]) for j in range(len(data.noise))]


def of_the_same_instant(fit: Fit) -> list[np.ndarray]:
    """Errors (t, y) of every segment, in times the noise, without what a sensor adds that reads up to ``SAME_INSTANT``
    of a sample early or late, after the fitted variables took what they can of that; NaN without a reading."""
    data = fit.problem.data
    errors = [np.where(s.measured, part, 0.0) for s, part in zip(data.segments, fit.errors, strict=True)]
    slopes = [
        np.gradient(np.where(segment.measured, segment.readings / data.noise, np.nan) - part, axis=0)
        if len(part) > 1
        else np.zeros_like(part)
        for segment, part in zip(data.segments, errors, strict=True)
    ]
    slope, left = np.nan_to_num(np.concatenate(slopes)), np.concatenate(errors)
    moved = np.zeros((left.size, slope.shape[1]))
    for j, column in enumerate(slope.T):
        moved[j :: slope.shape[1], j] = column
    if fit.problem.weighting is None:
        moved -= fit.jacobian @ np.linalg.lstsq(fit.jacobian.T @ fit.jacobian, fit.jacobian.T @ moved, rcond=1e-12)[0]
    late = np.linalg.lstsq(moved.T @ moved, moved.T @ left.ravel(), rcond=1e-12)[0]
    left -= (moved @ np.clip(late, -SAME_INSTANT, SAME_INSTANT)).reshape(left.shape)
    ends = np.cumsum([len(part) for part in errors])[:-1]
    return [np.where(s.measured, p, np.nan) for s, p in zip(data.segments, np.split(left, ends), strict=True)]


def with_balanced_sensors(hypothesis: Hypothesis, far_from_noise: float) -> Hypothesis:
    """A hypothesis with its sensors weighted by what it leaves of them, or by their noise where it leaves less than
    ``far_from_noise`` times that; itself where noise weights them already.

    Where what is left is slow, its memory takes the place of parameters that hold the slow part: the next fit lets it
    grow, and so on. A fit that loses its way so is not taken.
    """
    fit = hypothesis.fit
    if fit.problem.weighting is None:
        return hypothesis
    if largest_error(fit) < far_from_noise:
        return replace(hypothesis, fit=solve(replace(fit.problem, weighting=None), fit.v))
    balanced = iteratively_reweighted(fit)
    lost = pooled_error(balanced) > MOST_LOST * pooled_error(fit)
    return hypothesis if lost else replace(hypothesis, fit=balanced)


def rms_errors(fit: Fit) -> np.ndarray:
    """Root mean square error (y,) of each sensor, in times its noise; 0 without readings."""
    squares = np.sum([np.sum(part**2, axis=0) for part in fit.errors], axis=0)
    return np.sqrt(squares / np.maximum(fit.problem.data.readings_by_sensor, 1))


def largest_error(fit: Fit) -> float:
    """Root mean square error of the sensor with the largest one, in times its noise."""
    return float(rms_errors(fit).max(initial=0.0))


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
    parts = of_the_same_instant(hypothesis.fit)
    sizes = np.maximum(np.sqrt(np.nan_to_num(hypothesis.mean_squares)), 1.0)
    tests = [whiteness([part[:, j] / size for part in parts]) for j, size in enumerate(sizes)]
    if any(scales.any() for scales in _beyond_noise(hypothesis.fit, tests)):
        return False
    columns = (part[:, j] for part in parts for j in range(part.shape[1]))
    return all(effective_share(column) > INDEPENDENT for column in columns if np.isfinite(column).any())


def with_sharpest_friction(hypothesis: Hypothesis) -> Hypothesis:
    """A hypothesis that is not at the noise with its friction as sharp as ever pays: no further cause is to be searched
    for what smooth friction leaves. Far from the noise that is little beside the error of the model."""
    if at_noise(hypothesis):
        return hypothesis
    sharper = replace(hypothesis, fit=with_sharper_friction(hypothesis.fit, FINAL_STEPS))
    if at_noise(sharper) or sharper.misfit > SMOOTH_FRICTION:
        return sharper
    return replace(sharper, fit=with_sharper_friction(sharper.fit, MOST_STEPS_A_SAMPLE))


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


def simpler_kinds(hypothesis: Hypothesis, index: int) -> list[SimplerEffect]:
    """Simpler kinds that behave as a cause of a hypothesis does at its values."""
    cause, fit = hypothesis.causes[index], hypothesis.fit
    p, _ = fit.problem.unpack(fit.v)
    value = dict(zip(fit.problem.model.parameters, (float(x) for x in p), strict=True))
    parameters = {key: fit.values[name] for key, name in cause.names().items()}
    return list(EFFECTS[cause.kind].simpler(cause.at, parameters, value, hypothesis.model.base))


def is_simpler(cause: Cause, other: Hypothesis) -> bool:
    """Whether a cause is a simpler kind of the last cause of another hypothesis, in its place."""
    return any((simpler.kind, simpler.at) == (cause.kind, cause.at) for simpler in simpler_kinds(other, -1))


def share_explained(parent: Hypothesis, child: Hypothesis) -> float:
    """Share of the misfit beyond noise that a further cause explains; 1 where there is hardly any misfit."""
    excess = parent.chi_square - parent.fit.problem.data.readings_count
    decrease = parent.chi_square - child.chi_square
    return min(decrease / excess, 1.0) if excess > max(decrease, 0.0) else float(decrease > 0)


# --- Fits far from the best that are as good: the profile likelihood of parameters that others can compensate.
#
# A further spring in series with a shaft is the example: as long as its own resonance is not excited, only the sum of
# both compliances shows, and the resonance settles wherever noise happens to look like it. The Jacobian at the end of a
# fit then gives the width of a local minimum, not that of all equivalent fits.

STEP_FACTOR, MOST_STEPS = 1.5, 8  # between two values of a profile, and how many to each side
CONFOUNDED = 4.0  # times: how much less certain a parameter is when the others are free, from which it is profiled
EQUIVALENT = 9.0  # of χ² above the best: within three standard uncertainties


def equivalent_fits(fit: Fit, causes: tuple[Cause, ...]) -> list[Fit]:
    """Fits along the profiles of χ² that are equivalent to the best of them, which comes first.

    Each positive parameter of a cause that others can compensate is moved step by step and held while the others are
    fitted (Venzon and Moolgavkar, Applied Statistics 37, 1988). Where that finds a lower χ² than the fit's, the search
    for the minimum goes on from there.
    """
    sigma, length = np.sqrt(np.diag(covariance(fit))), np.linalg.norm(fit.jacobian, axis=0)
    names = [name for cause in causes if not cause.replaces_quantity for name in cause.names().values()]
    fits = [fit]
    for name in names:
        i = fit.problem.free.index(name)
        if fit.problem.lower[i] > 0 and sigma[i] * length[i] >= CONFOUNDED:
            fits += [other for factor in (1 / STEP_FACTOR, STEP_FACTOR) for other in _profile(fit, i, factor)]
    best = min(fits, key=lambda fit: fit.cost)
    if best is not fit:
        fits.append(polished(solve(best.problem, best.v)))
    fits.sort(key=lambda fit: fit.cost)
    return [fit for fit in fits if fit.cost < fits[0].cost + EQUIVALENT]


def _profile(fit: Fit, i: int, factor: float) -> list[Fit]:
    """Fits with variable ``i`` held ever further away, until χ² has clearly risen."""
    fits, last, lowest = [], fit, fit.cost
    for _ in range(MOST_STEPS):
        v = last.v.copy()
        v[i] *= factor
        if time_is_over() or not fit.problem.lower[i] <= v[i] <= fit.problem.upper[i]:
            break
        try:
            last = solve(fit.problem, v, last.jacobian, FitOptions(held=(i,)))
        except FitError:
            break
        lowest = min(lowest, last.cost)
        if last.cost > lowest + 2 * EQUIVALENT:
            break
        fits.append(last)
    return fits


def widened(estimates: Mapping[str, Estimate], fits: list[Fit]) -> dict[str, Estimate]:
    """Estimates of the best of several equivalent fits, uncertain at least as far as the others are away from it.

    On a parabola, a point that is d away and χ² higher by c makes the standard uncertainty d/√c; where χ² hardly rises,
    d is taken.
    """
    best, *others = fits
    out = dict(estimates)
    for other in others:
        sigmas = max(1.0, float(np.sqrt(other.cost - best.cost)))
        for name, estimate in out.items():
            away = abs(other.values[name] - best.values[name]) / sigmas
            out[name] = replace(estimate, standard_uncertainty=max(estimate.standard_uncertainty, away))
    return out


# --- The final fit of a hypothesis: finer integration steps, sharper friction, exact derivatives.

ITERATIONS = 12
FINER = 2.0  # times as many integration steps as in a search
WORSE_SHARE, WORSE = 0.01, 10.0  # of χ², and χ²: what finer steps may add; more, and they ended elsewhere


def final_fit(hypothesis: Hypothesis) -> Hypothesis:
    """A hypothesis fitted with steps half as long, ending on a Jacobian of its own point, if that is no worse."""
    if time_is_over():
        return hypothesis
    if not hypothesis.causes:
        return replace(hypothesis, fit=polished(hypothesis.fit))
    model = replace(hypothesis.at_fit(), starts=tuple(hypothesis.fit.starts))
    try:
        fit = fit_extended(model, hypothesis.fit, FitOptions(ITERATIONS), FINER)
        fit = polished(with_sharper_friction(fit, FINAL_STEPS))
    except FitError:
        return hypothesis
    finer = with_sharpest_friction(replace(hypothesis, fit=fit))
    return finer if finer.fit.cost < (1 + WORSE_SHARE) * hypothesis.fit.cost + WORSE else hypothesis


def final_fit_on(hypothesis: Hypothesis, base: Fit) -> Hypothesis:
    """A hypothesis of a part of the data fitted to all that a base fit has."""
    model = hypothesis.at_fit()
    fit = fit_extended(model, base, FitOptions()) if hypothesis.causes else base
    return final_fit(Hypothesis(model, fit))
