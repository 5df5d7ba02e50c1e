"""Where a simulation starts: at rest, given, or in steady motion."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from modelling.common.errors import InputError, listed, unknown
from modelling.effects.kind import SECOND_STATE
from modelling.equations.compiled import Model
from modelling.linear.steady_motion import steady_motion

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
    fixed: list[int] = []
    if start is None or (isinstance(start, str) and start == "rest"):
        pass
    elif isinstance(start, str):
        raise InputError("start", f"{start!r} is not known", "give rest, steady, states by name or all states")
    elif isinstance(start, Mapping):
        for name, value in start.items():
            if name not in model.states:
                raise unknown(name, model.states, "start")
            fixed.append(model.states.index(name))
            x[fixed[-1]] = value
    else:
        x = np.array(start, dtype=float).ravel()
        if len(x) != len(model.states):
            raise InputError("start", f"{len(x)} values", f"{len(model.states)} are needed: {listed(model.states)}")
        fixed = list(range(len(x)))
    if not np.isfinite(x).all():
        raise InputError(
            "start", f"{model.states[int(np.argmin(np.isfinite(x)))]} is not finite", "write finite numbers"
        )
    return _settled(model, p, u, x, fixed)


def _settled(model: Model, p: np.ndarray, u: np.ndarray, x: np.ndarray, fixed: list[int]) -> np.ndarray:
    """Lag states, as long as not given, where they would stay.

    This is not :func:`steady`: the motion given need not be steady, and only the lags rest beside it. Their rates are
    linear in their states unless the law that feeds them is not, so few Newton steps do.
    """
    settling = {
        effect.name for effect in model.system.effects if effect.law.state is not None and effect.law.state.settles
    }
    lags = [i for i, name in enumerate(model.states) if name.removesuffix(SECOND_STATE) in settling and i not in fixed]
    for _ in range(3 if lags else 0):  # lags may stand in a row
        rate = np.array(model.rates(x, u, p)).ravel()[lags]
        A = np.array(model.jacobians(x, u, p, 0.0)[0])[np.ix_(lags, lags)]
        x[lags] -= np.linalg.solve(A, rate)
    return x


def steady(model: Model, p: np.ndarray, u: np.ndarray, speeds: Mapping[str, float] | None = None) -> np.ndarray:
    """State (x,) of steady motion under the inputs ``u`` (u,), see :mod:`modelling.linear.steady_motion`.

    Without ``speeds`` all accelerations are 0: the speed follows from drag. With ``speeds`` (rad/s by inertia) the
    drivetrain moves with them and may accelerate as one piece.

    Raises
    ------
    InputError
        If there is no such motion, or an inertia is unknown.
    """
    motion = steady_motion(model, p, u, speeds, accelerating=speeds is not None)
    if motion.error > 1.0:
        raise InputError(
            "start", "there is no steady motion under the first inputs", "start at rest or give the speeds"
        )
    return motion.state
