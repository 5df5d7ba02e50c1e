"""(z·I − A)⁻¹ at many z from one Schur form of A: a back substitution a frequency in place of a factorisation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import matrix_balance, schur


@dataclass(frozen=True)
class Resolvent:
    """A = V·T·V⁻¹ with T upper triangular, all (x, x) and complex; see :func:`resolvent`."""

    T: np.ndarray
    V: np.ndarray
    inverse: np.ndarray

    def columns(self, z: np.ndarray, B: np.ndarray) -> np.ndarray:
        """(z·I − A)⁻¹·B, (f, x, u), for z (f,) and B (x, u) or (f, x, u)."""
        x, u = B.shape[-2:]
        turned = np.moveaxis(np.broadcast_to(self.inverse @ B, (len(z), x, u)), 0, 1).reshape(x, -1)
        columns = _substituted(self.T[::-1, ::-1], np.repeat(z, u), turned[::-1])[::-1]
        return np.moveaxis((self.V @ columns).reshape(x, len(z), u), 1, 0)

    def rows(self, z: np.ndarray, C: np.ndarray) -> np.ndarray:
        """C·(z·I − A)⁻¹, (f, k, x), for z (f,) and C (k, x)."""
        k, x = C.shape
        turned = np.tile((C @ self.V).T, len(z))
        rows = _substituted(self.T.T, np.repeat(z, k), turned)
        return np.moveaxis((self.inverse.T @ rows).reshape(x, len(z), k), 0, 2)


BLOCK = 16  # rows (speed only): what comes before a block is one product of matrices


def _substituted(L: np.ndarray, z: np.ndarray, right: np.ndarray) -> np.ndarray:
    """(z·I − L)⁻¹·right, (x, c), for L (x, x) lower triangular and a z of each column (c,)."""
    found = np.empty(right.shape, complex)
    for begin in range(0, len(L), BLOCK):
        rows = slice(begin, begin + BLOCK)
        found[rows] = right[rows] + L[rows, :begin] @ found[:begin]
        for i in range(begin, min(begin + BLOCK, len(L))):
            found[i] = (found[i] + L[i, begin:i] @ found[begin:i]) / (z - L[i, i])
    return found


def resolvent(A: np.ndarray) -> Resolvent:
    """The Schur form of a matrix (x, x), balanced: states in N·m and rad/s are of very different size."""
    balanced, (scale, _) = matrix_balance(A, permute=False, separate=True)
    T, Q = schur(balanced, output="complex")
    return Resolvent(T, scale[:, None] * Q, Q.conj().T / scale)


def transfer(A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray, s: np.ndarray) -> np.ndarray:
    """C·(sI − A)⁻¹·B + D at complex s (f,): (f, y, u)."""
    return C @ resolvent(A).columns(np.asarray(s), B) + D


@dataclass(frozen=True)
class Resolvents:
    """:class:`Resolvent` of many matrices (b, x, x), side by side."""

    T: np.ndarray
    V: np.ndarray
    inverse: np.ndarray

    def columns(self, z: np.ndarray, B: np.ndarray) -> np.ndarray:
        """(z·I − A)⁻¹·B, (b, f, x, u), for z (f,) and B (b, x, u)."""
        (b, x, u), f = B.shape, len(z)
        turned, found = self.inverse @ B, np.empty((b, x, f, u), complex)
        for i in range(x - 1, -1, -1):
            after = found[:, i + 1 :].reshape(b, -1, f * u)
            known = (self.T[:, i, None, i + 1 :] @ after).reshape(b, f, u)
            found[:, i] = (turned[:, i, None] + known) / (z[:, None] - self.T[:, i, i, None, None])
        columns = (self.V @ found.reshape(b, x, f * u)).reshape(b, x, f, u)
        return np.moveaxis(columns, 1, 2)


def resolvents(A: np.ndarray) -> Resolvents:
    """The Schur forms of matrices (b, x, x)."""
    forms = [resolvent(one) for one in A]
    return Resolvents(*(np.stack([getattr(form, name) for form in forms]) for name in ("T", "V", "inverse")))
