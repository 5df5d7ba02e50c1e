"""Stability by encirclements and the modulus margin, on the loop with its exact dead time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from matching.frequency.loop.exact_loop import ExactLoop
from matching.frequency.loop.parts import Parts
from matching.frequency.loop.poles import RESTING_BELOW

LOWEST, HIGHEST = 1e-4, 5e3  # Hz
STEP = 0.3  # rad: largest phase step of det(I + L) that is believed
MOST_FREQUENCIES = 200_000  # frequencies
STEPS_A_ROUND, ROUNDS = 16, 7  # about a minimum of the margin: 8⁻⁷ = 5e-7 of the interval between grid points is left

Difference = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Encirclements:
    """What the return difference I + L(jω) says.

    Attributes
    ----------
    unstable : int
        Closed-loop poles in the right half plane.
    open_loop_unstable : int
        Those of the open loop, which were counted by its matrices.
    resting : int
        Closed-loop poles at 0.
    remainder : float
        By how much the winding missed a whole number; 0.5 where a pole stands on the imaginary axis elsewhere.
    modulus_margin : float
        Least singular value of I + L from where it counts on: least distance from −1 of a loop of one dynamometer.
    margin_frequency : float
        Hz, where it is reached.
    gain_edge : float
        Hz, above which the loop gain stays below a half: what happens to the phase beyond does not matter.
    frequencies : ndarray (f,)
        Hz, those that were needed.
    """

    unstable: int
    open_loop_unstable: int
    resting: int
    remainder: float
    modulus_margin: float
    margin_frequency: float
    gain_edge: float
    frequencies: np.ndarray

    @property
    def clear(self) -> bool:
        """Whether the winding is a whole number."""
        return abs(self.remainder) < 0.1


def encirclements(parts: Parts, dead_time: float | None = None, margin_from: float = 0.0) -> Encirclements:
    """Count encirclements and find the margin of a case's feedback loop, from ``margin_from`` (Hz) on."""
    loop = ExactLoop(parts, dead_time)
    open_loop = np.concatenate(
        [np.linalg.eigvals(part.space.A) for part in parts.residual] + [np.linalg.eigvals(parts.rig.space.A)]
    )
    resting = int(np.sum(np.abs(open_loop) < RESTING_BELOW))
    resting += parts.case.loop.structure.integrators(parts.case.loop.values) * len(parts.dynamometers)
    right = int(np.sum((open_loop.real > 1e-9) & (np.abs(open_loop) >= RESTING_BELOW)))
    corners = np.abs(open_loop[open_loop.imag > 0]) / (2 * np.pi)
    return count(loop.return_difference, right, resting, loop.dead_time, corners, margin_from)


def count(
    difference: Difference, right: int, resting: int, delay: float, corners: np.ndarray, margin_from: float = 0.0
) -> Encirclements:
    """Encirclements of the origin by det(I + L) along the imaginary axis.

    The winding is that of det(I + L)·(s/(s + 1))^r, r the open loop's poles at 0, so that neither end has a pole:
    1 at s → ∞, c·s^m at s → 0 with m closed-loop poles there, and its phase turns by −π·(unstable − right) − m·π/2 in
    between (Nyquist, the contour passing 0 on its right).

    Parameters
    ----------
    difference : callable
        s (f,) → I + L (f, k, k).
    right, resting : int
        Poles of the open loop in the right half plane and at 0.
    delay : float
        s; the grid resolves its turning phase.
    corners : ndarray
        Hz, where the open loop resonates: the grid starts finer there.
    margin_from : float
        Hz, from where on the modulus margin counts.
    """
    frequencies = np.union1d(_grid(delay, corners, _top(difference)), [margin_from] if margin_from > 0 else [])
    values = difference(2j * np.pi * frequencies)
    while True:
        s = 2j * np.pi * frequencies
        curve = np.linalg.det(values) * (s / (s + 1)) ** resting
        step = np.angle(curve[1:] / curve[:-1])
        wide = np.flatnonzero((np.abs(step) > STEP) & (np.diff(frequencies) > 1e-9 * frequencies[1:]))
        if not len(wide) or len(frequencies) > MOST_FREQUENCIES:
            break
        new = np.sqrt(frequencies[wide] * frequencies[wide + 1])
        values = np.insert(values, wide + 1, difference(2j * np.pi * new), axis=0)
        frequencies = np.insert(frequencies, wide + 1, new)
    slope = np.log(np.abs(curve[1] / curve[0])) / np.log(frequencies[1] / frequencies[0])
    left = round(float(slope))
    unstable = right - step.sum() / np.pi - left / 2
    remainder = 0.5 if len(wide) or np.abs(step).max() > STEP else float(unstable - round(unstable))
    first = min(int(np.searchsorted(frequencies, margin_from)), len(frequencies) - 1)
    margin, where = modulus_margin(difference, frequencies[first:], values[first:])
    gaining = frequencies[_gain(values) > 0.5]
    edge = float(gaining.max(initial=LOWEST))
    return Encirclements(round(unstable), right, left, remainder, margin, where, edge, frequencies)


