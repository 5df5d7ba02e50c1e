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
from modelling.modes import modes

EIGEN = 0.3  # price of a relative frequency error or a damping-ratio error of 1, against a response error of 1
PRICE = 2e-3  # of a change over the whole range of a quantity of weight 1
RESERVE = 1.002  # on the modulus margin, for what lies between grid points
IN_BAND = 48  # frequencies of the response error
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
class Goal:
    """A target for the optimiser: eigenvalue wanted, rad/s, and pattern of speeds over the dynamometers (u,)."""

    eigenvalue: complex
    pattern: np.ndarray


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
    k, h = len(case.loop.dynamometers), len(case.compared)
    size = len(moves)
    v = ca.MX.sym("v", size + len(goals) * (2 + 2 * k))
    parts = [unscaled(v[i], move) for i, move in enumerate(moves)]
    p = ca.vertcat(*parts)

    f = grid(case)
    if aim is None:
        H = _evaluate(loop.response, np.zeros(len(f)), 2 * np.pi * f, p)
        objective = _response_error(H[0], H[1], reference, h)
    else:
        whole = closed_loop(aim.case, [move.together for move in moves])
        objective = aim.loss(*_evaluate(whole.response, aim.s.real, aim.s.imag, p))
    start = np.array([scaled(move.start, move) for move in moves])
    if size:
        objective = objective + PRICE * ca.sum1(ca.DM(weights) * (v[:size] - start) ** 2)

    g, low, high = [], [], []
    margin = case.limits["modulus_margin"] * RESERVE
    near = np.array([mode.frequency for mode in modes(case.rig) if 0 < mode.frequency < 400])
    wide = np.concatenate(
        [
            np.geomspace(0.02, 5, 18, endpoint=False),
            np.geomspace(5, 150, 64, endpoint=False),
            np.geomspace(150, 500, 12),
        ]
    )
    band = np.concatenate([wide, *(near * part for part in (0.96, 1.0, 1.04)), () if extra is None else extra])
    ray = np.geomspace(0.3, 150, 30)
    zeta = case.limits["damping_ratio"]
    for frequencies, damping, least in ((band, 0.0, margin), (ray, zeta, margin / 2)):
        omega = 2 * np.pi * frequencies
        re, im = _evaluate(loop.difference, -damping * omega, omega * np.sqrt(1 - damping**2), p)
        for row in _definite(re, im, k, least):
            g.append(row.T)
            low += [0.0] * len(frequencies)
            high += [np.inf] * len(frequencies)

    lower, upper = [0.0] * size, [1.0] * size
    for number, goal in enumerate(goals):
        at = size + number * (2 + 2 * k)
        size_of = abs(goal.eigenvalue)
        x_re, x_im = v[at + 2 : at + 2 + k], v[at + 2 + k : at + 2 + 2 * k]
        re, im = loop.difference(v[at] * size_of, v[at + 1] * size_of, p)
        D_re, D_im = ca.reshape(re, k, k).T, ca.reshape(im, k, k).T
        scale = 1 / (1 + ca.sqrt(ca.sumsqr(re) + ca.sumsqr(im)))
        pattern = ca.DM(goal.pattern / np.linalg.norm(goal.pattern))
        rows = ca.vertcat(
            (D_re @ x_re - D_im @ x_im) * scale,
            (D_re @ x_im + D_im @ x_re) * scale,
            pattern.T @ x_re - 1,
            pattern.T @ x_im,
        )
        g.append(rows)
        low += [0.0] * (2 * k + 2)
        high += [0.0] * (2 * k + 2)
        natural = ca.sqrt(v[at] ** 2 + v[at + 1] ** 2)
        ratio = -goal.eigenvalue.real / size_of
        objective = objective + EIGEN * ((natural - 1) ** 2 + (-v[at] / natural - ratio) ** 2)
        lower += [-8.0, 0.05] + [-5.0] * (2 * k)
        upper += [0.5, 12.0] + [5.0] * (2 * k)
    fixed = {f"rig.{name}": ca.MX(quantity.value) for name, quantity in case.rig.parameters.items()}
    for rows, bound in demands.constraints(
        fixed | {name: p[i] for i, move in enumerate(moves) for name in move.together}
    ):
        g.append(rows)
        low += [-np.inf] * rows.shape[0]
        high += [bound] * rows.shape[0]
    constraints = ca.vertcat(*g)
    options: Any = {"print_time": False, "error_on_fail": False, "ipopt": _QUIET | (_EXACT if exact else _FAST)}
    programme: Any = {"x": v, "f": objective, "g": constraints}  # CasADi's stubs know no dict of MX
    solver = ca.nlpsol("match", "ipopt", programme, options)
    check = ca.Function("objective", [v], [objective, constraints], ["v"], ["f", "g"])
    return Problem(
        case, loop, moves, goals, solver, check, np.array(lower), np.array(upper), np.array(low), np.array(high)
    )


def _evaluate(function: ca.Function, sigma: np.ndarray, omega: np.ndarray, p: ca.MX) -> tuple[ca.MX, ...]:
    """A function of the loop at many s: each output with one column a frequency."""
    mapped: Any = function.map(len(omega))  # in CasADi's stubs a call gives one output
    return mapped(ca.DM(sigma).T, ca.DM(omega).T, ca.repmat(p, 1, len(omega)))


def _response_error(re: ca.MX, im: ca.MX, reference: np.ndarray, functions: int) -> ca.MX:
    """Mean square of |log(H/reference)|, phase unwrapped along the frequencies, functions (h, f)."""
    wanted = reference.T
    ratio_re = (re * wanted.real + im * wanted.imag) / np.abs(wanted) ** 2
    ratio_im = (im * wanted.real - re * wanted.imag) / np.abs(wanted) ** 2
    square = ratio_re**2 + ratio_im**2 + 1e-12
    step_re = ratio_re[:, 1:] * ratio_re[:, :-1] + ratio_im[:, 1:] * ratio_im[:, :-1]
    step_im = ratio_im[:, 1:] * ratio_re[:, :-1] - ratio_re[:, 1:] * ratio_im[:, :-1]
    steps = ca.horzcat(ca.atan2(ratio_im[:, 0], ratio_re[:, 0]), ca.atan2(step_im, step_re))
    phase = ca.cumsum(steps, 1)
    return (ca.sumsqr(ca.log(square) / 2) + ca.sumsqr(phase)) / (functions * wanted.shape[1])


def _definite(re: ca.MX, im: ca.MX, k: int, least: float) -> list[ca.MX]:
    """Leading minors of DᴴD − least²·I, each (1, f), scaled by its diagonal: all positive where σ_min > least."""

    def entry(i: int, j: int) -> tuple[ca.MX, ca.MX]:
        a, b = ca.MX(0.0), ca.MX(0.0)
        for row in range(k):
            di, dj = row * k + i, row * k + j
            a = a + re[di, :] * re[dj, :] + im[di, :] * im[dj, :]
            b = b + re[di, :] * im[dj, :] - im[di, :] * re[dj, :]
        return a, b

    gram = [[entry(i, j) for j in range(k)] for i in range(k)]
    diagonal = [gram[i][i][0] - least**2 for i in range(k)]
    size = [1 + gram[i][i][0] for i in range(k)]
    minors = [diagonal[0] / size[0]]
    if k >= 2:
        a, b = gram[0][1]
        minors.append((diagonal[0] * diagonal[1] - a**2 - b**2) / (size[0] * size[1]))
    if k > 2:
        raise NotImplementedError("more than two dynamometers")
    return minors
