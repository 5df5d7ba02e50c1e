"""Means over a frequency band on a logarithmic scale, and where responses change fast.

Quadrature on panels that are halved until it converges.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
import scipy
from scipy.linalg import eigvals

from modelling.linear.state_space import StateSpace

CONVERGED = 0.01  # relative: largest estimated error of a mean square, so half of it in its root
FIRST_PANELS = 8  # of the band before any is halved, beside those that resonances begin
MOST_HALVINGS = 400  # reached only where a response has a pole or zero on the frequency axis itself
NARROWEST = 2e-3  # relative width of a first panel: resonances closer together begin one
GAUSS_NODES, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(7)  # of the Gauss-Kronrod pair 7, 15
NEGLIGIBLE = 1e-12  # mean square, below which nothing has to converge: a response error of 1e-6


@dataclass(frozen=True)
class BandNodes:
    """Frequencies (f,) in Hz and weights (f,), sum 1: Σ weight·value is the mean over the logarithm of frequency."""

    frequencies: np.ndarray
    weights: np.ndarray

    def root_mean(self, squares: np.ndarray) -> np.ndarray:
        """Root of the mean over the band of squares (f, …)."""
        return np.sqrt(np.tensordot(self.weights, squares, 1))


def converged_nodes(
    band: tuple[float, float], squares: Callable[[np.ndarray], np.ndarray], breaks: Iterable[float] = ()
) -> BandNodes:
    """Nodes at which the mean of every column of ``squares`` has converged to :data:`CONVERGED`.

    Parameters
    ----------
    band : tuple of float
        Hz.
    squares : callable
        Frequencies (f,), Hz, → values (f, c), finite and not negative.
    breaks : iterable of float
        Hz, where values may change fast, such as resonances; those outside the band are left out.
    """
    low, high = np.log(band)
    inner = np.linspace(low, high, FIRST_PANELS + 1)[1:-1]
    marked = np.log([f for f in breaks if band[0] < f < band[1]])
    points = np.unique(np.concatenate([inner, marked]))
    points = points[np.diff(points, prepend=low) > NARROWEST]
    panels = scipy.integrate.cubature(
        lambda x: squares(np.exp(x[:, 0])), [low], [high], rule="gk15", rtol=CONVERGED,
        atol=NEGLIGIBLE * (high - low), max_subdivisions=MOST_HALVINGS, points=[np.array([point]) for point in points],
    ).regions  # fmt: skip
    middle = np.array([(panel.a[0] + panel.b[0]) / 2 for panel in panels])
    half = np.array([(panel.b[0] - panel.a[0]) / 2 for panel in panels])
    order = np.argsort(middle)
    nodes = middle[order, None] + half[order, None] * GAUSS_NODES
    weights = half[order, None] * GAUSS_WEIGHTS / (high - low)
    return BandNodes(np.exp(nodes.ravel()), weights.ravel())


def resonances(space: StateSpace) -> np.ndarray:
    """Natural frequencies (m,) of a system in Hz, without motions that do not swing."""
    return _swinging(np.linalg.eigvals(space.A))


def antiresonances(space: StateSpace, source: str, output: str) -> np.ndarray:
    """Frequencies (m,) in Hz of the zeros of one transfer function: eigenvalues of the Rosenbrock pencil."""
    n = len(space.A)
    through = space.D[space.outputs.index(output), space.inputs.index(source)]
    system = np.block([[space.A, space.input(source)[:, None]], [space.output(output)[None], np.array([[through]])]])
    zeros = eigvals(system, np.diag([1.0] * n + [0.0]))
    return _swinging(zeros[np.isfinite(zeros)])


def _swinging(values: np.ndarray) -> np.ndarray:
    """|s|/2π (m,) of the values with a positive imaginary part."""
    return np.abs(values[values.imag > 1e-9]) / (2 * np.pi)
