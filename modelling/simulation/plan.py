"""How fast a model can move, from the eigenvalues of its linearisation, and the steps that follow from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from modelling.equations.compiled import Model
from modelling.simulation.result import SimulationError

STABLE_STEP = 2.0  # |λ|·h of a fast decay; explicit Runge-Kutta of order four is stable up to 2.78
ACCURATE_STEP = 0.6  # |λ|·h of the fastest vibration: 0.1 % of phase error a radian
CONTACT_STEP = 0.2  # ω·h of the vibration of two inertias on the spring of a lash alone
WELL_DAMPED = 0.7  # −Re λ/|λ| from which on an eigenvalue decays before it vibrates
MAX_STEPS_PER_SECOND = 2e6
PROBED_STATES = 48  # along a motion


@dataclass(frozen=True)
class Rates:
    """Fastest rates of a model, 1/s.

    Attributes
    ----------
    any : float
        Largest magnitude of all eigenvalues.
    vibration : float
        The same of those that vibrate before they decay.
    contact : float
        Angular frequency of two inertias on the spring of a lash alone, 0 without lash.
    """

    any: float
    vibration: float
    contact: float

    def __or__(self, other: Rates) -> Rates:
        return Rates(max(self.any, other.any), max(self.vibration, other.vibration), max(self.contact, other.contact))


def steps_per_second(model: Model, p: np.ndarray) -> float:
    """Explicit steps a second that are stable and accurate about rest, over parameter sets (b, p).

    For what steps at a rate fixed in advance (FMU, controlled rig); :mod:`modelling.simulation.step_control` measures
    the error instead.

    Raises
    ------
    SimulationError
        If more than :data:`MAX_STEPS_PER_SECOND` would be needed, or an eigenvalue is not finite.
    """
    rates = rates_at_rest(model, p)
    needed = max(rates.any / STABLE_STEP, rates.vibration / ACCURATE_STEP, rates.contact / CONTACT_STEP, 1.0)
    if not needed <= MAX_STEPS_PER_SECOND:
        raise too_fast(rates.any, needed)
    return float(needed)


def too_fast(rate: float, needed: float) -> SimulationError:
    """The error for a model with an eigenvalue too fast to step through."""
    return SimulationError(
        "simulation", f"the fastest eigenvalue, {rate:.3g} 1/s, needs {needed:.3g} steps a second",
        f"at most {MAX_STEPS_PER_SECOND:g} are taken: look for a very small inertia, time constant or coefficient",
    )  # fmt: skip


def rates_at_rest(model: Model, p: np.ndarray) -> Rates:
    """Rates about rest over parameter sets (b, p), with every lash closed and dry friction at its steepest.

    Raises
    ------
    SimulationError
        If an eigenvalue is not finite.
    """
    gaps = [model.parameters.index(name) for name in model.system.free_plays.values()]
    closed = p.copy()
    closed[:, gaps] = 0.0
    by_gap = np.stack([closed] * (1 + len(gaps)))  # all closed, then one after the other wide open
    by_gap[1 + np.arange(len(gaps)), :, gaps] = 1e9
    rows = np.concatenate(np.repeat(by_gap, 2, axis=0))  # each for a twist in both directions
    probe = 1e-9 * np.cos(np.arange(model.n) * 1.7)  # no two coordinates alike: every lash is closed
    x = np.zeros((len(model.states), len(rows)))
    x[: model.n] = np.concatenate([np.tile(probe, (len(p), 1)), np.tile(-probe, (len(p), 1))] * len(by_gap)).T
    A, *opened = np.split(_state_matrices(model, x, np.zeros((len(model.inputs), len(rows))), rows.T), len(by_gap))
    contact = 0.0
    for other in opened:
        change = A - other
        square = -np.trace(change[:, model.n : 2 * model.n, : model.n], axis1=1, axis2=2)  # stiffness over inertia
        contact = max(contact, float(np.sqrt(square.max(initial=0.0))))
    alike = (A[: len(p)] == A[len(p) :]).all()  # most laws are the same in both directions
    return _rates(A[: len(p)] if alike else A, contact)


def rates_along(model: Model, p: np.ndarray, states: np.ndarray, inputs: np.ndarray) -> Rates:
    """Rates at some points of a motion, states (t, x) and inputs (t, u), for one parameter set (p,).

    Raises
    ------
    SimulationError
        If an eigenvalue is not finite.
    """
    finite = np.flatnonzero(np.isfinite(states).all(axis=1))
    # evenly spread, and where the motion is fastest
    spread = finite[np.linspace(0, len(finite) - 1, min(len(finite), PROBED_STATES)).astype(int)]
    speeds = states[finite][:, model.n : 2 * model.n]
    chosen = np.unique(np.concatenate([spread, finite[_extremes(speeds - speeds.mean(axis=1, keepdims=True))]]))
    p_columns = np.repeat(p[None], len(chosen), axis=0).T
    return _rates(_state_matrices(model, states[chosen].T, inputs[chosen].T, p_columns), 0.0)


def _extremes(values: np.ndarray) -> np.ndarray:
    """Rows (≤ 2k,) at which the columns (t, k) are largest and smallest."""
    return np.concatenate([values.argmax(axis=0), values.argmin(axis=0)]) if values.size else np.empty(0, int)


def _rates(A: np.ndarray, contact: float) -> Rates:
    values = np.linalg.eigvals(A).ravel()
    size = np.abs(values)
    vibrating = size[-values.real < WELL_DAMPED * size]
    return Rates(float(size.max(initial=0.0)), float(vibrating.max(initial=0.0)), contact)


def _state_matrices(model: Model, x: np.ndarray, u: np.ndarray, p: np.ndarray) -> np.ndarray:
    """A (k, x, x) at several points, given by columns."""
    n, k = x.shape
    A = np.array(model.jacobians.map(k)(x, u, p, np.zeros((1, k)))[0].full()) if n else np.empty((0, 0))
    if not np.isfinite(A).all():
        raise SimulationError(
            "simulation", "the linearised model is not finite", "check parameter values and start state"
        )
    return A.reshape(n, k, n).transpose(1, 0, 2)
