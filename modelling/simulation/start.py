"""Where a simulation starts: at rest, given, or in steady motion."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from modelling.effects.effect import SECOND_STATE, Motion
from modelling.equations.casadi_code import Model
from modelling.equations.lagrange import STICK_SPEED, Assembly
from modelling.errors import InputError, listed, unknown
from modelling.linear.steady_motion import steady_motion, without_rate_bounds
from modelling.recordings.plausible import check_pedals
from modelling.simulation.stepping import STABLE_STEP, rates_at_rest, steps_per_second

# --- Inputs of a simulation, checked and brought into arrays.

Inputs = Mapping[str, np.ndarray] | np.ndarray


def checked(model: Model, time: np.ndarray, inputs: Inputs) -> tuple[np.ndarray, np.ndarray]:
    """Time (t,) in s and inputs (t, u) in SI, contiguous and checked.

    Raises
    ------
    InputError
        If time does not rise, an input is missing or of another length, a value is not finite, or a pedal is none.
    """
    time = np.ascontiguousarray(time, dtype=float)
    if time.ndim != 1 or len(time) < 2:
        raise InputError("time", f"shape {time.shape}", "at least two samples are needed")
    if not np.isfinite(time).all() or (np.diff(time) <= 0).any():
        raise InputError("time", "is not finite or does not rise", "give rising times in s")
    u = _columns(model, time, inputs) if isinstance(inputs, Mapping) else np.asarray(inputs, dtype=float)
    if u.shape != (len(time), len(model.inputs)):
        raise InputError("inputs", f"shape {u.shape}", f"(t, u) = ({len(time)}, {len(model.inputs)}) is needed")
    if not np.isfinite(u).all():
        sample, column = np.argwhere(~np.isfinite(u))[0]
        raise InputError(
            f"inputs.{model.inputs[column]}", f"is not finite at {time[sample]:g} s", "fill or cut the gap"
        )
    check_pedals(model.system, time, dict(zip(model.inputs, u.T, strict=True)))
    return time, np.ascontiguousarray(_with_possible_brakes(model, time, u))


BRAKE_NOISE = 0.02  # of its largest value: so far below 0 the torque of a brake is noise or a zero that is off


def _with_possible_brakes(model: Model, time: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Inputs (t, u) with brakes and clutches that do not drive: noise below 0 is 0.

    Raises
    ------
    InputError
        If a brake or clutch has a torque below 0, as most loggers write a brake: it would drive what it brakes.
    """
    columns = [list(model.inputs).index(name) for name in (*model.system.brakes, *model.system.capacities)]
    if not columns or not (u[:, columns] < 0).any():
        return u
    for column in columns:
        torque = u[:, column]
        lowest = int(torque.argmin())
        pulled = torque[torque < -BRAKE_NOISE * np.abs(torque).max()]
        # noise about 0 reaches as far above it as below; a brake that drives is pulled one way, for a while
        what = "clutch" if model.inputs[column] in model.system.capacities else "brake"
        if len(pulled) and -torque.min() > 2 * torque.max():
            raise InputError(
                f"inputs.{model.inputs[column]}",
                f"is {u[lowest, column]:.4g} N·m at {time[lowest]:g} s: the torque of a {what} is 0 or more",
                "record it positive, or turn it with sign = -1 in a channel file",
            )
    u = u.copy()
    u[:, columns] = np.maximum(u[:, columns], 0.0)
    return u


def _columns(model: Model, time: np.ndarray, inputs: Mapping[str, np.ndarray]) -> np.ndarray:
    for name in model.inputs:
        if name not in inputs:
            raise unknown(name, list(inputs), f"inputs.{name}")
    columns = [np.asarray(inputs[name], dtype=float) for name in model.inputs]
    for name, column in zip(model.inputs, columns, strict=True):
        if column.shape != time.shape:
            raise InputError(f"inputs.{name}", f"shape {column.shape}", f"one value a sample is needed: {time.shape}")
    return np.stack(columns, axis=1) if columns else np.empty((len(time), 0))


# --- Start

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
    p = without_rate_bounds(model, p)
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


# --- How sharp dry friction is: the speed over which its sign changes.

SHARPEST, BLUNTEST = 2e-5, 5e-4  # stick speed over the range of the speeds that stick
MOVES = 1e-6  # of the largest range: an inertia that moves less stands still
NO_FRICTION = 1e12  # rad/s, a stick speed at which friction is too flat to be fast


def stick_speed(model: Model, p: np.ndarray, states: np.ndarray, rate: float) -> float:
    """Stick speed for dry friction, rad/s: as sharp as costs no further steps, within bounds of the speeds' range.

    A sticking inertia creeps with up to about twice that speed where the law says it stands.

    Parameters
    ----------
    p : ndarray (p,)
    states : ndarray (t, x)
        A simulated motion; it gives the range of the speeds.
    rate : float
        Samples a second, at which steps are taken anyway.
    """
    at = model.parameters.index(STICK_SPEED)
    ranges = np.ptp(_sticking_speeds(model, p, states), axis=0)
    ranges = ranges[ranges > MOVES * ranges.max(initial=0.0)]
    if not ranges.size:
        return float(p[at])
    smallest = float(ranges.min())
    without, blunt = p.copy(), p.copy()
    without[at], blunt[at] = NO_FRICTION, BLUNTEST * smallest
    gradient = rates_at_rest(model, blunt[None]).any * blunt[at]  # 1/s times rad/s: the rate is inverse to the speed
    free = STABLE_STEP * max(rate, steps_per_second(model, without[None]))
    return float(np.clip(gradient / free, SHARPEST * smallest, BLUNTEST * smallest))


def _sticking_speeds(model: Model, p: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Speeds (t, k) of the inertias that carry dry friction."""
    a = model.equations.assembly
    values = a.with_abbreviations(dict(zip(a.parameters, p, strict=True)))
    speeds = []
    for effect in model.system.effects:
        if effect.law.sticks:
            share = _sliding_motion(a, effect.at).coefficients
            speeds.append(
                sum(
                    float(c.subs({s: values[str(s)] for s in c.free_symbols})) * states[:, model.n + i]
                    for i, c in share.items()
                )
            )
    return np.stack(speeds, axis=1) if speeds else np.empty((len(states), 0))


def _sliding_motion(assembly: Assembly, at: str) -> Motion:
    """The motion that dry friction at a place opposes: that of the inertia, or of a shaft's or gear's second end."""
    table, name = at.split(".")
    if table == "gears":
        name = next(gear.between[1] for gear in assembly.system.gears if gear.name == name)
    return assembly.shafts[name].second if table == "shafts" else assembly.motions[name]
