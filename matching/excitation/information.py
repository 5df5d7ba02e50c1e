"""Fisher information of a recording about what is uncertain, and the spectrum that makes the most of it."""

from __future__ import annotations

import numpy as np

from matching.excitation.recorded_bed import RecordedBed
from matching.frequency.case.uncertainty import Box

STEP = 0.1  # of a half-width, for central differences
PRIOR = 3.0  # information of an even distribution over ±1: one over its variance
ROUNDS = 200  # of the multiplicative algorithm
AT_ONCE = 4000  # frequencies
FAINT = 1e-3  # of the largest spectral line: what is smaller tells nothing


def sensitivities(bed: RecordedBed, box: Box, frequencies: np.ndarray) -> np.ndarray:
    """Derivatives (p, f, y, u) of the responses by each quantity in half-widths, over the noise of the sensors.

    ``frequencies`` (f,) are in Hz.
    """
    p = len(box.uncertain)
    slopes = []
    for i in range(p):
        above, below = (bed.response(box.at(sign * STEP * np.eye(p)[i]), frequencies) for sign in (1, -1))
        slopes.append((above - below) / (2 * STEP))
    return np.stack(slopes) / bed.noise[:, None]


def information(bed: RecordedBed, box: Box, inputs: np.ndarray, step: float, lowest: float) -> np.ndarray:
    """Fisher information (p, p) of a recording with inputs (t, u) at steps (s), noise white (Ljung 1999, eq. 9.29).

    What lies below ``lowest`` (Hz) is left out: the unknown start takes it.
    """
    spectrum = np.fft.rfft(inputs, axis=0)
    f = np.fft.rfftfreq(len(inputs), step)
    power = np.abs(spectrum).max(axis=1)
    used = np.flatnonzero((f >= lowest) & (power > FAINT * power.max()))
    p = len(box.uncertain)
    total = np.zeros((p, p))
    for begin in range(0, len(used), AT_ONCE):
        part = used[begin : begin + AT_ONCE]
        answers = np.einsum("pfyu,fu->pfy", sensitivities(bed, box, f[part]), spectrum[part])
        flat = answers.reshape(p, -1)
        total += 2 / len(inputs) * np.real(flat.conj() @ flat.T)
    return total


def line_information(bed: RecordedBed, box: Box, lines: np.ndarray, of_input: np.ndarray, count: int) -> np.ndarray:
    """Information (l, p, p) of ``count`` samples of a sine, mean square 1 (N·m)², at each line (l,) in Hz."""
    slopes = sensitivities(bed, box, lines)
    of_lines = slopes[:, np.arange(len(lines)), :, of_input]  # (l, p, y): NumPy puts the paired axis first
    return count * np.real(np.einsum("lpy,lqy->lpq", of_lines.conj(), of_lines))


def optimal_powers(lines: np.ndarray, of_input: np.ndarray, weights: np.ndarray, budget: np.ndarray) -> np.ndarray:
    """Mean squares (l,) of the lines, each input's adding up to its budget (u,), that minimise tr(W·(F + prior)⁻¹).

    Multiplicative algorithm (Silvey, Titterington and Torsney 1978; Yu 2010), which converges on this convex problem.

    Parameters
    ----------
    lines : ndarray (l, p, p)
        Information of each line with mean square 1.
    of_input : ndarray (l,)
    weights : ndarray (p, p)
    """
    powers = np.zeros(len(lines))
    for j, allowance in enumerate(budget):
        mine = of_input == j
        powers[mine] = allowance / max(mine.sum(), 1)
    prior = PRIOR * np.eye(len(weights))
    for _ in range(ROUNDS):
        inverse = np.linalg.inv(prior + np.tensordot(powers, lines, 1))
        gain = np.einsum("pq,lqp->l", inverse @ weights @ inverse, lines)
        for j, allowance in enumerate(budget):
            mine = of_input == j
            moved = powers[mine] * np.sqrt(np.maximum(gain[mine], 0.0))
            if moved.sum() > 0:
                powers[mine] = allowance * moved / moved.sum()
    return powers
