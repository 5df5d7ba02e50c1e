"""What residuals tell: whether they are noise, how well parameters are known, how well a fit predicts held-out data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import fft

from matching.diagnosis.descent import Fit, difference_steps
from matching.diagnosis.holdout import HoldoutRun
from matching.diagnosis.problem import jacobian

# --- Statistics of a residual: its size against the noise, and whether it is white.

BLOCK_LENGTHS = (1, 4, 16, 64, 256, 1024)  # samples over which the residual is averaged
FEWEST_BLOCKS = 4
SOKAL_WINDOW = 5.0  # autocorrelation times; Sokal (1997) recommends 4 to 10


@dataclass(frozen=True)
class WhitenessTest:
    """A sensor's residual against white noise of its stated uncertainty.

    Attributes
    ----------
    ratio : float
        Root mean square in times the noise.
    excess : ndarray (l,)
        Power of the means over ``BLOCK_LENGTHS`` samples beyond that of white noise, in times the noise power.
    score : ndarray (l,)
        The same in standard deviations of its estimate for white noise.
    """

    ratio: float
    excess: np.ndarray
    score: np.ndarray


def whiteness(residual: Sequence[np.ndarray], known: np.ndarray | None = None) -> WhitenessTest:
    """Compare a sensor's residual, (t,) in times the noise for each segment, with white noise; NaN is not counted.

    The mean square of n independent normal values of variance 1 has the variance 2/n.

    Parameters
    ----------
    residual : sequence of ndarray (t,)
    known : ndarray (l,), optional
        Excess that is known to be there besides white noise, for each of ``BLOCK_LENGTHS``.
    """
    every = np.concatenate([part[np.isfinite(part)] for part in residual])
    excess, score = [], []
    for i, length in enumerate(BLOCK_LENGTHS):
        means = np.concatenate([_block_means(part, length) for part in residual])
        if len(means) < FEWEST_BLOCKS:
            break
        expected = 1.0 + (0.0 if known is None else float(known[i]) * length)
        beyond = float(np.mean(means**2)) - expected
        excess.append(beyond / length)
        score.append(beyond / (expected * np.sqrt(2 / len(means))))
    return WhitenessTest(float(np.sqrt(np.mean(every**2))) if len(every) else 0.0, np.array(excess), np.array(score))


def _block_means(residual: np.ndarray, length: int) -> np.ndarray:
    """Sums over blocks of a white signal of variance 1, scaled to variance 1; blocks less than half full are left
    out."""
    blocks = residual[: len(residual) // length * length].reshape(-1, length)
    count = np.isfinite(blocks).sum(axis=1)
    full = count > length / 2
    return np.nansum(blocks, axis=1)[full] / np.sqrt(count[full])


def effective_share(residual: np.ndarray) -> float:
    """Share of a residual's samples (t,) that count as independent: 1 if it is white.

    The inverse of the integrated autocorrelation time 1 + 2·Σρ(k), summed up to the first k that is five times that
    time itself (Sokal, Monte Carlo Methods in Statistical Mechanics, 1997, section 3).
    """
    values = residual[np.isfinite(residual)]
    values = values - values.mean()
    length = fft.next_fast_len(2 * len(values), real=True)
    spectrum = fft.rfft(values, length)
    correlation = fft.irfft(spectrum * np.conj(spectrum), length)[: len(values)]
    if correlation[0] <= 0:
        return 1.0
    times = 2 * np.cumsum(correlation / correlation[0]) - 1
    beyond = np.arange(len(times)) >= SOKAL_WINDOW * times
    stop = int(np.argmax(beyond)) if beyond.any() else len(times) - 1
    return float(1 / max(times[stop], 1.0))


NOISE_MEAN_SQUARE = 1.05  # of a residual that needs no test for correlation


def residual_inflation(parts: list[np.ndarray]) -> float:
    """Mean square of a residual, (t, y) in times the noise, over the share of independent samples in it; at least 1."""
    count = sum(int(np.isfinite(part).sum()) for part in parts)
    mean_square = float(sum(np.nansum(part**2) for part in parts)) / count if count else 0.0
    if mean_square < NOISE_MEAN_SQUARE:
        return max(mean_square, 1.0)
    shares = [effective_share(part[:, j]) for part in parts for j in range(part.shape[1]) if np.nansum(part[:, j] ** 2)]
    return mean_square / min(shares, default=1.0)


def mean_square(part: np.ndarray) -> np.ndarray:
    """Mean squares (y,) of residuals (t, y); NaN without readings."""
    count = np.isfinite(part).sum(axis=0)
    return np.where(count, np.nansum(part**2, axis=0) / np.maximum(count, 1), np.nan)


def shares_of_ranges(errors: np.ndarray, readings: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Root mean square errors (y,) over the ranges of the readings; NaN without readings, or where they never change.

    Parameters
    ----------
    errors : ndarray (t, y)
        In times the noise; NaN without a reading.
    readings : ndarray (r, y)
        SI; NaN without a reading.
    noise : ndarray (y,)
        SI.
    """
    measured = np.isfinite(readings).any(axis=0) & np.isfinite(errors).any(axis=0)
    width = np.zeros(len(measured))
    width[measured] = np.nanmax(readings[:, measured], axis=0) - np.nanmin(readings[:, measured], axis=0)
    return np.where(width > 0, np.sqrt(mean_square(errors)) * noise / np.where(width > 0, width, 1.0), np.nan)


