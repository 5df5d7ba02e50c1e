"""Masses and springs of a model of many degrees of freedom, as sparse matrices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from modelling.equations.compiled import Model
from modelling.linear.elements import CLOSED_BY_RAD, rank


@dataclass(frozen=True)
class SparseElements:
    """Elements as in :class:`modelling.linear.elements.Elements`, of one parameter set (b = 1); k masses, s springs.

    Attributes
    ----------
    masses, springs : tuple of str
    J, stiffness : ndarray (1, k), (1, s)
        kg·m², N·m/rad.
    mass_transformation, spring_transformation : sparse array (k, n), (s, n)
    """

    masses: tuple[str, ...]
    springs: tuple[str, ...]
    J: np.ndarray
    stiffness: np.ndarray
    mass_transformation: scipy.sparse.csr_array
    spring_transformation: scipy.sparse.csr_array

    def mass_matrix(self) -> scipy.sparse.csc_array:
        """M (n, n), kg·m²."""
        return _weighted(self.J[0], self.mass_transformation)

    def stiffness_matrix(self) -> scipy.sparse.csc_array:
        """K (n, n), N·m/rad."""
        return _weighted(self.stiffness[0], self.spring_transformation)

    def rigid(self) -> np.ndarray:
        """Number of rigid-body modes (1,): directions in which no spring twists, by structure, not size."""
        twists = self.spring_transformation[np.flatnonzero(self.stiffness[0])]
        return np.array([self.mass_transformation.shape[1] - rank(twists)])


def sparse_elements(model: Model, p: np.ndarray, x: np.ndarray | None = None) -> SparseElements:
    """Elements at one parameter set (p,) and state (x,), by default at rest with lash just closed."""
    a = model.equations.assembly
    J, turns, stiffness, twists, *_ = _evaluated(model, _rest_state(model, p) if x is None else x, p)
    return SparseElements(tuple(a.masses), tuple(a.springs), J.toarray().T, stiffness.toarray().T, turns, twists)


def _evaluated(model: Model, x: np.ndarray, p: np.ndarray) -> list[scipy.sparse.csr_array]:
    return [scipy.sparse.csr_array(out.sparse()) for out in model.elements(x, p)]


def _rest_state(model: Model, p: np.ndarray) -> np.ndarray:
    """State at rest (x,) with every lash just closed: the deflections that are wanted, by least squares."""
    x = np.zeros(len(model.states))
    gaps = model.system.free_plays
    if gaps:
        deflections = _evaluated(model, x, p)[4]
        springs = {name: i for i, name in enumerate(model.equations.assembly.springs)}
        wanted = np.zeros(len(springs))
        for name, gap in gaps.items():
            wanted[springs[name]] = p[model.parameters.index(gap)] / 2 + CLOSED_BY_RAD
        x = scipy.sparse.linalg.lsqr(deflections, wanted, atol=1e-14, btol=1e-14, iter_lim=4 * len(x))[0]
    return x


def _weighted(weights: np.ndarray, rows: scipy.sparse.csr_array) -> scipy.sparse.csc_array:
    return scipy.sparse.csc_array(rows.T @ scipy.sparse.diags_array(weights) @ rows)
