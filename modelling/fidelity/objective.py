"""R_XiL as an objective: smooth in the test signals, so that an optimiser can follow its gradient.

The delay is not read off a peak but projected: to first order a delayed reference deviates by −τ·slope, so
τ = −⟨d, slope⟩/(g·⟨slope, slope⟩) with d = test − reference and g the test's gain. That is exact for small delays and
differentiable everywhere; ``fidelity_of_signals`` verifies the outcome. Works on NumPy arrays and CasADi expressions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import casadi
import numpy as np

from modelling.common.errors import InputError
from modelling.fidelity.assess import check_time
from modelling.fidelity.measures import chi, signal_range

SMALL = 1e-9  # of the range: rounds off the root at a perfect match, where its slope would be infinite
CUT = 1e-7  # rounds off the cut at a deviation as large as the range


class SmoothFidelity:
    """1 − R² of one dynamic domain (Eqs. 17, 21) for given references; add the domains with their weights.

    Parameters
    ----------
    time : (t,)
        In s, at equal steps.
    references : by name, each (t,)
    f_max : float
        In Hz, for χ of Eq. 20.
    """

    def __init__(self, time: np.ndarray, references: Mapping[str, np.ndarray], f_max: float):
        step = check_time(time)
        self.chi = chi(f_max)
        self.references = {name: np.asarray(signal, dtype=float) for name, signal in references.items()}
        for name, signal in self.references.items():
            if signal.shape != np.shape(time) or not np.all(np.isfinite(signal)):
                raise InputError(
                    name, f"reference has {signal.size} samples, time {np.size(time)}, or gaps", "give as many"
                )
        self.widths = {name: signal_range(signal, name) for name, signal in self.references.items()}
        self.slopes = {name: self._slope(signal, step) for name, signal in self.references.items()}

    @staticmethod
    def _slope(signal: np.ndarray, step: float) -> np.ndarray:
        slope = np.gradient(signal, step)
        return slope - slope.mean()

    def delay(self, name: str, test: Any) -> Any:
        """First-order delay of a test signal in s; its gain against the reference is divided out."""
        slope, centred = self.slopes[name], self.references[name] - self.references[name].mean()
        gain = _dot(centred, test) / float(centred @ centred)
        projected = -_dot(slope, test - self.references[name]) / float(slope @ slope)
        return projected * gain / (gain * gain + 1e-6)

    def loss(self, tests: Mapping[str, Any]) -> Any:
        """1 − R² for test signals ``(t,)`` by name: NumPy arrays, or CasADi columns of t entries."""
        total: Any = 0.0
        for name, reference in self.references.items():
            deviation = (tests[name] - reference) / self.widths[name]
            nrmse = _positive(1 - ((_dot(deviation, deviation) / len(reference)) + SMALL**2) ** 0.5)
            lag = self.delay(name, tests[name])
            delayed = 1 - 2 / math.pi * _arctan(self.chi * (lag * lag + 1e-18) ** 1.5)
            total = total + nrmse * nrmse + delayed * delayed
        return 1 - total / (2 * len(self.references))


def _positive(value: Any) -> Any:
    """The cut at 0 of Eq. 18, rounded off: beyond the range no deviation is better than another."""
    return (value + (value * value + CUT) ** 0.5) / 2


def _dot(first: Any, second: Any) -> Any:
    if isinstance(first, np.ndarray) and isinstance(second, np.ndarray):
        return first @ second
    return casadi.dot(first, second)


def _arctan(value: Any) -> Any:
    if isinstance(value, float):
        return np.arctan(value)
    return casadi.atan(value)
