"""Where a simulation starts: at rest, given, or in steady motion."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.optimize import least_squares

from modelling.common.errors import InputError, listed, unknown
from modelling.equations.compiled import Model
from modelling.linear.elements import rest

Start = None | str | np.ndarray | Mapping[str, float]


def start_state(model: Model, p: np.ndarray, u: np.ndarray, start: Start) -> np.ndarray:
    """State (x,) at the first sample.

    Parameters
    ----------
    p, u : ndarray (p,), (u,)
        Parameters and the inputs at the first sample, which are taken to have held before it.
    start : None, "rest", "steady", array (x,) or mapping
        Nothing or ``"rest"``: angles and speeds 0, lags settled. ``"steady"``: see :func:`steady`. A mapping gives
        angles (rad) and speeds (rad/s) by state name, e.g. ``{"speed(motor)": 80.0}``, the others as at rest.

    Raises
    ------
    InputError
        If a state is unknown, not finite, of another length, or no steady motion exists.
    """
    if isinstance(start, str) and start == "steady":
        return steady(model, p, u)
    x = np.zeros(len(model.states))
    given: list[int] = []
    if start is None or (isinstance(start, str) and start == "rest"):
        pass
    elif isinstance(start, str):
        raise InputError("start", f"{start!r} is not known", "give rest, steady, states by name or all states")
    elif isinstance(start, Mapping):
        for name, value in start.items():
            if name not in model.states:
                raise unknown(name, model.states, "start")
            given.append(model.states.index(name))
            x[given[-1]] = value
    else:
        x = np.array(start, dtype=float).ravel()
        if len(x) != len(model.states):
            raise InputError("start", f"{len(x)} values", f"{len(model.states)} are needed: {listed(model.states)}")
        given = list(range(len(x)))
    if not np.isfinite(x).all():
        raise InputError(
            "start", f"{model.states[int(np.argmin(np.isfinite(x)))]} is not finite", "write finite numbers"
        )
    return _settled(model, p, u, x, given)


def _settled(model: Model, p: np.ndarray, u: np.ndarray, x: np.ndarray, given: list[int]) -> np.ndarray:
    """Lag states, as long as not given, where they would stay."""
    settling = {own.name for own in model.system.effects if own.law.state is not None and own.law.state.settles}
    lags = [i for i, name in enumerate(model.states) if name in settling and i not in given]
    for _ in range(3 if lags else 0):  # lags may stand in a row
        rate = np.array(model.rates(x, u, p)).ravel()[lags]
        A = np.array(model.jacobians(x, u, p, 0.0)[0])[np.ix_(lags, lags)]
        x[lags] -= np.linalg.solve(A, rate)
    return x


def steady(model: Model, p: np.ndarray, u: np.ndarray, speeds: Mapping[str, float] | None = None) -> np.ndarray:
    """State of steady motion under the inputs ``u``: shafts hold their twist, nothing vibrates.

    Without ``speeds`` all accelerations are 0: the speed follows from drag. With ``speeds`` (rad/s by inertia) it moves
    with them, as nearly as the stiff parts allow, and may accelerate as one piece.

    Raises
    ------
    InputError
        If there is no such motion, or an inertia is unknown.
    """
    n, x0 = model.n, np.zeros(len(model.states))
    x0[:n] = 1e-9 * np.cos(np.arange(n) * 1.7)
    gaps = [model.parameters.index(name) for name in model.system.free_plays.values()]
    closed = p.copy()
    closed[gaps] = 0.0
    stiffness = np.array(model.jacobians(x0, u, closed, 0.0)[0])[n : 2 * n, :n]
    _, size, basis = np.linalg.svd(stiffness)
    free = basis[size < 1e-9 * max(size.max(), 1e-300)].T  # motions that twist nothing, (n, r)
    fixed = None if speeds is None else _fitting(model, p, free, speeds)
    scale = max(size.max(), 1.0)

    def state(guess: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        move = guess[-free.shape[1] :]
        v = free @ (move if fixed is None else fixed)
        common = np.zeros(n) if fixed is None else free @ move
        return np.concatenate([guess[:n], v, guess[n : len(x0) - n]]), common

    def residual(guess: np.ndarray) -> np.ndarray:
        x, common = state(guess)
        rate = np.array(model.rates(x, u, p)).ravel()
        return np.concatenate([rate[n : 2 * n] - common, rate[2 * n :], np.sqrt(scale) * (free.T @ x[:n])])

    closed_lash = np.atleast_2d(rest(model, p))[0]
    for side in (1.0, -1.0):  # lash may lie on either flank
        guess = np.concatenate([side * closed_lash[:n], side * closed_lash[2 * n :], np.zeros(free.shape[1])])
        solution = least_squares(residual, guess, x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15)
        if np.abs(solution.fun).max() < 1e-6 * max(1.0, float(np.abs(u).max(initial=0.0))):
            return state(solution.x)[0]
    raise InputError("start", "there is no steady motion under the first inputs", "start at rest or give the speeds")


def _fitting(model: Model, p: np.ndarray, free: np.ndarray, speeds: Mapping[str, float]) -> np.ndarray:
    """Amounts of the free motions that come nearest to given speeds."""
    a = model.equations.assembly
    values = dict(zip(a.parameters.values(), p, strict=True))
    rows = np.zeros((len(speeds), model.n))
    for row, name in zip(rows, speeds, strict=True):
        if name not in a.motions:
            raise unknown(name, list(a.motions), "start")
        for i, c in a.motions[name].share.items():
            row[i] = float(c.xreplace(values))
    return np.linalg.lstsq(rows @ free, np.array(list(speeds.values()), dtype=float), rcond=1e-9)[0]
