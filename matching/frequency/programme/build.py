"""The match as one nonlinear programme in CasADi, with exact derivatives, for IPOPT.

Minimise   error = objective + EIGENVALUE_WEIGHT · Σ[(Δf/f)² + Δζ²]
over the scaled quantities that move and, for every target, an explicit eigenpair (s, x) of the closed loop,
subject to  (I + L(s))·x = 0, x normalised to the target's pattern over the dynamometers      (tracked eigenvalues)
            σ_min(I + L(jω)) ≥ modulus margin on a grid
            the same, halved, on the ray of the smallest damping ratio: no root may cross it   (damping and stability)
            torque and power the vehicle's own manoeuvre asks of adapters and dynamometers within limits.
Of answers that are as good, the one that changes least: with ``error_limit`` the programme minimises
change = Σ weight·(change/range)² subject to error ≤ error_limit and to all of the above.
The objective is one of :mod:`matching.frequency.programme.objectives`; one that tracks no modes leaves out the second
term. Everything is exact in s, dead time included (:mod:`matching.frequency.programme.dead_time`). A margin alone is no
stability; the starts are stable and what comes out is verified by :mod:`matching.frequency.verification`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from matching.frequency.case.case import Case, Move
from matching.frequency.case.demands import Demands
from matching.frequency.case.targets import Goal
from matching.frequency.programme.closed_loop import General, closed_loop
from matching.frequency.programme.constraints import CommonParts, EigenpairConstraints, MarginConstraints
from matching.frequency.programme.evaluators import jacobian, together, value, weighted_hessian
from matching.frequency.programme.ipopt import ipopt_options
from matching.frequency.programme.margin_grid import margin_points, survey_points
from matching.frequency.programme.objective import Objective, ObjectiveBlock, Terms
from matching.frequency.programme.problem import Problem
from matching.frequency.programme.scaling import fixed_numbers, is_logarithmic, scaled, symbols, unscaled
from matching.frequency.programme.terms import eigenpair, margin

EIGENVALUE_WEIGHT = 0.3  # on a relative frequency error or a damping-ratio error of 1, against a response error of 1
# Bounds of an eigenpair: σ and ω over the goal's |s| (real part far left to slightly unstable), entries of its vector.
REAL_PART, IMAGINARY_PART, VECTOR_ENTRY = (-8.0, 0.5), (0.0, 12.0), (-5.0, 5.0)


@dataclass(frozen=True)
class _Parts:
    """What the programme is put together from: decision vector, added frequencies, objective, constraints, change.

    ``error_limit`` is None where the error is minimised, else the change is.
    """

    v: ca.MX
    extra: ca.MX
    objective: ObjectiveBlock
    margins: MarginConstraints
    pairs: EigenpairConstraints
    demands: ca.MX
    change: ca.MX
    error_limit: float | None


# more than six parameters: the programme is all of this, and a TuningTask (search) holds it for who searches
def build(
    case: Case, moves: tuple[Move, ...], weights: np.ndarray, goals: tuple[Goal, ...], objective: Objective,
    demands: Demands, *, tight: bool = False, exact: bool = False, slots: int = 0, compiled: bool = True,
    error_limit: float | None = None,
) -> Problem:  # fmt: skip
    """Build the programme.

    Parameters
    ----------
    case : Case
    moves : tuple of Move
        What is released.
    weights : ndarray (moves,)
        Weight on the change of each.
    goals : tuple of Goal
        None where the objective tracks no modes.
    objective : Objective
    demands : Demands
        What the vehicle's manoeuvre asks of adapters and dynamometers.
    tight : bool
        Solve to six digits of the optimality conditions, beginning near a solution; without it the objective is good
        to about three, which is enough to compare starts.
    exact : bool
        Exact Hessian; without it IPOPT builds its own from the exact gradients, which is faster away from the end.
    slots : int
        Frequencies at which the margin may be asked for beside the grid.
    compiled : bool
        Compile where there is a compiler; CasADi does not differentiate what is compiled any further.
    error_limit : float, optional
        Minimise the change from what was planned, with the error at most this, instead of the error.
    """
    loop = closed_loop(case, [move.together for move in moves])
    size, count = len(moves), len(moves) + sum(2 + 2 * len(goal.pattern) for goal in goals)
    v, extra = ca.MX.sym("v", count), ca.MX.sym("extra", slots)
    logarithmic = tuple(is_logarithmic(move) for move in moves)
    functions = _functions(loop.general, logarithmic, len(loop.fixed), bool(goals), type(objective), exact, compiled)
    common = CommonParts(functions, v, size, fixed_numbers(loop, moves))
    limits = demands.constraints(_rig_values(case, moves, v))
    planned = ca.DM([scaled(move.planned, move) for move in moves])
    parts = _Parts(
        v, extra, objective.block(common, moves, compiled),
        MarginConstraints(common, margin_points(case, extra)), EigenpairConstraints(common, goals),
        ca.vertcat(*(rows for rows, _ in limits)) if limits else ca.MX(0, 1),
        ca.dot(ca.DM(weights), (v[:size] - planned) ** 2), error_limit,
    )  # fmt: skip
    solver, both = _solver(parts, tight, exact)
    survey = ca.Function("survey", [v], common.over("margin", ca.MX(ca.DM(survey_points(case)))))
    margins, rows = parts.margins.value().numel(), parts.pairs.value()[0].numel()
    pairs = np.array([pair for goal in goals for pair in _pair_bounds(len(goal.pattern))]).reshape(-1, 2)
    zeros, within = np.zeros(rows), np.zeros(0 if error_limit is None else 1)
    return Problem(
        case, loop, moves, goals, tight, solver, both, survey,
        lower=np.concatenate([np.zeros(size), pairs[:, 0]]),
        upper=np.concatenate([np.ones(size), pairs[:, 1]]),
        g_lower=np.concatenate([np.zeros(margins), zeros, np.full(parts.demands.numel(), -np.inf), within - np.inf]),
        g_upper=np.concatenate(
            [np.full(margins, np.inf), zeros, *(np.full(r.numel(), upper) for r, upper in limits), within + 1.0]
        ),
    )  # fmt: skip


def _pair_bounds(dynamometers: int) -> list[tuple[float, float]]:
    return [REAL_PART, IMAGINARY_PART, *[VECTOR_ENTRY] * (2 * dynamometers)]


def _rig_values(case: Case, moves: tuple[Move, ...], v: ca.MX) -> dict[str, Any]:
    """Values of the rig's quantities by ``rig.…``, SI, those that move as expressions of v."""
    values: dict[str, Any] = {f"rig.{name}": quantity.value for name, quantity in case.rig.parameters.items()}
    for i, move in enumerate(moves):
        if move.name in values:
            values |= dict.fromkeys(move.together, unscaled(v[i], move))
    return values


