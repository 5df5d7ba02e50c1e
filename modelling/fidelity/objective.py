"""R_XiL as an objective: differentiable in the test signals, so that an optimiser can follow its gradient.

The delay is not taken from a correlation peak but projected. To first order a delayed reference deviates by −τ·dr/dt,
so τ = −⟨d, dr/dt⟩/(g·⟨dr/dt, dr/dt⟩) with d = test − reference and g the test's gain. That is exact for small delays
and differentiable everywhere; :func:`modelling.fidelity.assess.fidelity_of_signals` verifies the result. Works on NumPy
arrays and on CasADi expressions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import casadi
import numpy as np

from modelling.common.errors import InputError
from modelling.fidelity.checks import check_time
from modelling.fidelity.measures import chi, signal_range

# Roundings of roots, far below any difference that matters in a fidelity, large enough for finite gradients:
RMSE_ROUNDING = 1e-9  # of the range: the root at a perfect match, whose gradient would be infinite
CUT_ROUNDING = 1e-7  # square of R_NRMSE's rounding at the cut at 0
DELAY_ROUNDING = 1e-18  # s²: |τ| at 0
GAIN_ROUNDING = 1e-6  # square of the gain below which a delay is not divided by it any more


class SmoothFidelity:
    """1 − R² of one dynamic domain (Eqs. 17, 21) for stated references; add the domains with their weights.

    Parameters
    ----------
    time : ndarray (t,)
        s, at equal steps.
    references : mapping of str to ndarray (t,)
    f_max : float
        Hz, for χ of Eq. 20.

    Raises
    ------
    InputError
        If the time steps are unequal, a reference has another length, a value that is not finite, or no range.
    """

    def __init__(self, time: np.ndarray, references: Mapping[str, np.ndarray], f_max: float):
        step = check_time(time)
        self.chi = chi(f_max)
        self.references = {name: np.asarray(signal, dtype=float) for name, signal in references.items()}
        for name, signal in self.references.items():
            if signal.shape != np.shape(time) or not np.all(np.isfinite(signal)):
                raise InputError(
                    name,
                    f"reference has {signal.size} samples, time {np.size(time)}, or values that are not finite",
                    "give as many finite samples as times",
                )
        self.widths = {name: signal_range(signal, name) for name, signal in self.references.items()}
        self.rates = {name: self._rate(signal, step) for name, signal in self.references.items()}

    @staticmethod
    def _rate(signal: np.ndarray, step: float) -> np.ndarray:
        """Time derivative (t,) without its mean."""
        rate = np.gradient(signal, step)
        return rate - rate.mean()

    def delay(self, name: str, test: Any) -> Any:
        """First-order delay in s of a test signal (t,); its gain against the reference is divided out."""
        rate, centred = self.rates[name], self.references[name] - self.references[name].mean()
        gain = _dot(centred, test) / float(centred @ centred)
        projected = -_dot(rate, test - self.references[name]) / float(rate @ rate)
        return projected * gain / (gain * gain + GAIN_ROUNDING)

    def loss(self, tests: Mapping[str, Any]) -> Any:
        """1 − R² for test signals (t,) by name: NumPy arrays, or CasADi columns of t entries."""
        total: Any = 0.0
        for name, reference in self.references.items():
            deviation = (tests[name] - reference) / self.widths[name]
            rmse = ((_dot(deviation, deviation) / len(reference)) + RMSE_ROUNDING**2) ** 0.5
            nrmse = _cut_at_zero(1 - rmse)
            delay = self.delay(name, tests[name])
            tau = 1 - 2 / math.pi * _arctan(self.chi * (delay * delay + DELAY_ROUNDING) ** 1.5)
            total = total + nrmse * nrmse + tau * tau
        return 1 - total / (2 * len(self.references))


def _cut_at_zero(value: Any) -> Any:
    """The cut at 0 of Eq. 18, rounded: beyond the range no deviation is better than another."""
    return (value + (value * value + CUT_ROUNDING) ** 0.5) / 2


def _dot(first: Any, second: Any) -> Any:
    if isinstance(first, np.ndarray) and isinstance(second, np.ndarray):
        return first @ second
    return casadi.dot(first, second)


def _arctan(value: Any) -> Any:
    if isinstance(value, float):
        return np.arctan(value)
    return casadi.atan(value)
