"""Masses and springs of small oscillations: each element a coefficient and a row over the coordinates.

M = Σ J·sᵀs and K = Σ c·tᵀt (paper Eqs. 4 and 5), so energies by component come for free and a batch is one product.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np
import scipy

from modelling.equations.casadi_code import Model
from modelling.errors import InputError

CLOSED_BY_RAD = 1e-9  # rad past the edge of a lash, so that it is closed
LARGEST_DENSE = 600  # degrees of freedom; dense matrices of more take minutes and gigabytes


@dataclass(frozen=True)
class Elements:
    """Elements of a model at parameter sets (b, p); k masses, s springs.

    Attributes
    ----------
    masses, springs : tuple of str
        Component names.
    J, stiffness : ndarray (b, k), (b, s)
        kg·m², N·m/rad; the stiffness is the tangent at the state.
    mass_transformation, spring_transformation : ndarray (k, n), (s, n) or (b, k, n), (b, s, n)
        Speed of every mass and twist of every spring for unit coordinates; with b where ratios vary.
    deflection_jacobian : ndarray (s, x)
        Deflection of every spring for unit states; differs from the twist where a damper sits in series.
    """

    masses: tuple[str, ...]
    springs: tuple[str, ...]
    J: np.ndarray
    stiffness: np.ndarray
    mass_transformation: np.ndarray
    spring_transformation: np.ndarray
    deflection_jacobian: np.ndarray

    def mass_matrix(self) -> np.ndarray:
        """M (b, n, n), kg·m²."""
        return _weighted(self.J, self.mass_transformation)

    def stiffness_matrix(self) -> np.ndarray:
        """K (b, n, n), N·m/rad."""
        return _weighted(self.stiffness, self.spring_transformation)

    def rigid(self) -> np.ndarray:
        """Number of rigid-body modes (b,): directions in which no spring twists, by structure, not size."""
        n = self.spring_transformation.shape[-1]
        holds = self.stiffness != 0
        if (holds == holds[0]).all():
            return np.full(len(holds), n - rank(self._one_twists()[holds[0]]))
        patterns, case = np.unique(holds, axis=0, return_inverse=True)
        counts = np.array([n - rank(self._one_twists()[pattern]) for pattern in patterns])
        return counts[case.reshape(-1)]

    def _one_twists(self) -> np.ndarray:
        return self.spring_transformation if self.spring_transformation.ndim == 2 else self.spring_transformation[0]


def rank(rows: np.ndarray | scipy.sparse.sparray) -> int:
    """Rank of rows (r, n), dense or sparse, each taken to length one, by elimination that keeps to what is not zero.

    Rows of a drivetrain have a few entries each, so the work grows with their number, where an SVD takes its cube.
    """
    pivots: dict[int, dict[int, float]] = {}  # column → the other entries of its row, where its own is 1
    for entries in _entries(rows):
        while (column := next((j for j in entries if j in pivots), None)) is not None:
            value = entries.pop(column)
            for j, other in pivots[column].items():
                entries[j] = entries.get(j, 0.0) - value * other
        largest = max(entries, key=lambda j: abs(entries[j]), default=None)
        if largest is not None and abs(entries[largest]) > 1e-9:
            value = entries.pop(largest)
            pivots[largest] = {j: other / value for j, other in entries.items() if abs(other) > 1e-12}
    return len(pivots)


def _entries(rows: np.ndarray | scipy.sparse.sparray) -> Iterator[dict[int, float]]:
    """What is not zero in each row (r, n), by column, at length one."""
    if isinstance(rows, np.ndarray):
        for row in unit_rows(rows):
            columns = np.flatnonzero(row)
            yield dict(zip(columns.tolist(), row[columns].tolist(), strict=True))
        return
    scaled = scipy.sparse.csr_array(rows)
    for i, length in enumerate(np.sqrt(scaled.power(2).sum(axis=1))):
        part = slice(scaled.indptr[i], scaled.indptr[i + 1])
        yield dict(zip(scaled.indices[part].tolist(), (scaled.data[part] / length).tolist(), strict=True))


def unit_rows(rows: np.ndarray) -> np.ndarray:
    """Rows (r, n) at length one; nothing of a shaft that a rigid gear beside it does not let twist."""
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    twists = length > 1e-14 * length.max(initial=0.0)
    return np.where(twists, rows / np.where(twists, length, 1.0), 0.0)


def null_space(rows: np.ndarray) -> np.ndarray:
    """Orthonormal basis (n, r) of the directions that rows (k, n) of length one do not see."""
    _, sizes, across = np.linalg.svd(rows)
    return across[int(np.sum(sizes > 1e-9)) :].T


def check_size(model: Model) -> None:
    """Check that dense matrices of a model are affordable.

    Raises
    ------
    InputError
        If it has more than :data:`LARGEST_DENSE` degrees of freedom.
    """
    if model.n > LARGEST_DENSE:
        raise InputError(
            "inertias",
            f"the model has {model.n} degrees of freedom, too many for this calculation",
            f"at most {LARGEST_DENSE}; undamped modes are found of more",
        )


def elements(model: Model, p: np.ndarray, x: np.ndarray | None = None) -> Elements:
    """Elements at parameter sets.

    Parameters
    ----------
    p : ndarray (b, p)
    x : ndarray (x,) or (b, x), optional
        State about which springs are tangent; at rest with lash just closed (:func:`rest_state`) if not given.
    """
    check_size(model)
    x = rest_state(model, p) if x is None else np.asarray(x, float)
    function, a = model.elements, model.equations.assembly
    first = [out.full() for out in function(x if x.ndim == 1 else x[0], p[0])]
    varies = np.ptp(p, axis=0) > 0 if len(p) > 1 else np.zeros(p.shape[1], bool)
    turns, twists = first[1], first[3]
    if len(p) == 1:
        J, stiffness = first[0].T, first[2].T
    else:
        states = np.broadcast_to(x, (len(p), x.shape[-1])).T
        weights = model.element_weights.map(len(p))(states, p.T)
        J, stiffness = weights[0].full().T, weights[1].full().T
        if np.any(varies & (first[5].ravel() > 0)):
            mapped = function.map(len(p))(states, p.T)
            turns, twists = (_unstacked(mapped[i], len(p)) for i in (1, 3))
    return Elements(tuple(a.masses), tuple(a.springs), J, stiffness, turns, twists, first[4])


def rest_state(model: Model, p: np.ndarray) -> np.ndarray:
    """State at rest, (x,) or with lash (b, x): every lash just closed in the driving direction, all else zero."""
    gaps, size = model.system.free_plays, len(model.states)
    if not gaps:
        return np.zeros(size)
    check_size(model)
    p = np.atleast_2d(p)
    function, springs = model.elements, list(model.equations.assembly.springs)
    twists, deflections = (out.full() for out in (function(np.zeros(size), p[0])[i] for i in (3, 4)))
    wanted = np.zeros((len(p), len(springs)))
    for name, gap in gaps.items():
        wanted[:, springs.index(name)] = p[:, model.parameters.index(gap)] / 2 + CLOSED_BY_RAD
    return _deflected(twists, deflections, wanted, model.n)


def with_lash_closed(model: Model, p: np.ndarray, x: np.ndarray) -> np.ndarray:
    """A state (x,) at parameters (p,) with every lash that is open there just closed in the driving direction."""
    gaps, springs = model.system.free_plays, list(model.equations.assembly.springs)
    if not gaps:
        return x
    twists, deflections = (out.full() for out in (model.elements(x, p)[i] for i in (3, 4)))
    wanted = np.zeros((1, len(springs)))
    for name, gap in gaps.items():
        i, edge = springs.index(name), p[model.parameters.index(gap)] / 2 + CLOSED_BY_RAD
        if abs(deflections[i] @ x) < edge:
            wanted[0, i] = edge - deflections[i] @ x
    return np.asarray(x + _deflected(twists, deflections, wanted, model.n)[0])


def _deflected(twists: np.ndarray, deflections: np.ndarray, wanted: np.ndarray, n: int) -> np.ndarray:
    """States (b, x) with wanted deflections (b, springs), by rows of twists (…, n) and of deflections (…, x)."""
    x = np.zeros((len(wanted), deflections.shape[1]))
    x[:, :n] = wanted @ np.linalg.pinv(twists).T
    for i in range(len(twists)):  # a spring behind a damper in series has a deflection of its own
        if not deflections[i, :n].any():
            x[:, np.flatnonzero(deflections[i])] = wanted[:, [i]]
    return x


def _unstacked(stacked: ca.DM, count: int) -> np.ndarray:
    full = stacked.full()
    return full.reshape(full.shape[0], count, -1).transpose(1, 0, 2)


def _weighted(weights: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Σ weight·rowᵀrow over the rows, (b, n, n)."""
    n = rows.shape[-1]
    if rows.ndim == 2 and len(weights) > 1 and rows.size * n < 1e6:
        return (weights @ (rows[:, :, None] * rows[:, None, :]).reshape(len(rows), n * n)).reshape(-1, n, n)
    across = np.swapaxes(rows, -1, -2)
    return (across * weights[:, None, :]) @ rows


# --- Masses and springs of a model of many degrees of freedom, as sparse matrices.


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
        return _weighted_sparse(self.J[0], self.mass_transformation)

    def stiffness_matrix(self) -> scipy.sparse.csc_array:
        """K (n, n), N·m/rad."""
        return _weighted_sparse(self.stiffness[0], self.spring_transformation)

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


def _weighted_sparse(weights: np.ndarray, rows: scipy.sparse.csr_array) -> scipy.sparse.csc_array:
    return scipy.sparse.csc_array(rows.T @ scipy.sparse.diags_array(weights) @ rows)
