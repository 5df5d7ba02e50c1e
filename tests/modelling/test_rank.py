"""The rank that counts rigid-body modes, against a singular value decomposition."""

import numpy as np
import pytest

from modelling.linear.elements import rank


@pytest.mark.parametrize("seed", range(40))
def test_rank_of_sparse_rows(seed):
    """Springs between random pairs, some twice, some in loops that close or do not, some in series with ratios."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 14))
    rows = np.zeros((int(rng.integers(1, 20)), n))
    for row in rows:
        columns = rng.choice(n, min(int(rng.integers(1, 4)), n), replace=False)
        row[columns] = rng.choice([1.0, -1.0, 2.0, -3.5, 1e-3], len(columns))
    rows = np.vstack([rows, 7.0 * rows[:1], rows[:1] - 2.0 * rows[-1:]])
    rows = rows[np.linalg.norm(rows, axis=1) > 0]
    expected = np.linalg.matrix_rank(rows / np.linalg.norm(rows, axis=1, keepdims=True), tol=1e-9)
    assert rank(rows) == expected


def test_a_long_chain_has_one_rigid_motion_and_a_loop_of_gears_that_close_too():
    n = 400
    rows = np.zeros((n - 1, n))
    rows[range(n - 1), range(n - 1)], rows[range(n - 1), range(1, n)] = 1 / 3.7, -1.0
    assert rank(rows) == n - 1
    closing = np.zeros((1, n))
    closing[0, 0], closing[0, 5] = 1 / 3.7**5, -1.0
    assert rank(np.vstack([rows, closing])) == n - 1
    closing[0, 5] = -1.001
    assert rank(np.vstack([rows, closing])) == n
    assert rank(np.zeros((0, 3))) == 0
