"""The lowest modes of a model of many degrees of freedom, by a sparse eigensolver, and a count that none is missing."""

from __future__ import annotations

import numpy as np
import scipy

from modelling.common.errors import InputError
from modelling.linear.sparse_elements import SparseElements

SHIFT = 1e-9  # of the largest ω²: below every elastic mode of a chain of some thousand inertias
LARGEST_REPEATED = 1500  # degrees of freedom for which dense matrices are tried
SPARE = 10  # modes more than asked for, so that the last ones asked for have converged


def lowest(parts: SparseElements, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The lowest ω² (1, m) and mass-normalised shapes (1, n, m) of K·v = ω²·M·v.

    Lanczos iterations with (K + shift·M)⁻¹, whose factors are as sparse as the drivetrain (ARPACK). The signs of the
    pivots of K − s·M count the modes below s (Sylvester's law of inertia), so a mode that was missed is noticed.

    Raises
    ------
    InputError
        If an inertia is not positive, the stiffness is negative, or modes are repeated too often.
    """
    if np.any(parts.J <= 0):
        raise InputError("", f"the inertia of {parts.masses[int(np.argmin(parts.J[0]))]} is not positive", "J > 0")
    mass, stiffness = parts.mass_matrix(), parts.stiffness_matrix()
    n = mass.shape[0]
    largest = float(np.max(abs(stiffness).sum(axis=1) / mass.diagonal(), initial=0.0))
    shift = SHIFT * largest if largest else 1.0
    if np.any(parts.stiffness < 0) and _below(stiffness, mass, -1e-11 * largest):
        raise InputError("", "the stiffness at this state is negative: no mode oscillates", "choose another state")
    inverse = _factors(stiffness + shift * mass)
    solve = scipy.sparse.linalg.LinearOperator((n, n), inverse.solve, dtype=float)
    start = np.random.default_rng(0).standard_normal(n)
    for spare in (SPARE, 4 * SPARE):
        size = min(count + spare, n - 2)
        squares, shapes = scipy.sparse.linalg.eigsh(
            stiffness, size, mass, sigma=-shift, OPinv=solve, v0=start, ncv=min(n, 3 * size)
        )
        order = np.argsort(squares)
        squares, shapes = squares[order], shapes[:, order]
        if _complete(stiffness, mass, squares, count):
            return squares[None, :count], shapes[None, :, :count]
    return _dense(stiffness, mass, count)


def _dense(
    stiffness: scipy.sparse.csc_array, mass: scipy.sparse.csc_array, count: int
) -> tuple[np.ndarray, np.ndarray]:
    """The same by dense matrices, for modes repeated so often that Lanczos iterations miss some: slow, but all."""
    if stiffness.shape[0] > LARGEST_REPEATED:
        raise InputError("inertias", "many equal branches give the same mode too often", "join equal branches to one")
    squares, shapes = scipy.linalg.eigh(stiffness.toarray(), mass.toarray(), subset_by_index=(0, count - 1))
    return squares[None], shapes[None]


def _complete(stiffness: scipy.sparse.csc_array, mass: scipy.sparse.csc_array, squares: np.ndarray, count: int) -> bool:
    """Whether all modes up to the widest gap after the ones asked for are among ω² (m,), in order."""
    gaps = np.diff(squares[count - 1 :])
    if not gaps.max(initial=0.0) > 1e-8 * squares[-1]:
        return False  # the last of them is repeated, or none is left to compare with
    last = count - 1 + int(np.argmax(gaps))
    return _below(stiffness, mass, (squares[last] + squares[last + 1]) / 2) == last + 1


def _below(stiffness: scipy.sparse.csc_array, mass: scipy.sparse.csc_array, square: float) -> int:
    """Number of modes with ω² below ``square``."""
    return int(np.sum(_factors(stiffness - square * mass).U.diagonal() < 0))


def _factors(matrix: scipy.sparse.csc_array) -> scipy.sparse.linalg.SuperLU:
    """LU factors with pivots from the diagonal, in an order that keeps them sparse."""
    return scipy.sparse.linalg.splu(
        scipy.sparse.csc_matrix(matrix),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
