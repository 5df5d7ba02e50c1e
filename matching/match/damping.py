"""Stability and damping of a sampled loop: the one rule for both, and how much damping each mode is asked for."""

from __future__ import annotations

import numpy as np

from matching.match.requirements import Requirements

# --- Poles of a sampled loop; b beds, x poles.

FORGOTTEN = 1e-3  # of z: poles that decay faster have no frequency worth a number
AT_REST = 1e-7  # of z: a rigid motion without drag stands at 1; rounding moves it by less
SLOWEST_SWING_RAD_S = 1.0  # below, a pair of poles is a drift, not a mode


def without_resting(z: np.ndarray, neutral: int) -> np.ndarray:
    """Poles (b, x) of a loop with 0 in place of those nearest to 1, ``neutral`` at most: motions that nothing slows."""
    near = np.argsort(np.abs(z - 1), axis=1)[:, :neutral]
    rows, moving = np.arange(len(z))[:, None], z.astype(complex)
    moving[rows, near] = np.where(np.abs(z[rows, near] - 1) < AT_REST, 0.0, z[rows, near])
    return moving


def stable_loops(z: np.ndarray, neutral: int) -> np.ndarray:
    """Which loops (b,) with poles (b, x) are stable, as bool: inside the unit circle, but for ``neutral`` at 1."""
    stable: np.ndarray = (np.abs(without_resting(z, neutral)) < 1).all(axis=1)
    return stable


def is_stable_loop(z: np.ndarray, neutral: int) -> bool:
    """The same of one loop with poles (x,)."""
    return bool(stable_loops(z[None], neutral)[0])


def rates(z: np.ndarray, step: float) -> np.ndarray:
    """Poles (b, x) of a loop with this sampling interval (s) in continuous time, 1/s."""
    s: np.ndarray = np.log(np.where(np.abs(z) > FORGOTTEN, z, 0.5).astype(complex)) / step
    return s


def swinging(z: np.ndarray, step: float) -> np.ndarray:
    """Which poles (b, x) of a loop with this sampling interval (s) swing, as bool."""
    found: np.ndarray = (np.abs(z) > FORGOTTEN) & (np.abs(rates(z, step).imag) > SLOWEST_SWING_RAD_S)
    return found


def damping_ratios(z: np.ndarray, step: float) -> np.ndarray:
    """Damping ratios (b, x) of poles (b, x) of a loop with this sampling interval (s); 1 of what does not swing."""
    s = rates(z, step)
    return np.where(swinging(z, step), -s.real / np.maximum(np.abs(s), 1e-300), 1.0)


def decay_rates(z: np.ndarray, step: float) -> np.ndarray:
    """Rates of decay (b, x), 1/s, of poles (b, x) that swing; infinite of those that do not, negative if unstable."""
    rate = -np.log(np.maximum(np.abs(z), 1e-300)) / step
    return np.where(swinging(z, step) | (np.abs(z) >= 1), rate, np.inf)


# --- How much damping a mode of the loop is asked for.
#
# A bed that reproduces a vehicle has the vehicle's modes, and it keeps those of its own that the dynamometers do not
# reach. So a mode that lies near one of the vehicle's is asked for a share of that mode's damping, a mode that stays
# where the bed without control has it for nearly all that it has there, and every other one for a share of the least
# damping of the target modes. Between near and far the requirement passes evenly from one to the other, so that a
# search sees no step.

KEPT_DAMPING = 0.95  # of its damping without control that a mode of the bed's own keeps
OWN_RESERVE = 0.05  # of the reserve of other modes, for such a mode: control may take 5 % of its damping and give none
LEAST_DAMPING = 1e-6  # damping ratio: least that any mode is asked for
OF_VEHICLE = (0.1, 0.25)  # |ln(f/f₀)| to a vehicle's mode: near, and far; specimens of drawn beds move it by 0.05
OF_BED = (
    0.03,
    0.1,
)  # |ln(s/s₀)| to a mode of the bed without control: near, and far; what control moves is not its own


def asked_damping(
    z: np.ndarray, step: float, required: Requirements, own: np.ndarray, fast: np.ndarray, reserve: float = 1.0
) -> np.ndarray:
    """Damping ratios (b, x) that the modes of poles (b, x) are asked for.

    Parameters
    ----------
    step : float
        Sampling interval, s.
    required : Requirements
    own : ndarray (b, m)
        Modes of each bed without control, 1/s, upper half plane.
    fast : ndarray (b,)
        Least damping ratio of these where the loop has to have rolled off: no control helps there.
    reserve : float
        Factor on the required damping; of modes that control does not change only a small part of it is required.
    """
    least, s, kept = reserve * required.damping_ratio, rates(z, step), KEPT_DAMPING * (1 + OWN_RESERVE * (reserve - 1))
    size, upper = np.abs(s), np.where(s.imag < 0, s.conj(), s)
    asked = np.full(s.shape, least)
    for mode, ratio in required.vehicle_modes:
        of_mode = reserve * required.damping_share * ratio
        if of_mode < least:
            asked = np.minimum(asked, least + _near(np.abs(np.log(size / mode)), OF_VEHICLE) * (of_mode - least))
    for mode in own.T:  # (b,)
        of_own = kept * np.maximum(-mode.real / np.abs(mode), LEAST_DAMPING)
        light = of_own < least
        if light.any():
            apart = np.abs(np.log(upper / np.where(light, mode, 1j)[:, None]))
            closeness = np.where(light[:, None], _near(apart, OF_BED), 0.0)
            asked = np.minimum(asked, least + closeness * (np.where(light, of_own, least)[:, None] - least))
    of_fast = kept * np.maximum(fast, LEAST_DAMPING)[:, None]
    beyond = size >= 2 * np.pi * required.rolled_off_from
    return np.maximum(np.where(beyond, np.minimum(asked, of_fast), asked), LEAST_DAMPING)


def _near(apart: np.ndarray, ends: tuple[float, float]) -> np.ndarray:
    """1 up to the near end, 0 from the far one on, even between them."""
    near, far = ends
    closeness: np.ndarray = np.clip((far - apart) / (far - near), 0.0, 1.0)
    return closeness