def _solver(parts: _Parts, tight: bool, exact: bool) -> tuple[ca.Function, ca.Function]:
    """IPOPT with its derivatives, and objective and constraints (v, extra) → (f, g)."""
    v, extra, demands, limit = parts.v, parts.extra, parts.demands, parts.error_limit
    rows, distance = parts.pairs.value()
    margins = parts.margins.value()
    f = parts.objective.value() + EIGENVALUE_WEIGHT * distance
    g = ca.vertcat(margins, rows, demands)
    margins_again, margins_jacobian = parts.margins.jacobian()
    rows_again, rows_jacobian, _, distance_gradient = parts.pairs.jacobian()
    objective_again, objective_gradient = parts.objective.gradient()
    f_again = objective_again + EIGENVALUE_WEIGHT * distance
    gradient = objective_gradient + EIGENVALUE_WEIGHT * distance_gradient
    jacobian_g = ca.vertcat(margins_jacobian, rows_jacobian, ca.jacobian(demands, v))
    g_again = ca.vertcat(margins_again, rows_again, demands)
    if limit is not None:
        g, g_again = ca.vertcat(g, f / limit), ca.vertcat(g_again, f_again / limit)
        jacobian_g = ca.vertcat(jacobian_g, gradient.T / limit)
        f = f_again = parts.change
        gradient = ca.gradient(parts.change, v)
    options: Any = {
        "print_time": False, "error_on_fail": False, "no_nlp_grad": True, "calc_lam_p": False,
        "ipopt": ipopt_options(tight, exact),
        "grad_f": ca.Function("nlp_grad_f", [v, extra], [f_again, gradient], ["x", "p"], ["f", "grad_f_x"]),
        "jac_g": ca.Function("nlp_jac_g", [v, extra], [g_again, jacobian_g], ["x", "p"], ["g", "jac_g_x"]),
    }  # fmt: skip
    if exact:
        options["hess_lag"] = _hessian(parts, margins.numel(), rows.numel())
    programme: Any = {"x": v, "p": extra, "f": f, "g": g}  # CasADi's stubs know no dict of MX
    solver = ca.nlpsol("match", "ipopt", programme, options)
    return solver, ca.Function("objective", [v, extra], [f, g], ["v", "extra"], ["f", "g"])


def _hessian(parts: _Parts, margins: int, rows: int) -> ca.Function:
    """Upper triangle of the Lagrangian's Hessian."""
    v, demands = parts.v, parts.demands
    before_limit, limit = margins + rows + demands.numel(), parts.error_limit
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", before_limit + (limit is not None))
    of_margins, of_rows, of_demands = ca.vertsplit(lam_g[:before_limit], [0, margins, margins + rows, before_limit])
    of_error = lam_f if limit is None else lam_g[before_limit] / limit
    hessian = of_error * parts.objective.hessian() + parts.margins.hessian(of_margins)
    hessian += parts.pairs.hessian(of_rows, EIGENVALUE_WEIGHT * of_error)
    hessian += ca.hessian(ca.dot(of_demands, demands), v)[0]
    if limit is not None:
        hessian += lam_f * ca.hessian(parts.change, v)[0]
    return ca.Function(
        "nlp_hess_l", [v, parts.extra, lam_f, lam_g], [ca.triu(hessian)],
        ["x", "p", "lam_f", "lam_g"], ["triu_hess_gamma_x_x"],
    )  # fmt: skip


# more than six parameters: they are what the functions depend on, and the key they are remembered by
@lru_cache(maxsize=16)
def _functions(
    loop: General, logarithmic: tuple[bool, ...], known: int, tracked: bool, objective: type[Objective],
    exact: bool, compiled: bool,
) -> dict[str, ca.Function]:  # fmt: skip
    """The terms and their derivatives; no number of the case stands in them."""
    free, fixed, p = symbols(known, logarithmic)
    of_margin = margin(loop, free, p, fixed)
    first: Terms = {"margin": (value, of_margin), "margin_jacobian": (jacobian, of_margin)}
    second: Terms = {"margin_hessian": (weighted_hessian, of_margin)}
    for terms, more in zip((first, second), objective.terms(loop, free, p, fixed), strict=True):
        terms.update(more)
    if tracked:
        pair = eigenpair(loop, free, p, fixed)
        first |= {"pair": (value, pair), "pair_jacobian": (jacobian, pair)}
        second |= {"pair_hessian": (weighted_hessian, pair)}
    return together(first, compiled) | (together(second, False) if exact else {})
