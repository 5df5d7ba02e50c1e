"""The match as one nonlinear programme in CasADi, with exact derivatives, for IPOPT.

Minimise   error² + EIGEN · Σ[(Δf/f)² + Δζ²] + PRICE · Σ weight·(change/range)²
over the scaled quantities that move and, for every target, an explicit eigenpair (s, x) of the closed loop,
subject to  (I + L(s))·x = 0, x normalised to the target's pattern over the dynamometers      (tracked eigenvalues)
            σ_min(I + L(jω)) ≥ modulus margin on a grid
            the same, halved, on the ray of the smallest damping ratio: no root may cross it   (damping and stability)
            torque, speed and power the vehicle's own manoeuvre asks of adapters and dynamometers within limits.
With ``objective = "fidelity"`` in the case the first two terms give way to 1 − R² over the manoeuvre
(:mod:`matching.frequency.programme.objective`) and no eigenvalue is tracked.
Everything is exact in s, dead time included. A margin alone is no stability; the starts are stable and what comes
out is verified by :mod:`matching.frequency.verification`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from matching.frequency.case.case import Case, Move
from matching.frequency.case.demands import Demands
from matching.frequency.case.targets import Goal
from matching.frequency.programme.blocks import Common, Fidelity, Margins, Pairs, ResponseError
from matching.frequency.programme.closed_loop import ClosedLoop, General, closed_loop
from matching.frequency.programme.evaluators import Derivation, bend, pull, slope, together, value
from matching.frequency.programme.objective import Aim
from matching.frequency.programme.terms import Term, eigenpair, logarithm, margin, response
from modelling.modal.modes import modes

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
)  # Hz, where the modulus margin is held from the start
SLOTS = 30  # frequencies beside that grid, where a solution turns out to miss the margin
UNUSED = 600.0  # Hz: where the loop has no gain left
DENSE = np.geomspace(0.02, 500, 1200)  # Hz, where such are looked for
MISSED = 1e-5  # of a scaled margin: what is no longer taken for kept
OSCILLATING = 0.05  # of a target's |s|: the least that a root turns where it may not become real
RAY = np.geomspace(0.3, 150, 30)  # Hz, where no root may have less damping
LOGARITHMIC = 4.0  # bounds wider than this ratio are scaled logarithmically


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


@dataclass(frozen=True)
class Problem:
    """The programme: decision vector v = [moves scaled to 0 … 1, (σ, ω, Re x, Im x) of every goal scaled].

    Solver and objective take beside it the frequencies (slots,) in Hz at which the margin is to hold beside the grid;
    :data:`UNUSED` where there are fewer.

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
    tight: bool
    solver: ca.Function
    objective: ca.Function
    survey: ca.Function
    lower: np.ndarray
    upper: np.ndarray
    g_lower: np.ndarray
    g_upper: np.ndarray

    @property
    def slots(self) -> int:
        """How many frequencies can be added to the grid."""
        return int(self.objective.numel_in(1))

    def extra(self, frequencies: Sequence[float] | np.ndarray = ()) -> np.ndarray:
        """Frequencies (slots,) as solver and objective take them, the last ones where there are too many."""
        kept = np.asarray(frequencies, float)[-self.slots :] if self.slots else np.zeros(0)
        return np.concatenate([kept, np.full(self.slots - len(kept), UNUSED)])

    def oscillating(self) -> Problem:
        """The same where no tracked root may become real.

        A start from anywhere that may let one do so rarely finds a good optimum; one that is led from another solution
        has to be free to.
        """
        lower = self.lower.copy()
        eigenpairs(lower, len(self.moves), self.case)[:, 1] = OSCILLATING
        return replace(self, lower=lower)

    def missed(self, v: np.ndarray) -> np.ndarray:
        """Frequencies in Hz of the valleys of the margin, on a dense grid, that reach below what is wanted."""
        least = self.survey(v).full().ravel()
        padded = np.concatenate([[np.inf], least, [np.inf]])
        return DENSE[(least < -MISSED) & (least <= padded[:-2]) & (least <= padded[2:])]

    def violation(self, g: np.ndarray) -> float:
        """Largest violation of a scaled constraint by rows g (g,) of the objective; 0 where all are kept."""
        return float(np.maximum(self.g_lower - g, g - self.g_upper).max(initial=0.0))

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
        for name, own in values.items():
            p[self.loop.parameters.index(name)] = own
        return p


def eigenpairs(v: np.ndarray, size: int, case: Case) -> np.ndarray:
    """The goals' σ, ω, Re x and Im x, scaled (goals, 2 + 2·u), in a decision vector (v,) of ``size`` moves: a view."""
    return v[size:].reshape(-1, 2 + 2 * len(case.loop.dynamometers))


def unscaled(part: Any, move: Move) -> Any:
    """Value of a move in SI from its scaled part 0 … 1 (float or CasADi expression, and so the value)."""
    if _logarithmic(move):
        return move.lower * (move.upper / move.lower) ** part
    return move.lower + (move.upper - move.lower) * part


