"""Shapes of excitation: multisine, chirp and steps, each beginning and ending at zero."""

from __future__ import annotations

import numpy as np

FADE = 0.25  # s at both ends of a part
STEP_RISE = 0.02  # s: a step is a ramp of this time
CREST_TRIES = 40  # draws of the phases, of which the flattest is taken


def fade(samples: int, step: float) -> np.ndarray:
    """Window (t,) that rises and falls by half a cosine at its ends; ``step`` in s."""
    edge = min(round(FADE / step), samples // 4)
    window = np.ones(samples)
    window[:edge] = (1 - np.cos(np.pi * np.arange(edge) / edge)) / 2
    window[samples - edge :] = window[:edge][::-1]
    return window


# more than six parameters: all that defines the signal
def multisine(
    lines: np.ndarray, of_input: np.ndarray, powers: np.ndarray, inputs: int, samples: int, step: float, seed: int
) -> np.ndarray:
    """Torques (t, u): sines at lines (l,), Hz, of mean squares ``powers`` (l,), with drawn phases and a small peak.

    ``of_input`` (l,) is each line's input, ``step`` in s.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(samples) * step
    waves = 2j * np.pi * lines[:, None] * time
    out = np.zeros((samples, inputs))
    for j in range(inputs):
        mine = np.flatnonzero((of_input == j) & (powers > 0))
        if not len(mine):
            continue
        amplitude = np.sqrt(2 * powers[mine])
        carriers = np.exp(waves[mine])
        drawn = np.exp(2j * np.pi * rng.random((CREST_TRIES, len(mine))))
        shapes = np.real((drawn * amplitude) @ carriers)
        out[:, j] = shapes[np.argmin(np.abs(shapes).max(axis=1))]
    return out * fade(samples, step)[:, None]


def chirp(low: float, high: float, input_index: int, inputs: int, samples: int, step: float) -> np.ndarray:
    """Torques (t, u): a sine of amplitude 1 whose frequency (Hz) grows exponentially, on one input; ``step`` in s."""
    time, lasts = np.arange(samples) * step, samples * step
    rate = np.log(high / low)
    out = np.zeros((samples, inputs))
    out[:, input_index] = np.sin(2 * np.pi * low * lasts / rate * np.expm1(rate * time / lasts))
    return out * fade(samples, step)[:, None]


def steps(input_index: int, inputs: int, samples: int, step: float) -> np.ndarray:
    """Torques (t, u): up, down through zero to the other side, and back, amplitude 1, on one input; ``step`` in s."""
    lasts = samples * step
    at = np.array([0.05, 0.05, 0.35, 0.35, 0.65, 0.65]) * lasts
    at[1::2] += STEP_RISE
    out = np.zeros((samples, inputs))
    out[:, input_index] = np.interp(np.arange(samples) * step, at, [0.0, 1.0, 1.0, -1.0, -1.0, 0.0])
    return out
