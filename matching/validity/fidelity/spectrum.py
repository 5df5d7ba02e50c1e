"""At which frequencies the fidelity is lost: the deviation of each band, split into amplitude, phase and delay."""

from __future__ import annotations

import itertools
import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import scipy

from modelling.fidelity.fidelity import SignalPair
from modelling.fidelity.measures import delay_fidelity, nrmse_fidelity_of, signal_range

EDGES = (0.0, 0.5, 1.0, 2.0, 4.0, 7.0, 10.0, 15.0, 20.0, 25.0, 30.0)  # Hz
LEAST_COHERENCE = 0.7  # below it a band's lines share no delay
TRIAL_DELAYS = 41  # over ± half a period of the band's mean frequency: 40 steps find the highest of its few peaks


@dataclass(frozen=True)
class Band:
    """One band of a signal's deviation. The bands' ``mean_square`` sum to that of the whole deviation exactly.

    Attributes
    ----------
    low, high : float
        Hz.
    mean_square, share : float
        Mean square deviation, SI, and its part of the whole.
    nrmse : float
        R_NRMSE if there were only this band's deviation.
    amplitude_share, phase_share : float
        Parts of the band's mean square, by |X − Y|² = (|X| − |Y|)² + 2|X||Y|(1 − cos φ).
    coherence : float
        Of the band's lines with one common delay, 0 … 1.
    delay, delay_fidelity : float, optional
        That delay in s and its R_τ; None where the band has too few lines or too little coherence.
    """

    low: float
    high: float
    mean_square: float
    share: float
    nrmse: float
    amplitude_share: float
    phase_share: float
    coherence: float
    delay: float | None
    delay_fidelity: float | None

    def to_dict(self) -> dict[str, Any]:
        """As ``fidelity.json`` holds it; the upper edge of the last band is null."""
        return asdict(self) | {"high": self.high if math.isfinite(self.high) else None}


def bands(pair: SignalPair, step: float, f_max: float, edges: tuple[float, ...] = EDGES) -> tuple[Band, ...]:
    """Bands from 0 to f_max and one above (``edges`` Hz, ``step`` s); the mean square splits by Parseval's theorem.

    The discrete spectrum takes the recording as one period. A recording that ends at another value than it began with
    has a step there, which contributes to all bands, but to reference and test alike, so that their difference hardly
    shows it.
    """
    reference, test = np.asarray(pair.reference, dtype=float), np.asarray(pair.test, dtype=float)
    count, width = len(reference), signal_range(reference)
    edges = (*(edge for edge in edges if edge < f_max), f_max, math.inf)
    x, y = np.fft.rfft(reference), np.fft.rfft(test)
    frequency = np.fft.rfftfreq(count, step)
    lines = np.full(len(x), 2.0)  # a line stands for a conjugate pair, but for 0 and half the sampling frequency
    lines[0] = 1.0
    if count % 2 == 0:
        lines[-1] = 1.0
    deviation = lines / count**2 * np.abs(x - y) ** 2
    amplitude = lines / count**2 * (np.abs(x) - np.abs(y)) ** 2
    total = float(deviation.sum())
    split = []
    for low, high in itertools.pairwise(edges):
        inside = (frequency >= low) & (frequency < high)
        mean_square, by_amplitude = float(deviation[inside].sum()), float(amplitude[inside].sum())
        delay, coherence = _common_delay(x[inside], y[inside], frequency[inside])
        split.append(
            Band(
                low,
                high,
                mean_square,
                mean_square / total if total > 0 else 0.0,
                nrmse_fidelity_of(mean_square, width),
                by_amplitude / mean_square if mean_square > 0 else 0.0,
                1 - by_amplitude / mean_square if mean_square > 0 else 0.0,
                coherence,
                delay,
                None if delay is None else float(delay_fidelity(delay, f_max)),
            )
        )
    return tuple(split)


def _common_delay(x: np.ndarray, y: np.ndarray, frequency: np.ndarray) -> tuple[float | None, float]:
    """The delay (s) that makes the cross-spectrum of a band (f,) most nearly real, and the coherence, 0 … 1."""
    usable = frequency > 0
    cross, frequency = np.conj(x[usable]) * y[usable], frequency[usable]
    power = math.sqrt(float(np.sum(np.abs(x[usable]) ** 2) * np.sum(np.abs(y[usable]) ** 2)))
    if len(cross) < 2 or power <= 0:
        return None, 0.0

    def coherence_at(delay: float) -> float:
        return float(np.real(np.sum(cross * np.exp(2j * np.pi * frequency * delay)))) / power

    half_period = 0.5 / float(np.mean(frequency))
    trials = np.linspace(-half_period, half_period, TRIAL_DELAYS)
    start = trials[int(np.argmax([coherence_at(delay) for delay in trials]))]
    reach = trials[1] - trials[0]
    best = scipy.optimize.minimize_scalar(
        lambda delay: -coherence_at(delay),
        bounds=(start - reach, start + reach),
        method="bounded",
        options={"xatol": 1e-9},
    )
    coherence = min(1.0, max(0.0, -float(best.fun)))
    return (float(best.x) if coherence > LEAST_COHERENCE else None), coherence
