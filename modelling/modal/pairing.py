"""Which mode is which: one to one, weighted by inertia, between two systems or between a system and its variants.

Every verdict that compares modes pairs them here: target modes with damped modes, with modes of the closed loop and
with those of the rig without control, modes over a changing parameter, and the modes of drawn beds with those of the
planned one. (A search, which asks at every step how far the poles are from the targets, takes the nearest ones.)
Two modes are never taken for one, whatever lies nearer: the sum of the scores of all pairs is largest
(Kuhn 1955, as :func:`scipy.optimize.linear_sum_assignment` solves it).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Protocol

import numpy as np
from scipy.optimize import linear_sum_assignment

from modelling.equations.casadi_code import compiled
from modelling.linear.elements import elements
from modelling.modal.modes import modes
from modelling.modal.result import Mode, Modes
from modelling.system import System

# --- Scores and pairs


def mac(first: np.ndarray, second: np.ndarray, weight: np.ndarray | None = None) -> np.ndarray:
    """Modal assurance criterion |v'Ww|²/(v'Wv · w'Ww), normalised: 0 … 1 whatever the scale of the shapes.

    Parameters
    ----------
    first, second : ndarray (n, m), (n, l)
        Shapes, real or complex.
    weight : ndarray (n, n), optional
        Positive definite; the mass matrix makes distinct modes of one system score 0. Default: the unit matrix
        (Allemang and Brown 1982).

    Returns
    -------
    ndarray (m, l)
    """
    weighted = second if weight is None else weight @ second
    other = first if weight is None else weight @ first
    norms = np.sum(np.conj(first) * other, axis=0).real[:, None] * np.sum(np.conj(second) * weighted, axis=0).real
    return np.abs(np.conj(first).T @ weighted) ** 2 / np.maximum(norms, 1e-300)


class Shaped(Protocol):
    """A mode: its frequency in Hz, and amplitudes by component."""

    @property
    def frequency(self) -> float:
        """Hz."""

    @property
    def shape(self) -> Mapping[str, complex]:
        """Amplitude of every inertia."""


def weighted_mac(first: Sequence[Shaped], second: Sequence[Shaped], inertia: Mapping[str, float]) -> np.ndarray:
    """:func:`mac` (m, l) over what all shapes hold, each coordinate weighted by its inertia, kg·m² (else 1)."""
    names = [name for name in first[0].shape if name in second[0].shape] if first and second else []
    if not names:
        return np.zeros((len(first), len(second)))
    a, b = (np.array([[mode.shape[name] for mode in modes] for name in names]) for modes in (first, second))
    return mac(a, b, np.diag([inertia.get(name, 1.0) for name in names]))


def pairs(score: np.ndarray, least: float = 0.0) -> Iterator[tuple[int, int]]:
    """Row and column of every pair, one to one, with the largest sum of scores (m, l); pairs up to ``least`` left out.

    A pair that may not be has a score of 0 or less.
    """
    for row, column in zip(*linear_sum_assignment(score, maximize=True), strict=True):
        if score[row, column] > least:
            yield int(row), int(column)


def closeness(first: complex | np.ndarray, second: complex | np.ndarray) -> np.ndarray:
    """exp(−|ln(second/first)|) of eigenvalues in the upper half plane, 1/s: 1 where they are equal, falling to 0."""
    near: np.ndarray = np.exp(-np.abs(np.log(np.asarray(second) / np.asarray(first))))
    return near


def followed(planned: np.ndarray, found: np.ndarray) -> np.ndarray:
    """For every planned eigenvalue (m,) that of a variant which it became (m,), 1/s; NaN where there is none left.

    Parameters
    ----------
    planned, found : ndarray (m,), (x,)
        Eigenvalues, 1/s; of the found ones those in the upper half plane are looked at.
    """
    swinging = found[found.imag > 0]
    became = np.full(len(planned), complex(np.nan, np.nan))
    for row, column in pairs(closeness(planned[:, None], swinging[None])):
        became[row] = swinging[column]
    return became


# --- The same hardware in two systems


def _energy_amplitudes(system: System) -> tuple[Modes, dict[str, np.ndarray]]:
    """Modes, and by component its amplitude (m,) in each: the signed root of its share of the energy."""
    found, model = modes(system), compiled(system)
    twists = elements(model, model.p0[None]).deflection_jacobian
    twists = twists.reshape(-1, twists.shape[-1])[:, : len(found.shapes)] @ found.shapes
    turning = np.sign(found.mass_amplitudes.real) * np.sqrt(found.kinetic.T)
    twisted = np.sign(twists) * np.sqrt(found.potential.T)
    return found, dict(zip((*found.masses, *found.springs), np.vstack([turning, twisted]), strict=True))


def same_hardware(first: System, second: System) -> tuple[Modes, Modes, np.ndarray]:
    """How far each mode of one system moves the parts that both have as each mode of the other does.

    Returns
    -------
    Modes, Modes
        Undamped modes of both.
    ndarray (m, l)
        0 … 1. The shared inertias turn and the shared shafts twist alike, each weighted by its energy: 1 where a mode
        of the second moves them just as that of the first and moves nothing else. Modes that are mirror images of
        another kind score 0 by themselves. A mode of the first that leaves the shared parts at rest scores 0, and so
        does a rigid motion.
    """
    (of_first, a), (of_second, b) = _energy_amplitudes(first), _energy_amplitudes(second)
    shared = [name for name in a if name in b]
    if not shared:
        return of_first, of_second, np.zeros((len(of_first), len(of_second)))
    mine, other = (np.stack([rows[name] for name in shared]) for rows in (a, b))
    moved = np.sum(mine**2, axis=0) / 2  # the share of all energy that the shared parts have
    alike = np.where(moved > LEAST_SHARED, 1.0, 0.0)[:, None] * (mine.T @ other / 2) ** 2
    alike = alike / np.maximum(moved, LEAST_SHARED)[:, None]
    elastic = (of_first.frequencies > 0)[:, None] & (of_second.frequencies > 0)
    return of_first, of_second, np.where(elastic, alike, 0.0)


LEAST_SHARED = 1e-6  # of a mode's energy: with less, what the shared parts do is rounding
LEAST_LIKENESS = 0.1  # of :func:`same_hardware`: with less a mode has no counterpart. Clear ones have 0.3 and more.


def counterparts(first: System, second: System, numbers: Sequence[int]) -> dict[int, Mode]:
    """By the number of a mode of one system the mode of the other that moves the shared parts like it, one to one.

    Only the modes with these numbers are paired, since the second system may have fewer modes than the first: a test
    bed has no body and no tyres. Modes without a counterpart are left out.
    """
    _, of_second, alike = same_hardware(first, second)
    chosen = alike[[number - 1 for number in numbers]]
    return {numbers[row]: of_second[column] for row, column in pairs(chosen, LEAST_LIKENESS)}


# --- A system and its damped self


FARTHEST_DAMPED = float(np.log(1.5))  # between a mode's damped and undamped frequency, logarithm
LEAST_SCORE = 1e-3  # of any pair that may be one mode, so that as many as possible are paired


def damped_counterparts(plain: Modes, damped: Modes, inertia: Mapping[str, float]) -> dict[int, Mode]:
    """By the number of an undamped mode the damped mode that it is, by shape and frequency; overdamped ones left out.

    Neighbours that lie 1 % apart may come in another order, or mix, once they are damped.
    """
    elastic = [mode for mode in plain if mode.frequency > 0]
    swinging = [mode for mode in damped if mode.frequency > 0 and mode.damping_ratio < 1]
    far = np.abs(np.log([[other.frequency / mode.frequency for other in swinging] for mode in elastic]))
    far = far.reshape(len(elastic), len(swinging))
    alike = np.array([[mode.symmetry == other.symmetry for other in swinging] for mode in elastic], bool)
    alike = alike.reshape(far.shape)
    score = LEAST_SCORE + weighted_mac(elastic, swinging, inertia) * np.exp(-far)
    score = np.where(alike & (far <= FARTHEST_DAMPED), score, 0.0)
    return {elastic[row].number: swinging[column] for row, column in pairs(score)}
