"""Frequency and damping of a mode from measured responses: one pair of poles that all functions share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from matching.bed_test.local_rational import MeasuredResponse

FITTED_BAND_RATIO = 1.3  # a mode is fitted from its expected frequency over this to its frequency times this
RESIDUAL_DEGREE = 2  # of the numerator: what other modes add is smooth so near to this one
LEAST_DEVIATION = 1e-6  # of the largest value: no value counts as exact
LARGEST_MISFIT_RATIO = 0.3  # over the misfit of a polynomial alone: above it the responses show no mode here
LARGEST_RELATIVE_UNCERTAINTY = 0.1  # of a frequency that still counts as identified, k = 1


@dataclass(frozen=True)
class MeasuredMode:
    """Frequency (Hz) and damping ratio with standard uncertainties."""

    frequency: float
    frequency_uncertainty: float
    damping_ratio: float
    damping_uncertainty: float


def measured_mode(measured: MeasuredResponse, frequency: float, damping: float) -> MeasuredMode | None:
    """The mode near an expected one (Hz, damping ratio); None where the responses do not show it.

    Each function is (c₀ + c₁q + c₂q²)/(s² + 2ζωs + ω²), q the relative distance in frequency: for given ω and ζ linear
    in c, so only ω and ζ are searched for (variable projection, Golub and Pereyra 1973).
    """
    low, high = frequency / FITTED_BAND_RATIO, frequency * FITTED_BAND_RATIO
    near = (measured.frequencies > low) & (measured.frequencies < high)
    values = measured.values[near].reshape(near.sum(), -1)
    deviations = np.sqrt(measured.variances[near].reshape(near.sum(), -1))
    known = np.isfinite(values).all(axis=0) & np.isfinite(deviations).all(axis=0)
    f = measured.frequencies[near]
    if len(f) < 2 * (RESIDUAL_DEGREE + 3) or not known.any():
        return None
    values, deviations = values[:, known], deviations[:, known]
    deviations = np.maximum(deviations, LEAST_DEVIATION * np.abs(values).max(axis=0))
    powers = ((f - frequency) / frequency)[:, None] ** np.arange(RESIDUAL_DEGREE + 1)
    s = 2j * np.pi * f

    def residual(x: np.ndarray) -> np.ndarray:
        omega, zeta = 2 * np.pi * np.exp(x[0]), x[1]
        shape = powers / (s**2 + 2 * zeta * omega * s + omega**2)[:, None]
        parts = []
        for value, deviation in zip(values.T, deviations.T, strict=True):
            weighted, right = shape / deviation[:, None], value / deviation
            scale = np.linalg.norm(weighted, axis=0)
            c = np.linalg.lstsq(weighted / scale, right, rcond=None)[0]
            rest = right - weighted / scale @ c
            parts += [rest.real, rest.imag]
        return np.concatenate(parts)

    start = np.array([np.log(frequency), damping])
    bounds = [np.log(low), 1e-5], [np.log(high), 0.9]
    optimum = scipy.optimize.least_squares(residual, np.clip(start, *bounds), bounds=bounds, x_scale=[0.05, 0.05])
    freedom = max(len(optimum.fun) - 2 - 2 * (RESIDUAL_DEGREE + 1) * values.shape[1], 1)
    # neighbouring values share spectral lines: as many independent ones as windows fit in
    overlap = max(1.0, len(f) * float(np.mean(measured.windows[near])) / np.ptp(f))
    covariance = np.linalg.pinv(optimum.jac.T @ optimum.jac) * overlap * max(2 * optimum.cost / freedom, 1.0)
    relative, of_damping = np.sqrt(np.diag(covariance))
    if optimum.cost > LARGEST_MISFIT_RATIO * _misfit_without_mode(powers, values, deviations, f, frequency):
        return None
    if relative > LARGEST_RELATIVE_UNCERTAINTY or not bounds[0][0] < optimum.x[0] < bounds[1][0]:
        return None
    value = float(np.exp(optimum.x[0]))
    return MeasuredMode(value, value * float(relative), float(optimum.x[1]), float(of_damping))


def _misfit_without_mode(
    powers: np.ndarray, values: np.ndarray, deviations: np.ndarray, f: np.ndarray, middle: float
) -> float:
    """Half the sum of squares that polynomials leave which have two degrees more, as many unknowns, and no pole."""
    more = ((f - middle) / middle)[:, None] ** np.arange(powers.shape[1] + 2)
    misfit = 0.0
    for value, deviation in zip(values.T, deviations.T, strict=True):
        weighted, right = more / deviation[:, None], value / deviation
        scale = np.linalg.norm(weighted, axis=0)
        rest = right - weighted / scale @ np.linalg.lstsq(weighted / scale, right, rcond=None)[0]
        misfit += float(np.sum(np.abs(rest) ** 2)) / 2
    return misfit
