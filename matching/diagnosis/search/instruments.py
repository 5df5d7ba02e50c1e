"""What a fit becomes with instruments: signals that move a controlled input and that no noise of a reading reaches.

Under feedback an input follows the errors of readings, and an output-error fit is biased where these have a memory. The
controller's reference moves the input too, and follows no error. A regression on it gives the input as it would be
without noise; the derivatives of the simulated readings under that input are the instruments (two-stage method; Van den
Hof and Schrama, Automatica 29, 1993). Whether both estimates differ by more than chance is tested after Hausman
(Econometrica 46, 1978), with the noise's own correlation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import fft, signal, stats

from matching.diagnosis.fitting.finite_differences import jacobian
from matching.diagnosis.fitting.fit import Fit

KERNELS = 24  # hat functions that an impulse response is made of, their lags growing geometrically
LONGEST_RESPONSE_S, RESPONSE_SHARE = 2.0, 0.1  # lag of the last; and of the shortest segment at most
CORRELATION_SHARE = 0.05  # of a segment: longest lag of the noise's correlation that is counted
LEAST_MOVED = 0.05  # share of the controlled input's power: an instrument that moves less says nothing
CHANCE = 1e-4  # probability that an unbiased fit is called biased, or a rest without pattern one that has it


@dataclass(frozen=True)
class InstrumentedFit:
    """A fit beside what it becomes with instruments.

    Attributes
    ----------
    moved : float
        Share of the controlled inputs' power that instruments explain, of the worst.
    values, uncertainties : dict of str to float
        Of the fitted parameters with instruments, SI.
    biased : tuple of str
        Parameters that differ by more than chance.
    rest_follows : bool
        What is left follows the instruments: an error of the model, beside which no bias can be told.
    """

    moved: float
    values: dict[str, float]
    uncertainties: dict[str, float]
    biased: tuple[str, ...]
    rest_follows: bool


def instrumented_fit(fit: Fit, references: Mapping[int, Sequence[np.ndarray]]) -> InstrumentedFit:
    """The fit with instruments.

    Parameters
    ----------
    references : mapping of int to sequence of ndarray (t,)
        By controlled input (index): its reference on every segment.
    """
    segments = fit.problem.data.segments
    designs = _designs(fit, references)
    inputs, moved = _free_of_noise(fit, designs, list(references))
    data = replace(
        fit.problem.data, segments=tuple(replace(s, inputs=u) for s, u in zip(segments, inputs, strict=True))
    )
    problem = replace(fit.problem, data=data)
    instruments = jacobian(problem, fit.v, problem.residuals(fit.v[None])[0])
    by_instruments, by_errors = _estimators(fit, instruments), _estimators(fit, fit.jacobian)
    count = len(fit.problem.free)
    step = -by_instruments @ fit.residual
    difference = -(by_instruments - by_errors)[:count] @ fit.residual
    spread = np.sqrt(_variance(fit, (by_instruments - by_errors)[:count], fit.residual))
    uncertainty = np.sqrt(_variance(fit, by_instruments[:count], fit.residual))
    rest = fit.residual + fit.jacobian @ step
    limit = float(stats.norm.isf(CHANCE / 2 / max(count, 1)))
    names = fit.problem.free
    return InstrumentedFit(
        moved,
        dict(zip(names, (float(x) for x in fit.v[:count] + difference), strict=True)),
        dict(zip(names, (float(x) for x in uncertainty), strict=True)),
        tuple(name for name, d, s in zip(names, difference, spread, strict=True) if abs(d) > limit * s > 0),
        _follows(fit, rest, designs),
    )


def _designs(fit: Fit, references: Mapping[int, Sequence[np.ndarray]]) -> list[np.ndarray]:
    """Regressors (t, k) of every segment: references and inputs that no controller moves, through the hat kernels."""
    segments, step = fit.problem.data.segments, fit.problem.data.sampling_interval
    shortest = min(len(segment.time) for segment in segments)
    longest = max(int(min(LONGEST_RESPONSE_S / step, RESPONSE_SHARE * shortest)), KERNELS)
    knots = np.unique(np.concatenate([[0.0], np.geomspace(1, longest, KERNELS - 1)]))
    hats = [np.interp(np.arange(longest + 1), knots, unit) for unit in np.eye(len(knots))]
    open_inputs = [j for j in range(len(fit.problem.model.inputs)) if j not in references]
    out = []
    for i, segment in enumerate(segments):
        sources = [reference[i] for reference in references.values()]
        sources += [segment.inputs[:, j] for j in open_inputs]
        columns = [np.ones(len(segment.time))]
        for source in sources:
            columns += [
                signal.fftconvolve(source - source[0], hat)[: len(source)] for hat in hats if np.ptp(source) > 0
            ]
        out.append(np.stack(columns, axis=1))
    return out


def _free_of_noise(fit: Fit, designs: list[np.ndarray], controlled: list[int]) -> tuple[list[np.ndarray], float]:
    """Inputs (t, u) of every segment with controlled ones as instruments move them, and the least share explained."""
    segments = fit.problem.data.segments
    inputs, least = [segment.inputs.copy() for segment in segments], 1.0
    design = np.concatenate(designs)
    for j in controlled:
        recorded = np.concatenate([segment.inputs[:, j] for segment in segments])
        weights = np.linalg.lstsq(design, recorded, rcond=1e-8)[0]
        for part, values in zip(designs, inputs, strict=True):
            values[:, j] = part @ weights
        power = float(np.var(recorded))
        least = min(least, 1 - float(np.var(recorded - design @ weights)) / power if power > 0 else 0.0)
    return inputs, least


def _estimators(fit: Fit, instruments: np.ndarray) -> np.ndarray:
    """(v, r): how the variables follow the residual, (ZᵀJ + P)⁻¹·Zᵀ with the information P of the ranges."""
    size = np.maximum(np.linalg.norm(fit.jacobian, axis=0), 1e-300)
    width = (fit.problem.upper - fit.problem.lower) * size
    known = np.where(np.isfinite(width), 12 / np.maximum(width, 1e-300) ** 2, 0.0)
    scaled = instruments / size
    inner = scaled.T @ (fit.jacobian / size) + np.diag(known)
    return np.linalg.pinv(inner, rcond=1e-10) @ scaled.T / size[:, None]


def _variance(fit: Fit, weights: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Variance (w,) of weighted sums of errors (r,), weights (w, r)."""
    segments, total = fit.problem.data.segments, np.zeros(len(weights))
    ends = np.cumsum([segment.readings.size for segment in segments])[:-1]
    for part, error in zip(np.split(weights, ends, axis=1), fit.problem.by_sensor(errors), strict=True):
        by_sensor = part.reshape(len(weights), *error.shape)
        total += sum(_variance_of_sums(by_sensor[:, :, j], error[:, j]) for j in range(error.shape[1]))
    return total


