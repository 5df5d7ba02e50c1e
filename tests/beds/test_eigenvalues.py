"""Eigenvalues of many matrices: the same with any number of threads, in their order."""

import numpy as np
import pytest

from matching.match import beds as room


@pytest.mark.parametrize("threads", [1, 2, 3, 50])
def test_threads_share_the_matrices_and_change_nothing(threads, monkeypatch):
    matrices = np.random.default_rng(5).standard_normal((7, 90, 90))
    matrices[2] = np.diag(np.arange(90.0))  # real values among complex ones
    monkeypatch.setattr(room, "threads", lambda: threads)
    got = room.eigenvalues(matrices)
    assert got.shape == (7, 90)
    for matrix, values in zip(matrices, got, strict=True):
        np.testing.assert_allclose(values, np.linalg.eigvals(matrix), rtol=1e-9, atol=1e-9)


def test_entries_that_are_not_finite_are_an_error_in_threads_too(monkeypatch):
    monkeypatch.setattr(room, "threads", lambda: 2)
    matrices = np.zeros((7, 90, 90))
    matrices[5, 3, 3] = np.nan
    with pytest.raises(np.linalg.LinAlgError):
        room.eigenvalues(matrices)