# --- How well a fit knows its parameters.

NOT_IDENTIFIABLE = 0.5  # of the uniform distribution's: a larger standard uncertainty is that of the range
FEWEST_READINGS = 64  # of a sensor whose residual is tested
TEST_SIGMA = 5.0  # standard deviations of the mean square beyond which a residual is more than noise
AT_BOUND_SHARE = 1e-6  # of the width of the range
SMALLEST_SINGULAR = 1e-10  # of the largest singular value; less is rounding


AT_BOUND = "at the bound of its range"


@dataclass(frozen=True)
class Estimate:
    """A fitted parameter, SI; ``note`` says if the data do not identify it, or a bound holds it."""

    value: float
    standard_uncertainty: float
    note: str = ""


def inflation(fit: Fit) -> float:
    """Factor (≥ 1) of the covariance where the residual is larger than the noise or not white: the worst sensor's.

    The variance of a mean of correlated values is larger by the number of samples over the number of independent ones.
    """
    worst = 1.0
    segments = fit.problem.data.segments
    for j in range(len(fit.problem.data.noise)):
        parts = [r[segment.measured[:, j], j] for r, segment in zip(fit.by_sensor(), segments, strict=True)]
        count = sum(len(part) for part in parts)
        if count < FEWEST_READINGS:
            continue
        mean_square = float(np.mean(np.concatenate(parts) ** 2))
        if mean_square > 1 + TEST_SIGMA * np.sqrt(2 / count):
            worst = max(worst, mean_square / effective_share(max(parts, key=len)))
    return worst


def estimates(
    fit: Fit, shift: np.ndarray | None = None, least: Mapping[str, float] | None = None
) -> dict[str, Estimate]:
    """Values and standard uncertainties of the free parameters, from the Jacobian at the end.

    Parameters
    ----------
    shift : ndarray (v,), optional
        How finer steps of the integration move the variables (:func:`discretisation_shift`); added in quadrature.
    least : dict of str to float, optional
        Standard uncertainties that are at least so large, SI by name.
    """
    width, at_bound = _ranges(fit)
    sigma = np.sqrt(np.diag(covariance(fit, inflation(fit))))
    out = {}
    for i, name in enumerate(fit.problem.free):
        uncertainty, notes = max(float(sigma[i]), (least or {}).get(name, 0.0)), []
        uniform = float(width[i]) / np.sqrt(12)
        if at_bound[i]:
            notes.append(AT_BOUND)
        if uncertainty > NOT_IDENTIFIABLE * uniform:
            uncertainty = min(uncertainty, uniform)
            notes.append("not identifiable: the data do not narrow its range")
        if shift is not None:
            uncertainty = float(np.hypot(uncertainty, shift[i]))
        if uncertainty == 0.0:
            uncertainty = np.inf
            notes.append("unknown: no reading depends on it")
        out[name] = Estimate(float(fit.v[i]), uncertainty, "; ".join(notes))
    return out


def at_least(estimates: Mapping[str, Estimate], uncertainties: Mapping[str, float]) -> dict[str, Estimate]:
    """Estimates no more certain than others have them."""
    return {
        name: replace(estimate, standard_uncertainty=max(estimate.standard_uncertainty, uncertainties.get(name, 0.0)))
        for name, estimate in estimates.items()
    }


