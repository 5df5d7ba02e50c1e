"""The match as one nonlinear programme in CasADi, with exact derivatives, for IPOPT.

Minimise   error² + EIGEN · Σ[(Δf/f)² + Δζ²] + PRICE · Σ weight·(change/range)²
over the scaled quantities that move and, for every target, an explicit eigenpair (s, x) of the closed loop,
subject to  (I + L(s))·x = 0, x normalised to the target's pattern over the dynamometers      (tracked eigenvalues)
            σ_min(I + L(jω)) ≥ modulus margin on a grid                                        (Sylvester's criterion)
            the same, halved, on the ray of the smallest damping ratio: no root may cross it   (damping and stability)
            torque, speed and power the vehicle's own manoeuvre asks of adapters and dynamometers within limits.
With ``objective = "fidelity"`` in the case the first two terms give way to 1 − R² over the manoeuvre
(:mod:`matching.frequency.objective`) and no eigenvalue is tracked.
Everything is exact in s, dead time included. A margin alone is no stability; the starts are stable and what comes
out is verified by :mod:`matching.frequency.verification`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from matching.frequency.case import Case, Move
from matching.frequency.closed_loop import ClosedLoop, closed_loop
from matching.frequency.demands import Demands
from matching.frequency.objective import Aim
from matching.frequency.terms import Goal, eigenpair, margins, response_error
from modelling.modes import modes

EIGEN = 0.3  # price of a relative frequency error or a damping-ratio error of 1, against a response error of 1
PRICE = 2e-3  # of a change over the whole range of a quantity of weight 1
RESERVE = 1.002  # on the modulus margin, for what lies between grid points
IN_BAND = 48  # frequencies of the response error
WIDE = np.concatenate(
    [
        np.geomspace(0.02, 5, 18, endpoint=False),
        np.geomspace(5, 150, 64, endpoint=False),
        np.geomspace(150, 500, 12),
    ]
)  # Hz, where the modulus margin is held
RAY = np.geomspace(0.3, 150, 30)  # Hz, where no root may have less damping
LOGARITHMIC = 4.0  # bounds wider than this ratio are scaled logarithmically


_QUIET = {"print_level": 0, "sb": "yes", "tol": 1e-6, "acceptable_tol": 1e-4}
_FAST = {
    "hessian_approximation": "limited-memory",
    "limited_memory_max_history": 12,
    "mu_strategy": "adaptive",
    "max_iter": 130,
}
_EXACT = {"mu_init": 1e-6, "bound_push": 1e-8, "bound_frac": 1e-8, "warm_start_init_point": "yes", "max_iter": 40}


@dataclass(frozen=True)
class Problem:
    """The programme: decision vector v = [moves scaled to 0 … 1, (σ, ω, Re x, Im x) of every goal scaled].

    Attributes
    ----------
    moves : tuple of Move
        Those that are not frozen.
    solver : Function
        IPOPT.
    lower, upper, g_lower, g_upper : ndarray
    """

    case: Case
    loop: ClosedLoop
    moves: tuple[Move, ...]
    goals: tuple[Goal, ...]
    solver: ca.Function
    objective: ca.Function
    lower: np.ndarray
    upper: np.ndarray
    g_lower: np.ndarray
    g_upper: np.ndarray

    def values(self, v: np.ndarray) -> dict[str, float]:
        """Values in SI of the moved quantities and their mirror images."""
        found = {}
        for part, move in zip(v, self.moves, strict=False):
            for name in move.together:
                found[name] = float(unscaled(part, move))
        return found

    def vector(self, values: dict[str, float]) -> np.ndarray:
        """p (p,) of the loop with some values changed."""
        p = self.loop.values.copy()
        for name, value in values.items():
            p[self.loop.parameters.index(name)] = value
        return p


def unscaled(part: Any, move: Move) -> Any:
    """Value of a move in SI from its scaled part 0 … 1 (float or CasADi expression, and so the value)."""
    if move.lower > 0 and move.upper / move.lower > LOGARITHMIC:
        return move.lower * (move.upper / move.lower) ** part
    return move.lower + (move.upper - move.lower) * part


def scaled(value: float, move: Move) -> float:
    """Scaled part 0 … 1 of a value in SI."""
    if move.lower > 0 and move.upper / move.lower > LOGARITHMIC:
        return float(np.log(value / move.lower) / np.log(move.upper / move.lower))
    return (value - move.lower) / (move.upper - move.lower)


def grid(case: Case) -> np.ndarray:
    """Frequencies (f,) of the response error, Hz."""
    return np.geomspace(*case.band, IN_BAND)


def build(
    case: Case, moves: tuple[Move, ...], weights: np.ndarray, goals: tuple[Goal, ...], reference: np.ndarray,
    demands: Demands, extra: np.ndarray | None = None, exact: bool = True, aim: Aim | None = None,
) -> Problem:  # fmt: skip
    """Build the programme.

    Parameters
    ----------
    case : Case
    moves : tuple of Move
        What is not frozen.
    weights : ndarray (moves,)
        Price of change of each.
    goals : tuple of Goal
    reference : ndarray (f, h)
        Vehicle responses at :func:`grid`.
    demands : Demands
        What the vehicle's manoeuvre asks of adapters and dynamometers.
    extra : ndarray, optional
        Frequencies in Hz at which the margin is to hold beside the grid.
    exact : bool
        Exact Hessian; without it IPOPT builds its own from the exact gradients, which is faster far from the end.
    aim : Aim, optional
        The fidelity over the manoeuvre to take in place of the response error.
    """
    loop = closed_loop(case, [move.together for move in moves])
    width = 2 + 2 * len(case.loop.dynamometers)
    size, count = len(moves), len(moves) + len(goals) * width
    v, symbols = ca.MX.sym("v", count), ca.SX.sym("v", count)
    p = ca.vertcat(*(unscaled(symbols[i], move) for i, move in enumerate(moves)))
    free, point = symbols[:size], v[:size]

    start = np.array([scaled(move.start, move) for move in moves])
    price = PRICE * ca.dot(ca.DM(weights), (free - start) ** 2) if size else ca.SX(0.0)
    rows = ca.SX(0, 1)
    for number in range(len(goals)):
        own = symbols[size + number * width : size + (number + 1) * width]
        zero, distance = eigenpair(loop, goals[number], own, p)
        rows, price = ca.vertcat(rows, zero), price + EIGEN * distance
    multipliers, factor = ca.SX.sym("multipliers", rows.numel()), ca.SX.sym("factor")
    lagrangian = factor * price + ca.dot(multipliers, rows)
    plain = ca.Function("plain", [symbols], ca.cse([price, ca.gradient(price, symbols), rows]))
    slopes = ca.Function("slopes", [symbols], ca.cse([ca.jacobian(rows, symbols)]))
    bend = ca.Function("bend", [symbols, factor, multipliers], ca.cse([ca.hessian(lagrangian, symbols)[0]]))

    near = np.array([mode.frequency for mode in modes(case.rig) if 0 < mode.frequency < 400])
    least, zeta = case.limits["modulus_margin"] * RESERVE, case.limits["damping_ratio"]
    band = np.concatenate([WIDE, *(near * part for part in (0.96, 1.0, 1.04)), () if extra is None else extra])
    stable = margins(loop, free, p, point, [(band, 0.0, least), (RAY, zeta, least / 2)])
    fixed = {f"rig.{name}": ca.MX(quantity.value) for name, quantity in case.rig.parameters.items()}
    moved = {name: unscaled(v[i], move) for i, move in enumerate(moves) for name in move.together}
    asked = demands.constraints(fixed | moved)
    asked_rows = ca.vertcat(*(one for one, _ in asked)) if asked else ca.MX(0, 1)

    cost, cost_slope, zero_rows = plain(v)
    held = stable.column()
    g = ca.vertcat(held, zero_rows, asked_rows)
    jac_g = ca.vertcat(_wide(stable.jacobian(), count), slopes(v), ca.jacobian(asked_rows, v))
    nothing = ca.MX.sym("p", 0)
    options: Any = {"print_time": False, "error_on_fail": False, "ipopt": _QUIET | (_EXACT if exact else _FAST)}
    if aim is None:
        error = response_error(loop, free, p, point, grid(case), reference)
        f, grad_f = cost + error.value, cost_slope + _tall(error.gradient(), count)
        options["grad_f"] = ca.Function("nlp_grad_f", [v, nothing], [f, grad_f], ["x", "p"], ["f", "grad_f_x"])
        if exact:
            many, few = held.numel(), zero_rows.numel()
            lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g.numel())
            inner = lam_f * error.hessian() + stable.hessian(lam_g[:many])
            hessian = bend(v, lam_f, lam_g[many : many + few])
            hessian += ca.diagcat(inner, ca.MX(count - size, count - size))
            hessian += ca.hessian(ca.dot(lam_g[many + few :], asked_rows), v)[0]
            options["hess_lag"] = ca.Function(
                "nlp_hess_l", [v, nothing, lam_f, lam_g], [ca.triu(hessian)],
                ["x", "p", "lam_f", "lam_g"], ["triu_hess_gamma_x_x"],
            )  # fmt: skip
    else:
        whole = closed_loop(aim.case, [move.together for move in moves])
        values = ca.vertcat(*(unscaled(v[i], move) for i, move in enumerate(moves)))
        f = cost + aim.loss(*_evaluate(whole.response, aim.s.real, aim.s.imag, values))
    options["jac_g"] = ca.Function("nlp_jac_g", [v, nothing], [g, jac_g], ["x", "p"], ["g", "jac_g_x"])
    programme: Any = {"x": v, "f": f, "g": g}  # CasADi's stubs know no dict of MX
    solver = ca.nlpsol("match", "ipopt", programme, options)
    check = ca.Function("objective", [v], [f, g], ["v"], ["f", "g"])
    pair_lower, pair_upper = [-8.0, 0.05] + [-5.0] * (width - 2), [0.5, 12.0] + [5.0] * (width - 2)
    lower, upper = np.array([0.0] * size + pair_lower * len(goals)), np.array([1.0] * size + pair_upper * len(goals))
    exactly, open_end = np.zeros(zero_rows.numel()), np.full(held.numel(), np.inf)
    g_lower = np.concatenate([np.zeros(held.numel()), exactly, np.full(asked_rows.numel(), -np.inf)])
    g_upper = np.concatenate([open_end, exactly, *(np.full(one.numel(), bound) for one, bound in asked)])
    return Problem(case, loop, moves, goals, solver, check, lower, upper, g_lower, g_upper)


def _wide(part: ca.MX, count: int) -> ca.MX:
    """A Jacobian with columns of zeros for the eigenpairs."""
    return ca.horzcat(part, ca.MX(part.shape[0], count - part.shape[1]))


def _tall(part: ca.MX, count: int) -> ca.MX:
    return ca.vertcat(part, ca.MX(count - part.shape[0], 1))


def _evaluate(function: ca.Function, sigma: np.ndarray, omega: np.ndarray, p: ca.MX) -> tuple[ca.MX, ...]:
    """A function of the loop at many s: each output with one column a frequency."""
    each: Any = function.map(len(omega))  # in CasADi's stubs a call gives one output
    return each(ca.DM(sigma).T, ca.DM(omega).T, ca.repmat(p, 1, len(omega)))
