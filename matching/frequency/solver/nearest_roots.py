"""The closed loop's roots nearest to the targets, as eigenpairs in a decision vector.

The programme tracks one root for each target from wherever its start puts it. The error counts the distance to that
root, so a setting is judged rightly only if it is the nearest of those that move the dynamometers like the target.
"""

from __future__ import annotations

import numpy as np

from matching.frequency.case.tuned import apply
from matching.frequency.loop.exact_loop import ExactLoop
from matching.frequency.loop.parts import parts_of
from matching.frequency.loop.poles import ORDERS, closed_matrix
from matching.frequency.programme.problem import Problem, eigenpairs

LEAST_COSINE = 0.3  # cosine between a root's pattern over the dynamometers and the target's, from which it counts


def with_nearest_roots(problem: Problem, v: np.ndarray) -> np.ndarray:
    """Decisions (v,) with every eigenpair on the root nearest to its target, to the dead time's approximation."""
    v = v.copy()
    if not problem.goals:
        return v
    parts = parts_of(apply(problem.case, problem.values(v)))
    roots = np.linalg.eigvals(closed_matrix(parts, ORDERS[-1]))
    roots = roots[roots.imag >= 0]
    difference = ExactLoop(parts).return_difference
    for row, goal in zip(eigenpairs(v, len(problem.moves), problem.case), problem.goals, strict=True):
        size, damping, *rest = goal.numbers
        pattern = np.array(rest)
        natural = np.abs(roots) / size
        distance = (natural - 1) ** 2 + (-roots.real / np.maximum(np.abs(roots), 1e-12) - damping) ** 2
        for i in np.argsort(distance):
            x = np.linalg.svd(difference(roots[i : i + 1])[0])[2][-1].conj()
            if abs(pattern @ x) > LEAST_COSINE:
                x = x / (pattern @ x)
                row[:] = [roots[i].real / size, roots[i].imag / size, *x.real, *x.imag]
                break
    return np.asarray(np.clip(v, problem.lower, problem.upper))
