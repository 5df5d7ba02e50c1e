"""Padé approximations of a dead time as chains of all-pass sections, well conditioned at any order."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import scipy
from scipy.linalg import block_diag


def pade(delay: float, order: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """A (n, n), B (n,), C (n,), D of the diagonal Padé approximation of e^(−s·delay), one input, one output.

    Its poles are those of the Bessel filter: the denominator is the reverse Bessel polynomial in s·delay/2. Each pair
    of poles is one all-pass section in companion form with time in units of its own corner frequency.
    """
    poles = _poles(order) / delay
    A, B, C, D = np.zeros((0, 0)), np.zeros(0), np.zeros(0), 1.0
    for pole in poles[poles.imag >= 0]:
        a, b, c, d = _section(pole)
        # in series: what leaves the chain so far enters the section
        A = np.block([[A, np.zeros((len(A), len(a)))], [np.outer(b, C), a]])
        B, C, D = np.concatenate([B, b * D]), np.concatenate([d * C, c]), d * D
    return A, B, C, D


@lru_cache
def _poles(order: int) -> np.ndarray:
    """Poles (n,) of the approximation of e^(−s)."""
    return 2 * np.asarray(scipy.signal.besselap(order, norm="delay")[1])


def _section(pole: complex) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """(p* + s)/(p − s)-type all-pass of a real pole or a conjugate pair."""
    if abs(pole.imag) <= 1e-9 * abs(pole):
        rate = -pole.real  # (rate − s)/(rate + s) = −1 + 2·rate/(s + rate)
        return np.array([[-rate]]), np.array([rate]), np.array([2.0]), -1.0
    corner, decay = abs(pole), -2 * pole.real  # 1 − 2·decay·s/(s² + decay·s + corner²)
    A = np.array([[0.0, corner], [-corner, -decay]])
    return A, np.array([0.0, decay]), np.array([0.0, -2.0]), 1.0


def parallel(delay: float, order: int, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The same for ``count`` signals at once, delayed by s: A (count·n, count·n), B, C, D; only D = 1 without delay."""
    if delay <= 0:
        return np.zeros((0, 0)), np.zeros((0, count)), np.zeros((count, 0)), np.eye(count)
    A, B, C, D = pade(delay, order)
    many = [A] * count, [B[:, None]] * count, [C[None]] * count
    return block_diag(*many[0]), block_diag(*many[1]), block_diag(*many[2]), D * np.eye(count)


def phase_error(delay: float, order: int, frequencies: np.ndarray) -> np.ndarray:
    """Phase (f,) in rad by which the approximation is off at frequencies (f,), Hz; its gain is 1 everywhere."""
    omega = 2 * np.pi * np.asarray(frequencies)
    if delay <= 0:
        return np.zeros_like(omega)
    poles = _poles(order) / delay
    # all-pass: twice the phase of the denominator, summed pole by pole so that it never wraps
    lag = 2 * np.arctan2(omega[:, None] - poles.imag, -poles.real).sum(axis=1)
    return np.abs(omega * delay - lag)


def good_up_to(delay: float, order: int, error: float) -> float:
    """Frequency in Hz below which the phase error stays under ``error`` (rad)."""
    if delay <= 0:
        return np.inf
    frequencies = np.linspace(0.01, 1.0, 2000) * order / delay
    off = np.flatnonzero(phase_error(delay, order, frequencies) > error)
    return float(frequencies[off[0]]) if len(off) else float(frequencies[-1])