def covariance(fit: Fit, factor: float = 1.0) -> np.ndarray:
    """Covariance (v, v) of the variables: (JᵀJ/factor + P)⁻¹ with the information P of the ranges.

    A range is knowledge: it enters as a uniform distribution over its width w, variance w²/12; for a parameter at a
    bound w²/3, the mean square distance from that bound, so that it is as uncertain for the others as for itself.

    By singular values of the Jacobian itself: directions known only from the ranges must not be lost to rounding.
    Variables without any influence on the readings have the variance 0 where nothing bounds them.
    """
    width, at_bound = _ranges(fit)
    prior = np.where(np.isfinite(width), np.sqrt(np.where(at_bound, 3.0, 12.0)) / np.maximum(width, 1e-300), 0.0)
    rows = np.linalg.qr(fit.jacobian, mode="r") / np.sqrt(factor)
    rows = np.vstack([rows, np.diag(prior)])
    scale = np.linalg.norm(rows, axis=0)
    scale[scale == 0] = np.inf
    _, values, directions = np.linalg.svd(rows / scale, full_matrices=False)
    keep = values > SMALLEST_SINGULAR * values.max(initial=0.0)
    half = directions[keep].T / values[keep] / scale[:, None]
    return half @ half.T


def discretisation_shift(fit: Fit) -> np.ndarray:
    """How far the variables (v,) move, to first order, when the integration takes steps half as long."""
    problem = fit.problem
    half = replace(problem, steps_per_second=2 * problem.steps_per_second, stick_speed=problem.stick_speed / 2)
    residual = half.residuals(fit.v[None])[0]
    if not np.isfinite(residual).all():
        return np.zeros(problem.size)
    return -covariance(fit) @ (fit.jacobian.T @ (residual - fit.residual))


def _ranges(fit: Fit) -> tuple[np.ndarray, np.ndarray]:
    """Widths (v,) of the ranges, infinite without one, and whether a variable is at an end of it."""
    problem, v = fit.problem, fit.v
    width = problem.upper - problem.lower
    near = AT_BOUND_SHARE * np.where(np.isfinite(width), width, np.abs(v) + 1e-9)
    return width, (v - problem.lower < near) | (problem.upper - v < near)


# --- What a fit leaves of a hold-out recording, given how well it knows its own variables.
#
# A free simulation carries on what a fit left uncertain: a speed that drifts because a drag is known to a tenth says
# nothing against the model. So the residual e is judged after the variables have adapted to it within their covariance
# Σ: that is where the posterior mean would be (Laplace approximation; e.g. Bishop, Pattern Recognition and Machine
# Learning, 2006, section 4.5.2).


def adapted(fit: Fit, runs: Sequence[HoldoutRun]) -> list[np.ndarray] | None:
    """Residuals (t, y) of simulations of hold-out recordings after the variables of the fit have adapted to them within
    their covariance; None where that does not simulate."""
    half = _square_root(covariance(fit)[: len(fit.problem.free), : len(fit.problem.free)])
    whitened = [_whitened(fit, run, half) for run in runs]
    if not all(np.isfinite(part).all() for pair in whitened for part in pair):
        return None
    gram = sum((A.T @ A for A, _ in whitened), np.zeros((len(fit.problem.free),) * 2))
    projection = sum((A.T @ e for A, e in whitened), np.zeros(len(gram)))
    step = np.linalg.solve(np.eye(len(gram)) + gram, projection)
    out = []
    for run, (A, e) in zip(runs, whitened, strict=True):
        residual = np.zeros(len(run.residual))
        residual[run.mask()] = e - A @ step
        out += run.parts(residual)
    return out


def _whitened(fit: Fit, run: HoldoutRun, half: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives A (r, p) by whitened parameters of the fit, and residual e (r,), of the readings of a simulation,
    whose start states have taken their share of both already."""
    problem, mask, k = run.problem, run.mask(), len(fit.problem.free)
    steps, states = difference_steps(fit), len(fit.problem.free_states)
    starts = steps[k:].reshape(-1, states).min(axis=0)
    steps = np.concatenate([steps[:k], np.tile(starts, (problem.size - k) // max(states, 1))])
    derivatives = jacobian(problem, run.v, run.residual, largest_central=steps)[mask]
    residual, A = run.residual[mask], derivatives[:, :k] @ half
    basis = np.linalg.qr(derivatives[:, k:])[0]
    return A - basis @ (basis.T @ A), residual - basis @ (basis.T @ residual)


def _square_root(covariance: np.ndarray) -> np.ndarray:
    """A square root (v, v) of a covariance; a variable without variance does not move."""
    sigma = np.sqrt(np.diag(covariance))
    safe = np.where(sigma > 0, sigma, 1.0)
    values, directions = np.linalg.eigh(covariance / np.outer(safe, safe))
    return sigma[:, None] * directions * np.sqrt(np.maximum(values, 0.0))
