"""Eigenvalues of many matrices, on all cores."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from modelling.common.cores import threads

WORTH_THREADS = 2e6  # sum of the cubes of the orders (speed only; 3 ms on one core)


def eigenvalues(matrices: np.ndarray) -> np.ndarray:
    """Eigenvalues (b, n) of matrices (b, n, n).

    LAPACK leaves Python's lock while it works, so threads share the matrices. None is left over: what has threads
    cannot be forked.

    Raises
    ------
    numpy.linalg.LinAlgError
        If a matrix has entries that are not finite.
    """
    parts = min(threads(), len(matrices)) if matrices.size * matrices.shape[-1] > WORTH_THREADS else 1
    if parts < 2:
        values: np.ndarray = np.linalg.eigvals(matrices)
        return values
    with ThreadPoolExecutor(parts) as pool:
        return np.concatenate(list(pool.map(np.linalg.eigvals, np.array_split(matrices, parts))))
