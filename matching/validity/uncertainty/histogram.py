"""A distribution held in bounded memory: moments and a fine histogram, filled chunk by chunk."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

BINS = 1 << 16


@dataclass
class Histogram:
    """Counts (bins + 2,) between fixed edges with one open bin at either end, and exact streaming moments.

    ``low`` and ``high`` bound the equal bins; what falls outside is counted between them and the extremes. A bin is
    about 10⁻⁴ standard uncertainties wide, far below what the draws themselves leave uncertain.
    """

    low: float
    high: float
    counts: np.ndarray = field(default_factory=lambda: np.zeros(BINS + 2, dtype=np.int64))
    number: int = 0
    mean: float = 0.0
    squares: float = 0.0
    least: float = math.inf
    most: float = -math.inf

    @classmethod
    def around(cls, pilot: np.ndarray, coverage: float) -> Histogram:
        """Edges that hold all but a hundredth of the part outside the coverage, judged by a pilot sample (n,)."""
        outside = (1 - coverage) / 200
        low, high = (float(edge) for edge in np.quantile(pilot, [outside, 1 - outside]))
        margin = 0.05 * (high - low) or max(abs(low), 1.0) * 1e-9
        return cls(low - margin, high + margin)

    def tally(self, values: np.ndarray) -> np.ndarray:
        """Counts (bins + 2,) of values (n,) in the bins, without adding them (threads may call it)."""
        places = (values - self.low) * (BINS / (self.high - self.low))
        np.clip(places, -1, BINS, out=places)
        return np.bincount((places + 1).astype(np.int64), minlength=BINS + 2)

    def add(self, counts: np.ndarray, number: int, mean: float, squares: float, least: float, most: float) -> None:
        """Merges a chunk's counts (bins + 2,); moments by the pairwise update of Chan, Golub and LeVeque."""
        self.counts += counts
        total = self.number + number
        shift = mean - self.mean if self.number else 0.0
        self.mean = self.mean if self.number else mean
        self.squares += squares + shift * shift * self.number * number / total
        self.mean += shift * number / total
        self.number, self.least, self.most = total, min(self.least, least), max(self.most, most)

    @property
    def standard_deviation(self) -> float:
        """Standard deviation of all values added."""
        return math.sqrt(self.squares / (self.number - 1))

    def _cumulative(self) -> tuple[np.ndarray, np.ndarray]:
        inner = np.linspace(self.low, self.high, BINS + 1)
        edges = np.concatenate([[min(self.least, self.low)], inner, [max(self.most, self.high)]])
        return edges, np.concatenate([[0.0], np.cumsum(self.counts) / self.number])

    def quantile(self, probability: float) -> float:
        """The value below which so much of the distribution lies."""
        edges, cumulative = self._cumulative()
        return float(np.interp(probability, cumulative, edges))
