"""How many steps a second, and how sharp dry friction turns: from the fastest eigenvalues."""

from __future__ import annotations

import numpy as np

from modelling.equations.assembly import STICK_SPEED
from modelling.equations.compiled import Model
from modelling.simulation.result import SimulationError

STABLE = 2.0  # |λ|·h of a fast decay; the method's limit is 2.78
ACCURATE = 0.6  # |λ|·h of the fastest vibration: 0.1 % of phase a radian
CONTACT = 0.2  # ω·h of the vibration of two neighbours on the spring of a lash alone
MOST = 2e6  # steps a second
SHARP, BLUNT = 2e-5, 5e-4  # stick speed over the range of the speeds that stick


def steps_per_second(
    model: Model, p: np.ndarray, states: np.ndarray | None = None, inputs: np.ndarray | None = None
) -> float:
    """Steps a second that the fastest eigenvalue needs, over all parameter sets and states.

    Every parameter set is probed with its lash closed and its friction at its steepest; ``states`` (k, x) with
    ``inputs`` (k, u) probe further points of the first set.

    Raises
    ------
    SimulationError
        If more than ``MOST`` would be needed, or an eigenvalue is not finite.
    """
    lash = [model.parameters.index(name) for name in model.system.free_plays.values()]
    closed = p.copy()
    closed[:, lash] = 0.0
    x = np.zeros((len(model.states), 2 * len(p)))
    probe = 1e-9 * np.cos(np.arange(model.n) * 1.7)  # no two coordinates alike: every lash is closed
    x[: model.n] = np.repeat([probe, -probe], len(p), axis=0).T
    zero = np.zeros((len(model.inputs), x.shape[1]))
    A = [_matrices(model, x, zero, np.vstack([closed, closed]).T)]
    contact = 0.0
    for one in lash:
        opened = closed.copy()
        opened[:, one] = 1e9
        change = A[0] - _matrices(model, x, zero, np.vstack([opened, opened]).T)
        square = -np.trace(change[:, model.n : 2 * model.n, : model.n], axis1=1, axis2=2)  # stiffness over inertia
        contact = max(contact, float(np.sqrt(square.max(initial=0.0))))
    if states is not None and inputs is not None:
        A.append(_matrices(model, states.T, inputs.T, np.repeat(p[:1], len(states), axis=0).T))
    values = np.linalg.eigvals(np.concatenate(A)).ravel()
    size = np.abs(values)
    swinging = size[-values.real < 0.7 * size]
    needed = max(size.max(initial=0.0) / STABLE, swinging.max(initial=0.0) / ACCURATE, contact / CONTACT, 1.0)
    if not needed <= MOST:
        raise SimulationError(
            "simulation", f"the fastest eigenvalue, {size.max():.3g} 1/s, needs {needed:.3g} steps a second",
            f"at most {MOST:g} are taken: look for a very small inertia, time constant or coefficient",
        )  # fmt: skip
    return float(needed)


def _matrices(model: Model, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> np.ndarray:
    """A at several points, (k, x, x)."""
    k, n = x.shape[1], x.shape[0]
    A = np.array(model.jacobians.map(k)(x, u, p, np.zeros((1, k)))[0].full()) if k else np.empty((n, 0))
    if not np.isfinite(A).all():
        raise SimulationError(
            "simulation", "the linearised model is not finite", "check parameter values and start state"
        )
    return A.reshape(n, k, n).transpose(1, 0, 2)


def stick_speed(model: Model, p: np.ndarray, states: np.ndarray, rate: float) -> float:
    """Stick speed for dry friction, rad/s: as sharp as costs no further steps, at most ``BLUNT`` of the speeds' range.

    A sticking inertia creeps with up to about twice that speed where the law says it stands.

    Parameters
    ----------
    p : ndarray (p,)
    states : ndarray (t, x)
        A simulated motion; it gives the range of the speeds.
    rate : float
        Samples a second, which are steps at least.
    """
    at = model.parameters.index(STICK_SPEED)
    reach = np.ptp(_sticking_speeds(model, p, states), axis=0)
    reach = reach[reach > 1e-6 * reach.max(initial=0.0)]
    if not reach.size:
        return float(p[at])
    least = float(reach.min())
    without, blunt = p.copy(), p.copy()
    without[at], blunt[at] = 1e12, BLUNT * least
    zero = np.zeros((len(model.inputs), 1))
    slope = (
        np.abs(np.linalg.eigvals(_matrices(model, np.zeros((len(model.states), 1)), zero, blunt[:, None]))).max()
        * blunt[at]
    )
    return float(
        np.clip(slope / (STABLE * max(rate, steps_per_second(model, without[None]))), SHARP * least, BLUNT * least)
    )


def _sticking_speeds(model: Model, p: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Speeds (t, k) of the inertias that carry dry friction."""
    a = model.equations.assembly
    values = dict(zip(a.parameters.values(), p, strict=True))
    speeds = []
    for effect in model.system.effects:
        if effect.law.sticks:
            share = a.motions[effect.at.removeprefix("inertias.")].coefficients
            speeds.append(sum(float(c.xreplace(values)) * states[:, model.n + i] for i, c in share.items()))
    return np.stack(speeds, axis=1) if speeds else np.empty((len(states), 0))
