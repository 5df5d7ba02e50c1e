"""Ends of the local search: IPOPT run once, its end checked for feasibility and stability."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from matching.frequency.case.tuned import apply
from matching.frequency.loop.encirclements import encirclements
from matching.frequency.loop.parts import parts_of
from matching.frequency.programme.ipopt import solved
from matching.frequency.programme.problem import Problem
from modelling.common import floating_point

LARGEST_VIOLATION = 1e-5  # largest violation of a scaled constraint


class End(NamedTuple):
    """Where IPOPT ended: objective, decision vector (v,), and whether it is a minimum to six digits by its word.

    With the modulus margin and where it is (Hz), once it was checked.
    """

    objective: float
    v: np.ndarray
    converged: bool
    margin: float = float("nan")
    margin_frequency: float = float("nan")


def stable_ends(problem: Problem, begins: Sequence[np.ndarray], extra: np.ndarray | tuple[()] = ()) -> Iterator[End]:
    """The feasible and stable ends from several starts (v,), each sought when it is asked for."""
    for begin in begins:
        end = run_from(problem, begin, extra)
        if end:
            margin, frequency, stable = check(problem, end.v)
            if stable:
                yield end._replace(margin=margin, margin_frequency=frequency)


def run_from(problem: Problem, v: np.ndarray, extra: np.ndarray | tuple[()] = ()) -> End | None:
    """IPOPT from a start (v,); the end if it is finite and within bounds and constraints, else None.

    What IPOPT itself reports is not used. ``extra``: frequencies in Hz at which the margin is to hold beside the grid.
    """
    p, bounds = problem.extra(extra), {"lbg": problem.g_lower, "ubg": problem.g_upper}
    solution = solved(problem.solver, x0=v, p=p, lbx=problem.lower, ubx=problem.upper, **bounds)
    floating_point.restore()  # the solver's libraries may leave it changed
    x = np.clip(solution["x"].full().ravel(), problem.lower, problem.upper)
    f, g = (part.full().ravel() for part in problem.objective(x, p))
    if not (np.isfinite(x).all() and np.isfinite(f).all() and np.isfinite(g).all()):
        return None
    converged = problem.tight and bool(problem.solver.stats()["success"])
    return End(float(f[0]), x, converged) if problem.violation(g) <= LARGEST_VIOLATION else None


def check(problem: Problem, v: np.ndarray) -> tuple[float, float, bool]:
    """Modulus margin, where (Hz), and stability of decisions (v,), by the Nyquist criterion on the exact loop."""
    winding = encirclements(parts_of(apply(problem.case, problem.values(v))))
    return winding.modulus_margin, winding.margin_frequency, winding.unstable == 0 and winding.clear
