"""How IPOPT is set for searching, for finishing and for a last step with exact second derivatives."""

from __future__ import annotations

from typing import Any

import casadi as ca

from modelling.common.interruption import none_swallowed

_QUIET = {"print_level": 0, "sb": "yes", "tol": 1e-6}
_TIGHT = {  # stays where it begins
    "acceptable_tol": 1e-4,
    "mu_strategy": "monotone",
    "mu_init": 1e-4,
    "bound_push": 1e-4,
    "bound_frac": 1e-4,
}
_LOOSE = {  # ends where the objective has stood still for three iterations and the constraints are kept
    "mu_strategy": "adaptive",
    "acceptable_tol": 1.0,
    "acceptable_iter": 3,
    "acceptable_obj_change_tol": 1e-4,
    "acceptable_constr_viol_tol": 1e-5,
    "acceptable_dual_inf_tol": 10.0,
    "acceptable_compl_inf_tol": 1e-2,
}
_FAST = {
    "hessian_approximation": "limited-memory",
    "limited_memory_max_history": 12,
    "limited_memory_aug_solver": "extended",
    "min_refinement_steps": 0,
    "fast_step_computation": "yes",
    "max_iter": 250,
}
_EXACT = {"mu_init": 1e-6, "bound_push": 1e-8, "bound_frac": 1e-8, "warm_start_init_point": "yes", "max_iter": 40}


def ipopt_options(tight: bool, exact: bool) -> dict[str, Any]:
    """Options of IPOPT: ``tight`` stays where it begins, ``exact`` is given second derivatives."""
    return _QUIET | (_TIGHT if tight else _LOOSE) | (_EXACT if exact else _FAST)


def solved(solver: ca.Function, **start_and_bounds: Any) -> dict[str, ca.DM]:
    """What a solver finds.

    Raises
    ------
    KeyboardInterrupt
        On Ctrl-C, which the solver itself takes for an ordinary end, or for a point that cannot be evaluated.
    """
    with none_swallowed():
        solution: dict[str, ca.DM] = solver(**start_and_bounds)
    if solver.stats()["return_status"] == "User_Requested_Stop":
        raise KeyboardInterrupt
    return solution
