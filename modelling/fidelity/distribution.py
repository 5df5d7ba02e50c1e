"""The uncertainty of R_XiL itself, by Monte Carlo over signal noise, delays and U.

Without it the fidelities of two test beds cannot be compared. Each draw is one repetition of the measurement:

- The mean square deviation of a signal under white noise of standard deviation σ in each of its t samples is σ²/t times
  a noncentral χ² with t degrees of freedom, exactly. The noncentrality is the deviation without noise.
- The sensor's U is mostly systematic: one offset with u = U/k for each draw and signal, the same for all its samples.
- The extremes of the reference carry the noise of one sample each.
- Delays are normal with their standard uncertainty. Where the delay is undetermined, R_τ is drawn uniformly between 0
  and the value for the smallest delay that fits. That value is the best case and the one stated, so the interval
  reaches from a lower bound up to it.
- U itself scatters as a standard deviation with its degrees of freedom, as χ.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import scipy

from modelling.fidelity.fidelity import MEASUREMENT_DOMAIN, Fidelity, SensorUncertainty, SignalFidelity, SignalPair
from modelling.fidelity.measures import PUBLISHED_DIVISOR, delay_fidelity

SMALLEST_WIDTH = 0.1  # of the reference's range: draws of the range do not fall below it
SHORTEST_SPECTRUM = 32  # samples below which no noise is estimated
FEWEST_LINES = 8  # spectral lines above the band that a noise estimate needs


@dataclass(frozen=True)
class DrawnValue:
    """Mean, standard uncertainty and coverage interval of a drawn fidelity, 0 … 1."""

    mean: float
    standard_uncertainty: float
    interval: tuple[float, float]
    coverage: float

    def to_dict(self) -> dict[str, Any]:
        """As ``fidelity.json`` holds it."""
        return asdict(self) | {"interval": list(self.interval)}


@dataclass(frozen=True)
class FidelityDistribution:
    """Draws (b,) of R_XiL and of each domain.

    ``upper_ends`` holds the stated value of the total and of each domain that has a signal with an undetermined delay:
    the best case.
    """

    total: np.ndarray
    domains: dict[str, np.ndarray]
    coverage: float
    upper_ends: dict[str, float]

    def summary(self) -> dict[str, DrawnValue]:
        """Mean, standard uncertainty and shortest interval of ``"total"`` and of each domain."""
        return {
            name: _summary(draws, self.coverage, self.upper_ends.get(name))
            for name, draws in (("total", self.total), *self.domains.items())
        }


def fidelity_distribution(
    fidelity: Fidelity, draws: int = 20_000, seed: int = 1, coverage: float = 0.95
) -> FidelityDistribution:
    """Distribution of R_XiL and its domains over ``draws`` repetitions of the measurement."""
    generator = np.random.default_rng(seed)
    published = fidelity.method.arithmetic == "published"
    squares: dict[str, np.ndarray] = {}
    for domain, members in fidelity.signals.items():
        values = [_signal_draws(signal, fidelity, generator, draws) for signal in members]
        divisor = PUBLISHED_DIVISOR if published else 2 * len(members)
        squares[domain] = np.sum([nrmse**2 + tau**2 for nrmse, tau in values], axis=0) / divisor
    if fidelity.sensors:
        ratios = np.array([_ratio_draws(sensor, generator, draws) for sensor in fidelity.sensors])
        divisor = PUBLISHED_DIVISOR if published else len(ratios)
        squares[MEASUREMENT_DOMAIN] = np.maximum(0.0, 1 - np.sqrt(np.sum(ratios**2, axis=0) / divisor)) ** 2
    total = np.sum([fidelity.weights[name] * square for name, square in squares.items()], axis=0)
    undetermined = [
        name for name, members in fidelity.signals.items() if any(signal.delay.value is None for signal in members)
    ]
    upper_ends = {name: fidelity.domains[name] for name in undetermined}
    if undetermined:
        upper_ends["total"] = fidelity.total
    return FidelityDistribution(
        np.sqrt(total), {name: np.sqrt(square) for name, square in squares.items()}, coverage, upper_ends
    )


def probability_better(first: FidelityDistribution, second: FidelityDistribution) -> float:
    """Probability that the first test bed's fidelity is above the second's; independent draws of equal number."""
    return float(np.mean(first.total > second.total))


def noise_of(pair: SignalPair, step: float, f_max: float) -> tuple[float, float]:
    """Standard deviation of a sample's noise in reference and test: as stated, or estimated from above f_max.

    The estimate takes the spectrum above twice f_max as white noise; 0 where the recording does not reach there.
    """
    if pair.noise is not None:
        return pair.noise
    return _noise_above(pair.reference, step, 2 * f_max), _noise_above(pair.test, step, 2 * f_max)


def _noise_above(signal: np.ndarray, step: float, frequency: float) -> float:
    """Standard deviation of white noise with the signal's mean power above a frequency in Hz."""
    if len(signal) < SHORTEST_SPECTRUM:
        return 0.0
    window = scipy.signal.windows.hann(len(signal), sym=False)
    power = np.abs(np.fft.rfft(scipy.signal.detrend(signal) * window)) ** 2 / np.sum(window**2)
    above = np.fft.rfftfreq(len(signal), step) > frequency
    return math.sqrt(float(np.mean(power[above]))) if np.count_nonzero(above) > FEWEST_LINES else 0.0