def scaled(value: float, move: Move) -> float:
    """Scaled part 0 … 1 of a value in SI."""
    if _logarithmic(move):
        return float(np.log(value / move.lower) / np.log(move.upper / move.lower))
    return (value - move.lower) / (move.upper - move.lower)


def _scale(move: Move) -> tuple[float, float]:
    """Lower bound and range, the range of the logarithm where that is scaled."""
    return move.lower, float(np.log(move.upper / move.lower)) if _logarithmic(move) else move.upper - move.lower


def _logarithmic(move: Move) -> bool:
    return move.lower > 0 and move.upper / move.lower > LOGARITHMIC


def grid(case: Case) -> np.ndarray:
    """Frequencies (f,) of the response error, Hz."""
    return np.geomspace(*case.band, IN_BAND)


def build(
    case: Case, moves: tuple[Move, ...], weights: np.ndarray, goals: tuple[Goal, ...], reference: np.ndarray,
    demands: Demands, aim: Aim | None = None, *,
    tight: bool = False, exact: bool = False, slots: int = 0, compiled: bool = True,
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
    aim : Aim, optional
        The fidelity over the manoeuvre to take in place of the response error.
    tight : bool
        Solve to six digits of the optimality conditions, beginning near a solution; without it the objective is good
        to about three, which is enough to compare starts.
    exact : bool
        Exact Hessian; without it IPOPT builds its own from the exact gradients, which is faster far from the end.
    slots : int
        Frequencies at which the margin may be asked for beside the grid.
    compiled : bool
        Compile where there is a compiler; CasADi does not differentiate what is compiled any further.
    """
    loop = closed_loop(case, [move.together for move in moves])
    size, count = len(moves), len(moves) + sum(2 + 2 * len(goal.pattern) for goal in goals)
    v, extra = ca.MX.sym("v", count), ca.MX.sym("extra", slots)
    logarithmic = tuple(_logarithmic(move) for move in moves)
    functions = _functions(loop.general, logarithmic, len(loop.fixed), bool(goals), aim is None, exact, compiled)
    common = Common(functions, v, size, _fixed(loop, moves))
    stable, pairs = Margins(common, _places(case, extra)), Pairs(common, goals)
    error: ResponseError | Fidelity
    if aim is None:
        error = ResponseError(common, grid(case), reference)
    else:
        own = closed_loop(aim.case, [move.together for move in moves])
        error = Fidelity(Common(_plain_responses(own, moves, compiled), v, size, _fixed(own, moves)), aim)
    of_rig: dict[str, Any] = {f"rig.{name}": quantity.value for name, quantity in case.rig.parameters.items()}
    for i, move in enumerate(moves):
        if move.name in of_rig:
            of_rig |= dict.fromkeys(move.together, unscaled(v[i], move))
    asked = demands.constraints(of_rig)
    asked_rows = ca.vertcat(*(one for one, _ in asked)) if asked else ca.MX(0, 1)
    change = v[:size] - ca.DM([scaled(move.start, move) for move in moves])
    price = PRICE * ca.dot(ca.DM(weights), change**2)

    rows, distance = pairs.value()
    held = stable.value()
    f, g = error.value() + price + EIGEN * distance, ca.vertcat(held, rows, asked_rows)
    held_too, held_slope = stable.slope()
    rows_too, rows_slope, _, distance_slope = pairs.slope()
    own_error, error_slope = error.slope()
    grad_f = error_slope + EIGEN * distance_slope + ca.gradient(price, v)
    jac_g = ca.vertcat(held_slope, rows_slope, ca.jacobian(asked_rows, v))
    options: Any = {
        "print_time": False, "error_on_fail": False, "no_nlp_grad": True, "calc_lam_p": False,
        "ipopt": _QUIET | (_TIGHT if tight else _LOOSE) | (_EXACT if exact else _FAST),
        "grad_f": ca.Function(
            "nlp_grad_f", [v, extra], [own_error + price + EIGEN * distance, grad_f], ["x", "p"], ["f", "grad_f_x"]
        ),
        "jac_g": ca.Function(
            "nlp_jac_g", [v, extra], [ca.vertcat(held_too, rows_too, asked_rows), jac_g], ["x", "p"], ["g", "jac_g_x"]
        ),
    }  # fmt: skip
    if exact:
        lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g.numel())
        of_held, of_rows, of_asked = ca.vertsplit(lam_g, [0, held.numel(), held.numel() + rows.numel(), g.numel()])
        hessian = lam_f * (error.bend() + ca.hessian(price, v)[0]) + stable.bend(of_held)
        hessian += pairs.bend(of_rows, EIGEN * lam_f) + ca.hessian(ca.dot(of_asked, asked_rows), v)[0]
        options["hess_lag"] = ca.Function(
            "nlp_hess_l", [v, extra, lam_f, lam_g], [ca.triu(hessian)],
            ["x", "p", "lam_f", "lam_g"], ["triu_hess_gamma_x_x"],
        )  # fmt: skip
    programme: Any = {"x": v, "p": extra, "f": f, "g": g}  # CasADi's stubs know no dict of MX
    solver = ca.nlpsol("match", "ipopt", programme, options)
    objective = ca.Function("objective", [v, extra], [f, g], ["v", "extra"], ["f", "g"])
    dense = np.vstack([0 * DENSE, 2 * np.pi * DENSE, np.full(len(DENSE), case.limits["modulus_margin"] * RESERVE)])
    survey = ca.Function("survey", [v], common.over("margin", ca.MX(ca.DM(dense))))
    pairs_lower = [bound for goal in goals for bound in (-8.0, 0.0, *[-5.0] * (2 * len(goal.pattern)))]
    pairs_upper = [bound for goal in goals for bound in (0.5, 12.0, *[5.0] * (2 * len(goal.pattern)))]
    exactly, open_end = np.zeros(rows.numel()), np.full(held.numel(), np.inf)
    return Problem(
        case, loop, moves, goals, tight, solver, objective, survey,
        lower=np.array([0.0] * size + pairs_lower),
        upper=np.array([1.0] * size + pairs_upper),
        g_lower=np.concatenate([np.zeros(held.numel()), exactly, np.full(asked_rows.numel(), -np.inf)]),
        g_upper=np.concatenate([open_end, exactly, *(np.full(one.numel(), bound) for one, bound in asked)]),
    )  # fmt: skip


def _fixed(loop: ClosedLoop, moves: Sequence[Move]) -> np.ndarray:
    """Numbers (c,) that :func:`_functions` take: the loop's, then those that scale each move."""
    scales = [_scale(move) for move in moves]
    return np.concatenate([loop.fixed, *scales]) if scales else loop.fixed


def _symbols(known: int, logarithmic: tuple[bool, ...]) -> tuple[ca.SX, ca.SX, ca.SX]:
    """What moves, the fixed numbers of :func:`_fixed`, ``known`` of them the loop's, and p as expressions of both."""
    count = len(logarithmic)
    free, fixed = ca.SX.sym("free", count), ca.SX.sym("fixed", known + 2 * count)
    p = ca.SX(count, 1)
    for i, log in enumerate(logarithmic):
        low, span = fixed[known + 2 * i], fixed[known + 2 * i + 1]
        p[i] = low * ca.exp(span * free[i]) if log else low + span * free[i]
    return free, fixed, p


def _plain_responses(loop: ClosedLoop, moves: Sequence[Move], compiled: bool) -> dict[str, ca.Function]:
    """Responses and their derivatives, for the fidelity."""
    free, fixed, p = _symbols(len(loop.fixed), tuple(_logarithmic(move) for move in moves))
    term = response(loop.general, free, p, fixed)
    plain = {"plain": term.plain}  # CasADi differentiates what is not compiled any further
    return plain | together({"response": (value, term), "response_pull": (pull, term)}, compiled)


@lru_cache(maxsize=16)
def _functions(
    loop: General,
    logarithmic: tuple[bool, ...],
    known: int,
    tracked: bool,
    responses: bool,
    exact: bool,
    compiled: bool,
) -> dict[str, ca.Function]:
    """The terms and their derivatives; no number of the case stands in them."""
    free, fixed, p = _symbols(known, logarithmic)
    held = margin(loop, free, p, fixed)
    wanted: dict[str, tuple[Derivation, Term]] = {"margin": (value, held), "margin_slope": (slope, held)}
    second: dict[str, tuple[Derivation, Term]] = {"margin_bend": (bend, held)}
    if responses:
        ratio, log = logarithm(loop, loop.response.numel_out(0), free, p, fixed)
        wanted |= {"ratio": (value, ratio), "pull": (pull, log)}
        second |= {"log_slope": (slope, log), "log_bend": (bend, log)}
    if tracked:
        pair = eigenpair(loop, free, p, fixed)
        wanted |= {"pair": (value, pair), "pair_slope": (slope, pair)}
        second |= {"pair_bend": (bend, pair)}
    return together(wanted, compiled) | (together(second, False) if exact else {})


def _places(case: Case, extra: ca.MX) -> ca.MX:
    """Where the margin is held and how far, (3, f): on the grid, at ``extra`` frequencies in Hz, and on the ray."""
    near = np.array([mode.frequency for mode in modes(case.rig) if 0 < mode.frequency < 400])
    omega = 2 * np.pi * np.concatenate([WIDE, *(near * part for part in (0.96, 1.0, 1.04))])
    least, zeta, ray = case.limits["modulus_margin"] * RESERVE, case.limits["damping_ratio"], 2 * np.pi * RAY
    on_grid = np.vstack([0 * omega, omega, np.full(len(omega), least)])
    on_ray = np.vstack([-zeta * ray, ray * np.sqrt(1 - zeta**2), np.full(len(ray), least / 2)])
    slots = extra.numel()
    added = ca.vertcat(ca.MX(1, slots), 2 * np.pi * extra.T, ca.MX(ca.DM.ones(1, slots) * least))
    return ca.horzcat(ca.MX(ca.DM(on_grid)), ca.densify(added), ca.MX(ca.DM(on_ray)))
