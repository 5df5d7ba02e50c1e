"""The uncertainty of R_XiL itself, by Monte Carlo over signal noise, delays and U.

Without it two rigs' fidelities cannot be compared. Each draw is what a repetition of the measurement would have given:

- the mean square deviation of a signal under white noise of standard deviation σ in each of its l samples is σ²/l times
  a noncentral χ² with l degrees of freedom, exactly; the noncentrality is the deviation that is there without noise;
- the sensor's U is mostly systematic: one offset of u = U/k a draw and signal, the same for all its samples;
- extremes of the reference carry the noise of one sample each; delays are normal with their standard uncertainty, and
  where the delay is not determined, R_τ is drawn evenly between nothing and what the nearest delay gives, which is the
  best case and the value that is stated: the interval then reaches from a lower bound up to that value;
- U itself scatters like a standard deviation with its degrees of freedom, as χ.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.signal import detrend
from scipy.signal.windows import hann

from modelling.fidelity.assess import MEASUREMENT, Fidelity, Sensor, SignalFidelity, SignalPair
from modelling.fidelity.measures import delay_fidelity


@dataclass(frozen=True)
class Spread:
    """Draws ``(b,)`` of R_XiL and of each domain, with what follows from them."""

    total: np.ndarray
    domains: dict[str, np.ndarray]
    coverage: float
    best: dict[str, float]  # value of what holds a signal without determined delay: the best that could be

    def summary(self) -> dict[str, Any]:
        """Mean, standard uncertainty and shortest interval of each."""
        return {
            name: _described(draws, self.coverage, self.best.get(name))
            for name, draws in (("total", self.total), *self.domains.items())
        }


def spread(fidelity: Fidelity, draws: int = 20_000, seed: int = 1, coverage: float = 0.95) -> Spread:
    """Distribution of R_XiL and its domains."""
    generator = np.random.default_rng(seed)
    squares: dict[str, np.ndarray] = {}
    for domain, members in fidelity.signals.items():
        parts = [_signal(one, fidelity, generator, draws) for one in members]
        divisor = 6 if fidelity.arithmetic == "published" else 2 * len(members)
        squares[domain] = np.sum([a**2 + b**2 for a, b in parts], axis=0) / divisor
    if fidelity.sensors:
        ratios = np.array([_ratio(one, generator, draws) for one in fidelity.sensors])
        divisor = 6 if fidelity.arithmetic == "published" else len(ratios)
        squares[MEASUREMENT] = np.maximum(0.0, 1 - np.sqrt(np.sum(ratios**2, axis=0) / divisor)) ** 2
    total = np.sum([fidelity.weights[name] * square for name, square in squares.items()], axis=0)
    open_ended = [name for name, own in fidelity.signals.items() if any(one.delay.value is None for one in own)]
    best = {name: fidelity.domains[name] for name in open_ended} | ({"total": fidelity.total} if open_ended else {})
    return Spread(np.sqrt(total), {name: np.sqrt(square) for name, square in squares.items()}, coverage, best)


def probability_better(first: Spread, second: Spread) -> float:
    """Probability that the first rig's fidelity is above the second's; independent draws of equal number."""
    return float(np.mean(first.total > second.total))


def noise_of(pair: SignalPair, step: float, f_max: float) -> tuple[float, float]:
    """Standard deviation of a sample's noise in reference and test: as given, or estimated from above f_max.

    The estimate takes all that lies above twice f_max as white noise; zero where the recording does not reach there.
    """
    if pair.noise is not None:
        return pair.noise
    return _high_band(pair.reference, step, 2 * f_max), _high_band(pair.test, step, 2 * f_max)


def _high_band(signal: np.ndarray, step: float, edge: float) -> float:
    window = hann(len(signal), sym=False)
    if len(signal) < 32:
        return 0.0
    power = np.abs(np.fft.rfft(detrend(signal) * window)) ** 2 / np.sum(window**2)
    high = np.fft.rfftfreq(len(signal), step) > edge
    return math.sqrt(float(np.mean(power[high]))) if np.count_nonzero(high) > 8 else 0.0


def _signal(
    one: SignalFidelity, fidelity: Fidelity, generator: np.random.Generator, draws: int
) -> tuple[np.ndarray, np.ndarray]:
    if one.pair is None or fidelity.step is None:
        nrmse = np.clip(one.nrmse + one.nrmse_uncertainty * generator.standard_normal(draws), 0, 1)
    else:
        nrmse = _nrmse(one, one.pair, fidelity, generator, draws)
    return nrmse, _delay(one, fidelity.f_max, generator, draws)


def _nrmse(
    one: SignalFidelity, pair: SignalPair, fidelity: Fidelity, generator: np.random.Generator, draws: int
) -> np.ndarray:
    noise = noise_of(pair, fidelity.step or 0.0, fidelity.f_max)
    variance, count = noise[0] ** 2 + noise[1] ** 2, len(pair.reference)
    deviation = float(np.mean(np.asarray(pair.test) - np.asarray(pair.reference)))
    u = 0.0 if pair.expanded_uncertainty is None else pair.expanded_uncertainty / pair.coverage_factor
    offset = u * generator.standard_normal(draws)
    noiseless = np.maximum(one.mean_square - variance, 0.0) + np.maximum(
        2 * deviation * offset + offset**2, -max(one.mean_square - variance, 0.0)
    )
    if variance > 0:
        noiseless = variance / count * generator.noncentral_chisquare(count, count * noiseless / variance)
    width = one.width + math.sqrt(2) * noise[0] * generator.standard_normal(draws)
    width = np.maximum(width, 0.1 * one.width)
    if fidelity.nrmse_form == "literal":
        return np.clip(1 - np.sqrt(noiseless / width), 0, 1)
    return np.clip(1 - np.sqrt(noiseless) / width, 0, 1)


def _delay(one: SignalFidelity, f_max: float, generator: np.random.Generator, draws: int) -> np.ndarray:
    if one.delay.value is None:
        return one.delay_fidelity * generator.random(draws)
    if not one.delay.standard_uncertainty:
        return np.full(draws, one.delay_fidelity)
    return delay_fidelity(one.delay.value + one.delay.standard_uncertainty * generator.standard_normal(draws), f_max)


def _ratio(one: Sensor, generator: np.random.Generator, draws: int) -> np.ndarray:
    if math.isinf(one.degrees_of_freedom):
        return np.full(draws, one.ratio)
    return one.ratio * np.sqrt(generator.chisquare(one.degrees_of_freedom, draws) / one.degrees_of_freedom)


def _described(draws: np.ndarray, coverage: float, best: float | None) -> dict[str, Any]:
    ordered = np.sort(draws)
    held = min(round(coverage * len(ordered)), len(ordered) - 1)
    start = int(np.argmin(ordered[held:] - ordered[: len(ordered) - held]))
    ends = [float(ordered[start]), float(ordered[start + held])]
    if best is not None:  # the value itself is the best case: a bound below, the interval reaches up to it
        ends = [float(ordered[-1 - held]), max(float(ordered[-1]), best)]
    return {
        "mean": float(draws.mean()),
        "standard_uncertainty": float(draws.std()),
        "interval": ends,
        "coverage": coverage,
    }