def _signal_draws(
    signal: SignalFidelity, fidelity: Fidelity, generator: np.random.Generator, draws: int
) -> tuple[np.ndarray, np.ndarray]:
    """Draws (b,) of R_NRMSE and R_τ of a signal."""
    if signal.pair is None or fidelity.step is None:
        nrmse = np.clip(signal.nrmse + signal.nrmse_uncertainty * generator.standard_normal(draws), 0, 1)
    else:
        nrmse = _nrmse_draws(signal, signal.pair, fidelity, generator, draws)
    return nrmse, _delay_draws(signal, fidelity.f_max, generator, draws)


def _nrmse_draws(
    signal: SignalFidelity, pair: SignalPair, fidelity: Fidelity, generator: np.random.Generator, draws: int
) -> np.ndarray:
    noise = noise_of(pair, fidelity.step or 0.0, fidelity.f_max)
    variance, count = noise[0] ** 2 + noise[1] ** 2, len(pair.reference)
    deviation = float(np.mean(np.asarray(pair.test) - np.asarray(pair.reference)))
    u = 0.0 if pair.expanded_uncertainty is None else pair.expanded_uncertainty / pair.coverage_factor
    offset = u * generator.standard_normal(draws)
    noiseless = max(signal.mean_square - variance, 0.0)
    mean_square = noiseless + np.maximum(2 * deviation * offset + offset**2, -noiseless)
    if variance > 0:
        mean_square = variance / count * generator.noncentral_chisquare(count, count * mean_square / variance)
    width = signal.width + math.sqrt(2) * noise[0] * generator.standard_normal(draws)
    width = np.maximum(width, SMALLEST_WIDTH * signal.width)
    if fidelity.method.nrmse_form == "literal":
        return np.clip(1 - np.sqrt(mean_square / width), 0, 1)
    return np.clip(1 - np.sqrt(mean_square) / width, 0, 1)


def _delay_draws(signal: SignalFidelity, f_max: float, generator: np.random.Generator, draws: int) -> np.ndarray:
    delay = signal.delay
    if delay.value is None:
        return signal.delay_fidelity * generator.random(draws)
    if not delay.standard_uncertainty:
        return np.full(draws, signal.delay_fidelity)
    return delay_fidelity(delay.value + delay.standard_uncertainty * generator.standard_normal(draws), f_max)


def _ratio_draws(sensor: SensorUncertainty, generator: np.random.Generator, draws: int) -> np.ndarray:
    if math.isinf(sensor.degrees_of_freedom):
        return np.full(draws, sensor.ratio)
    return sensor.ratio * np.sqrt(generator.chisquare(sensor.degrees_of_freedom, draws) / sensor.degrees_of_freedom)


def _summary(draws: np.ndarray, coverage: float, upper_end: float | None) -> DrawnValue:
    """Summary of draws (b,); with an upper end, the interval reaches from the lower quantile up to it."""
    ordered = np.sort(draws)
    inside = min(round(coverage * len(ordered)), len(ordered) - 1)
    if upper_end is None:
        start = int(np.argmin(ordered[inside:] - ordered[: len(ordered) - inside]))
        interval = float(ordered[start]), float(ordered[start + inside])
    else:
        interval = float(ordered[-1 - inside]), max(float(ordered[-1]), upper_end)
    return DrawnValue(float(draws.mean()), float(draws.std()), interval, coverage)
