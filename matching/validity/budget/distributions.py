"""The distributions an input can have: standard uncertainty from half-width (Eq. 12), fast draws, exact quantiles.

Every shape is written for a standard uncertainty of one, centred at zero. Draws follow JCGM 101, 6.4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

NAMES = ("normal", "rectangular", "triangular", "arcsine", "trapezoidal", "t")


@dataclass(frozen=True)
class Distribution:
    """A shape by name; ``beta`` is the trapezoid's top over its base, ``degrees_of_freedom`` those of Student's t."""

    name: str
    beta: float = 0.0
    degrees_of_freedom: float = math.inf
    width_tolerance: float = 0.0  # of the half-width, relative: a rectangle with inexact limits (JCGM 101, 6.4.3)

    def weight(self) -> float:
        """G of Eq. 12: squared standard uncertainty over squared half-width."""
        return {
            "rectangular": 1 / 3 + self.width_tolerance**2 / 9,
            "triangular": 1 / 6,
            "arcsine": 1 / 2,
            "trapezoidal": (1 + self.beta**2) / 6,
        }[self.name]

    def law(self) -> Any:
        """The same as frozen SciPy distribution (of unit *scale* for Student's t, whose variance is larger)."""
        if self.name == "normal":
            return scipy.stats.norm()
        if self.name == "t":
            return scipy.stats.t(self.degrees_of_freedom)
        half = 1 / math.sqrt(self.weight())
        if self.name == "rectangular":
            return scipy.stats.uniform(-half, 2 * half)
        if self.name == "arcsine":
            return scipy.stats.arcsine(-half, 2 * half)
        return scipy.stats.trapezoid((1 - self.beta) / 2, (1 + self.beta) / 2, loc=-half, scale=2 * half)

    def kurtosis(self) -> float:
        """Fourth central moment over squared variance; that of the normal for Student's t, as GUM 5.1.2 takes it."""
        if self.name in ("normal", "t"):
            return 3.0
        if self.name == "triangular":
            return 2.4
        if self.width_tolerance:  # half-width W uniform in 1 ± τ: E x⁴ = E W⁴/5, E x² = E W²/3
            tau = self.width_tolerance**2
            return (1 + 2 * tau + tau**2 / 5) / 5 / ((1 + tau / 3) / 3) ** 2
        return 3.0 + float(self.law().stats("k"))

    def draw(self, generator: np.random.Generator, count: int) -> np.ndarray:
        """Draws, shape ``(count,)``."""
        if self.name == "normal":
            return generator.standard_normal(count)
        if self.name == "t":
            return generator.standard_t(self.degrees_of_freedom, count)
        half = 1 / math.sqrt(self.weight())
        draws = generator.random(count)
        if self.name == "arcsine":
            return half * np.cos(np.pi * draws)
        draws = 2 * draws - 1
        if self.name == "rectangular":
            if self.width_tolerance:
                draws *= 1 + self.width_tolerance * (2 * generator.random(count) - 1)
            return half * draws
        second = 2 * generator.random(count) - 1
        return half * ((1 + self.beta) / 2 * draws + (1 - self.beta) / 2 * second)
