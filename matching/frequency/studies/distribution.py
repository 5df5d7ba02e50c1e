"""How a result spreads over draws, and which inputs drive it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

LEVELS = (0.01, 0.05, 0.5, 0.95, 0.99)
CONFIDENCE = 0.95  # of the intervals of quantiles
BINS = 60


@dataclass(frozen=True)
class Spread:
    """Distribution of one result.

    Attributes
    ----------
    nominal, mean, standard_deviation : float
    quantiles : dict of float to float
    intervals : dict of float to (float or None, float or None)
        Confidence interval (95 %) of each quantile from order statistics, whatever the distribution; None for an end
        that so few draws do not bound (David and Nagaraja, Order Statistics, 2003, 7.1).
    drivers : tuple of (str, float)
        Share of the variance that goes along with each input, straight or as its square, largest first: covariance of
        its part of a regression with the regression (Pratt 1987). For independent inputs these are the squared
        standardised regression coefficients (Saltelli et al., Global Sensitivity Analysis, 2008, 1.2.5); they add up
        to ``explained`` also where the draws are correlated by chance.
    explained : float
        Share of the variance that all inputs explain so (R²), each for itself; NaN where nothing spreads.
    edges, counts : ndarray (b + 1,), (b,)
        Histogram.
    """

    name: str
    unit: str
    nominal: float
    mean: float
    standard_deviation: float
    quantiles: dict[float, float]
    intervals: dict[float, tuple[float | None, float | None]]
    drivers: tuple[tuple[str, float], ...]
    explained: float
    draws: int
    edges: np.ndarray
    counts: np.ndarray

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "name": self.name, "unit": self.unit, "nominal": self.nominal, "mean": self.mean,
            "standard_deviation": self.standard_deviation, "draws": self.draws,
            "quantiles": {f"{level:g}": value for level, value in self.quantiles.items()},
            "quantile_intervals": {f"{level:g}": list(ends) for level, ends in self.intervals.items()},
            "drivers": [{"name": name, "share": share} for name, share in self.drivers],
            "explained": self.explained if np.isfinite(self.explained) else None,
        }  # fmt: skip


class Regressors:
    """Draws x (b, p) of named inputs, straight and squared, each with mean 0 and standard deviation 1."""

    def __init__(self, inputs: Sequence[str], x: np.ndarray):
        self.inputs = tuple(inputs)
        plain = _standard(x)
        self._terms = np.hstack([plain, _standard(plain**2)])
        self._products = self._terms.T @ self._terms

    def __len__(self) -> int:
        return len(self._terms)

    def explained(self, values: np.ndarray) -> tuple[list[float], float]:
        """Share of the variance of values (b,) by input, and of all together, by least squares; NaN for too few."""
        if len(self) <= 2 * len(self.inputs) + 1:
            return [0.0] * len(self.inputs), float("nan")
        wanted = (values - values.mean()) / values.std()
        coefficients = np.linalg.lstsq(self._products, self._terms.T @ wanted, rcond=None)[0]
        along = coefficients * (self._products @ coefficients) / len(self)  # covariance of each term with the fit
        shares = np.clip(np.sum(along.reshape(2, -1), axis=0), 0, 1).tolist()
        return shares, float(1 - np.mean((wanted - self._terms @ coefficients) ** 2))


def spread(name: str, unit: str, nominal: float, values: np.ndarray, drawn: Regressors) -> Spread:
    """Spread of values (b,) over draws of the inputs."""
    shares, explained = [0.0] * len(drawn.inputs), float("nan")
    size = float(values.std())
    if size > 1e-9 * max(abs(nominal), 1e-300):
        shares, explained = drawn.explained(values)
    counts, edges = np.histogram(values, BINS)
    ranked = sorted(zip(drawn.inputs, shares, strict=True), key=lambda pair: -pair[1])
    return Spread(
        name, unit, float(nominal), float(values.mean()), size,
        dict(zip(LEVELS, np.quantile(values, LEVELS).tolist(), strict=True)), quantile_intervals(values),
        tuple(ranked), explained, len(values), edges, counts,
    )  # fmt: skip


def quantile_intervals(values: np.ndarray) -> dict[float, tuple[float | None, float | None]]:
    """Confidence intervals of the quantiles :data:`LEVELS` by order statistics of values (b,).

    The number of draws below a quantile is binomial, so the interval from one ordered draw to another covers it at
    least as often as stated.
    """
    ordered, count = np.sort(values), len(values)
    intervals: dict[float, tuple[float | None, float | None]] = {}
    for level in LEVELS:
        # this many draws and one lie below, or fewer
        first = int(scipy.stats.binom.ppf((1 - CONFIDENCE) / 2, count, level)) - 1
        last = int(scipy.stats.binom.ppf((1 + CONFIDENCE) / 2, count, level))
        below = float(ordered[first]) if first >= 0 else None
        intervals[level] = (below, float(ordered[last]) if last < count else None)
    return intervals


def _standard(x: np.ndarray) -> np.ndarray:
    """Columns (b, p) with mean 0 and standard deviation 1."""
    size = x.std(axis=0)
    return (x - x.mean(axis=0)) / np.where(size > 0, size, 1.0)