def _variance_of_sums(weights: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Variance (w,) of weighted sums, weights (w, t), of errors (t,) with their own correlation over time."""
    count = len(errors)
    longest = max(int(CORRELATION_SHARE * count), 1)
    size = fft.next_fast_len(count + longest, real=True)
    power = np.abs(fft.rfft(errors - errors.mean(), size)) ** 2
    correlation = np.zeros(size)
    taper = 1 - np.arange(longest + 1) / (longest + 1)
    correlation[: longest + 1] = fft.irfft(power, size)[: longest + 1] / count * taper
    correlation[-longest:] = correlation[longest:0:-1]
    density = np.maximum(fft.rfft(correlation).real, 0.0)
    density[1 : (size + 1) // 2] *= 2  # negative frequencies
    return np.abs(fft.rfft(weights, size, axis=1)) ** 2 @ density / size


def _follows(fit: Fit, rest: np.ndarray, designs: list[np.ndarray]) -> bool:
    """Whether a rest (r,) is correlated with the instruments at any of their lags."""
    parts = fit.problem.by_sensor(rest)
    count = designs[0].shape[1] - 1
    sums, variances = np.zeros((count, parts[0].shape[1])), np.zeros((count, parts[0].shape[1]))
    for design, part in zip(designs, parts, strict=True):
        columns = (design[:, 1:] - design[:, 1:].mean(axis=0)).T
        sums += columns @ part
        variances += np.stack([_variance_of_sums(columns, error) for error in part.T], axis=1)
    measured = variances > 0
    largest = float(np.max(np.abs(sums[measured]) / np.sqrt(variances[measured]), initial=0.0))
    return largest > float(stats.norm.isf(CHANCE / 2 / max(int(measured.sum()), 1)))
