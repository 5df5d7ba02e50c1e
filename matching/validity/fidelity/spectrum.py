"""Where in frequency the fidelity is lost: the deviation of each band, split into amplitude, phase and delay."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from modelling.fidelity.assess import SignalPair
from modelling.fidelity.measures import delay_fidelity, nrmse_fidelity_of, signal_range

EDGES = (0.0, 0.5, 1.0, 2.0, 4.0, 7.0, 10.0, 15.0, 20.0, 25.0, 30.0)


@dataclass(frozen=True)
class Band:
    """One band from ``low`` to ``high`` Hz; the bands' ``mean_square`` add up to that of the whole deviation exactly.

    ``share`` of the mean square deviation; ``nrmse`` is R_NRMSE if there were only this band's deviation;
    ``amplitude_share`` and ``phase_share`` split it by |X − Y|² = (|X| − |Y|)² + 2|X||Y|(1 − cos φ);
    ``coherence`` is that of the band's lines taken with one common delay, and ``delay`` (s) that delay, or None where
    the band holds too few lines or too little coherence; ``delay_fidelity`` follows from it.
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


def bands(pair: SignalPair, step: float, f_max: float, edges: tuple[float, ...] | None = None) -> list[Band]:
    """Bands over 0…f_max and one above; ``edges`` in Hz. The mean square splits by Parseval's theorem.

    The discrete spectrum takes the recording as one period; a recording that ends elsewhere than it began puts its
    jump into all bands, but into reference and test alike, so that the deviation's spectrum hardly shows it.
    """
    reference, test = np.asarray(pair.reference, dtype=float), np.asarray(pair.test, dtype=float)
    count, width = len(reference), signal_range(reference)
    edges = (*tuple(edge for edge in (EDGES if edges is None else edges) if edge < f_max), f_max, math.inf)
    x, y = np.fft.rfft(reference), np.fft.rfft(test)
    frequency = np.fft.rfftfreq(count, step)
    double = np.full(len(x), 2.0)  # lines that stand for a conjugate pair
    double[0] = 1.0
    if count % 2 == 0:
        double[-1] = 1.0
    scale = double / count**2
    deviation = scale * np.abs(x - y) ** 2
    amplitude = scale * (np.abs(x) - np.abs(y)) ** 2
    total = float(deviation.sum())
    found = []
    for low, high in itertools.pairwise(edges):
        inside = (frequency >= low) & (frequency < high)
        part = float(deviation[inside].sum())
        by_amplitude = float(amplitude[inside].sum())
        lag, coherence = _common_delay(x[inside], y[inside], frequency[inside])
        found.append(
            Band(
                low,
                high,
                part,
                part / total if total > 0 else 0.0,
                nrmse_fidelity_of(part, width),
                by_amplitude / part if part > 0 else 0.0,
                1 - by_amplitude / part if part > 0 else 0.0,
                coherence,
                lag,
                None if lag is None else float(delay_fidelity(lag, f_max)),
            )
        )
    return found


def _common_delay(x: np.ndarray, y: np.ndarray, frequency: np.ndarray) -> tuple[float | None, float]:
    """The delay that turns the cross-spectrum of the band most nearly real, and how nearly (coherence, 0…1)."""
    usable = frequency > 0
    cross, frequency = np.conj(x[usable]) * y[usable], frequency[usable]
    power = math.sqrt(float(np.sum(np.abs(x[usable]) ** 2) * np.sum(np.abs(y[usable]) ** 2)))
    if len(cross) < 2 or power <= 0:
        return None, 0.0
    centre = float(np.mean(frequency))

    def coherent(lag: float) -> float:
        return float(np.real(np.sum(cross * np.exp(2j * np.pi * frequency * lag)))) / power

    half = 0.5 / centre
    trial = np.linspace(-half, half, 41)
    start = trial[int(np.argmax([coherent(lag) for lag in trial]))]
    best = minimize_scalar(
        lambda lag: -coherent(lag),
        bounds=(start - half / 15, start + half / 15),
        method="bounded",
        options={"xatol": 1e-9},
    )
    coherence = min(1.0, max(0.0, -float(best.fun)))
    return (float(best.x) if coherence > 0.7 else None), coherence


def as_json(found: list[Band]) -> list[dict[str, Any]]:
    """For ``fidelity.json``; the upper edge of the last band is null."""
    return [vars(band) | {"high": band.high if math.isfinite(band.high) else None} for band in found]