def _gain(values: np.ndarray) -> np.ndarray:
    """Largest singular value (f,) of L for I + L (f, k, k)."""
    return np.linalg.norm(values - np.eye(values.shape[-1]), 2, axis=(1, 2))


def _top(difference: Difference) -> float:
    """Frequency in Hz up to where the loop is followed: 5 kHz, or more until its gain has gone."""
    top = HIGHEST
    while top < 1e6 and _gain(difference(np.array([2j * np.pi * top])))[0] > 0.05:
        top *= 2
    return top


def _grid(delay: float, corners: np.ndarray, top: float) -> np.ndarray:
    parts = [np.geomspace(LOWEST, top, 500)]
    parts.append(np.array([1e-7, 1e-6, 1e-5]))  # so low that the curve begins on the real axis
    near = np.concatenate([-np.geomspace(0.3, 1e-4, 12), [0.0], np.geomspace(1e-4, 0.3, 12)])
    parts += [corner * (1 + near) for corner in corners]
    if delay > 0:
        parts.append(np.linspace(LOWEST, top, int(min(top * delay * 2 * np.pi / STEP + 2, MOST_FREQUENCIES / 10))))
    grid = np.unique(np.concatenate(parts))
    return grid[(grid > 0) & (grid <= top)]


def modulus_margin(difference: Difference, frequencies: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """Least singular value of I + L and its frequency in Hz, refined about the five lowest minima of a grid.

    Parameters
    ----------
    difference : callable
        s (n,) → I + L (n, k, k).
    frequencies, values : ndarray (f,), (f, k, k)
        Hz, and the same there.
    """
    sizes = np.linalg.svd(values, compute_uv=False)[:, -1]
    padded = np.concatenate([[np.inf], sizes, [np.inf]])
    minima = np.flatnonzero((sizes <= padded[:-2]) & (sizes <= padded[2:]))
    lowest = minima[np.argsort(sizes[minima])][:5]
    before, after = frequencies[np.maximum(lowest - 1, 0)], frequencies[np.minimum(lowest + 1, len(sizes) - 1)]
    least, where = _refined(difference, np.log(before), np.log(after))
    best = int(np.argmin(least))
    return float(least[best]), float(where[best])


def _refined(difference: Difference, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least singular values (m,) in intervals of the logarithm of the frequency, and where in Hz.

    All intervals are searched at once: each round keeps the two steps about the lowest of its points.
    """
    rows = np.arange(len(low))
    for _ in range(ROUNDS):
        grid = np.linspace(low, high, STEPS_A_ROUND + 1, axis=-1)
        values = difference(2j * np.pi * np.exp(grid.ravel()))
        sizes = np.linalg.svd(values, compute_uv=False)[:, -1].reshape(grid.shape)
        lowest = np.argmin(sizes, axis=1)
        low, high = grid[rows, np.maximum(lowest - 1, 0)], grid[rows, np.minimum(lowest + 1, STEPS_A_ROUND)]
    return sizes[rows, lowest], np.exp(grid[rows, lowest])
