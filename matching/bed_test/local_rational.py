"""Frequency responses from recordings of any excitation, by local rational models, with their covariance.

Around each frequency the spectra obey Y·(1 + d₁r + d₂r²) = (G + g₁r + g₂r²)·U + t₀ + t₁r + t₂r², r the distance in
frequency: a rational response and a smooth transient that the beginning and the end of a recording leave behind. It is
linear in its unknowns, takes any number of inputs, and needs neither periods nor windows (McKelvey and Guérin, IFAC
Proc. Vol. 45 (2012) 1431; Pintelon and Schoukens, System Identification, 2012, chapter 7). Recordings share the
response; each has its own transient.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

DEGREE = 2  # of response, transient and denominator over one window
FREEDOM = 1.5  # lines in a window over unknowns, at least: what is left over measures the noise
SINGULAR = 1e-9  # of the largest singular value of a scaled window: below it an input does not excite


@dataclass(frozen=True)
class Spectra:
    """One recording: frequencies (l,), Hz, spectra of inputs (l, u) and outputs (l, y)."""

    frequencies: np.ndarray
    inputs: np.ndarray
    outputs: np.ndarray


@dataclass(frozen=True)
class MeasuredResponse:
    """Responses at frequencies (f,), Hz.

    Attributes
    ----------
    values : ndarray (f, y, u)
        Output per input; NaN where it is not determined.
    variances : ndarray (f, y, u)
        Of the complex values: real and imaginary part together.
    windows : ndarray (f,)
        Hz, width of the window that each value was taken from.
    """

    frequencies: np.ndarray
    values: np.ndarray
    variances: np.ndarray
    windows: np.ndarray


def spectra(inputs: np.ndarray, outputs: np.ndarray, step: float, top: float) -> Spectra:
    """Spectra of signals (t, u), (t, y) at even steps (s), up to ``top`` (Hz), without their means."""
    count = len(inputs)
    frequencies = np.fft.rfftfreq(count, step)
    kept = (frequencies > 0) & (frequencies <= top)
    both = np.fft.rfft(np.hstack([inputs - inputs.mean(axis=0), outputs - outputs.mean(axis=0)]), axis=0)[kept]
    both /= np.sqrt(count)
    u = inputs.shape[1]
    return Spectra(frequencies[kept], both[:, :u], both[:, u:])


def response(recordings: Sequence[Spectra], frequencies: np.ndarray) -> MeasuredResponse:
    """Responses at frequencies (f,), Hz, from one or several recordings of the same system.

    Raises
    ------
    ValueError
        If a recording has fewer lines than one window needs.
    """
    first = recordings[0]
    u, y = first.inputs.shape[1], first.outputs.shape[1]
    lines = lines_needed(u, len(recordings))
    if any(len(recording.frequencies) < lines for recording in recordings):
        raise ValueError(f"{lines} lines are needed")
    values = np.full((len(frequencies), y, u), np.nan, complex)
    variances = np.full((len(frequencies), y, u), np.inf)
    windows = np.zeros(len(frequencies))
    for i, frequency in enumerate(frequencies):
        near = [_nearest(recording.frequencies, frequency, lines) for recording in recordings]
        windows[i] = max(np.ptp(recording.frequencies[at]) for recording, at in zip(recordings, near, strict=True))
        for output in range(y):
            values[i, output], variances[i, output] = _one(recordings, near, frequency, windows[i], output)
    return MeasuredResponse(np.asarray(frequencies, float), values, variances, windows)


def lines_needed(inputs: int, recordings: int) -> int:
    """Lines of each recording in a window."""
    unknown = (DEGREE + 1) * (inputs + recordings) + DEGREE
    return int(np.ceil((FREEDOM * unknown + 2) / recordings)) | 1


def _nearest(frequencies: np.ndarray, frequency: float, count: int) -> slice:
    middle = int(np.searchsorted(frequencies, frequency))
    start = min(max(middle - count // 2, 0), len(frequencies) - count)
    return slice(start, start + count)


def _one(
    recordings: Sequence[Spectra], near: Sequence[slice], frequency: float, width: float, output: int
) -> tuple[np.ndarray, np.ndarray]:
    """Values (u,) and variances (u,) of one output at one frequency."""
    count, u = len(recordings), recordings[0].inputs.shape[1]
    rows, wanted = [], []
    for i, (recording, lines) in enumerate(zip(recordings, near, strict=True)):
        powers = ((recording.frequencies[lines] - frequency) / (width / 2))[:, None] ** np.arange(DEGREE + 1)
        answer = recording.outputs[lines, output]
        driven = [powers * recording.inputs[lines, j, None] for j in range(u)]
        block = [powers if i == j else np.zeros_like(powers) for j in range(count)]
        rows.append(np.hstack([*driven, *block, -powers[:, 1:] * answer[:, None]]))
        wanted.append(answer)
    matrix, right = np.vstack(rows), np.concatenate(wanted)
    scale = np.linalg.norm(matrix, axis=0)
    missing = np.full(u, np.nan, complex), np.full(u, np.inf)
    if not (scale[: u * (DEGREE + 1)] > 0).all() or not np.linalg.norm(right) > 0:
        return missing
    scale[scale == 0] = 1.0
    left, sizes, turned = np.linalg.svd(matrix / scale, full_matrices=False)
    if sizes[-1] < SINGULAR * sizes[0]:
        return missing
    solution = (turned.conj().T @ ((left.conj().T @ right) / sizes)) / scale
    freedom = len(right) - matrix.shape[1]
    noise = float(np.sum(np.abs(right - matrix @ solution) ** 2)) / freedom
    spread = np.sum(np.abs(turned.conj().T / sizes) ** 2, axis=1) / scale**2
    at = np.arange(u) * (DEGREE + 1)
    return solution[at], noise * spread[at]
