"""How sharp dry friction is: the speed over which its sign changes."""

from __future__ import annotations

import numpy as np

from modelling.effects.interface import Motion
from modelling.equations.assembly import STICK_SPEED, Assembly
from modelling.equations.compiled import Model
from modelling.simulation.plan import STABLE_STEP, rates_at_rest, steps_per_second

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
