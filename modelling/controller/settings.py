"""What the supervision of a controller needs to know: limits, speed hold, when to give up."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

ZERO_TORQUE, SPEED_HOLD, EMULATION = 0, 1, 2  # modes
FAULTS = ("none", "not finite", "missing", "frozen", "overspeed", "torque gone", "unexpected")
TORQUE_GONE = FAULTS.index("torque gone")
HOLDABLE = (4, 5, 6)  # faults after which the speeds are still known: speed hold; after others zero torque
SAMPLES_IN_A_ROW = 2  # that a reading has to be unexpected, so that a single wrong value does not count
HELD_BELOW_LIMIT = 0.95  # of the largest speed: what is held after an overspeed
NO_LIMIT = 1e12  # N·m, rad/s: larger than anything on a bed, and finite, as FMI wants it
SLOWEST = 1e-6  # rad/s: power limits no torque below it
OPENED_SHARE = 0.5  # of the torque that it carried that an opened shaft seems to lose at least
TURNING = 1.0  # rad/s: a rotor that turns faster cannot have readings that do not change


@dataclass(frozen=True)
class Settings:
    """Limits and thresholds; k dynamometers, y readings, s shafts that are watched.

    Attributes
    ----------
    torque_limit, speed_limit, power_limit : ndarray (k,)
        N·m, rad/s, W: air-gap torques stay within torque and power.
    hold_proportional, hold_integral : ndarray (k,)
        N·m·s/rad, N·m/rad of the speed hold.
    lost_torque : ndarray (k,)
        N·m: a flange torque above it that is gone at once is a broken shaft, see :mod:`.torque_gone`.
    torque_gain : ndarray (k,)
        Air-gap torque over command as calibrated: commands are divided by it.
    curve_speeds, curve_torques : ndarray (p,)
        rad/s, N·m: largest torque over speed of every dynamometer, straight between the points.
    opened_torque : ndarray (s,)
        N·m: a watched shaft that carries more and loses it counts as opened, see :mod:`.opened_shaft`.
    unexpected : ndarray (y,)
        How far a reading may be from what the controller's model expects, in its unit.
    frozen_samples : int
        So many samples with the same readings on a turning bed stop the emulation; 0 switches it off.
    opened_share : float
        Of the torque that it carried that an opened shaft loses at least.
    life_samples : int
        So many samples without a change of the sign of life stop the emulation; 0 switches it off.
    """

    torque_limit: np.ndarray
    speed_limit: np.ndarray
    hold_proportional: np.ndarray
    hold_integral: np.ndarray
    lost_torque: np.ndarray
    torque_gain: np.ndarray
    unexpected: np.ndarray
    power_limit: np.ndarray
    curve_speeds: np.ndarray
    curve_torques: np.ndarray
    opened_torque: np.ndarray = field(default_factory=lambda: np.zeros(0))
    opened_share: float = OPENED_SHARE
    frozen_samples: int = 4
    life_samples: int = 0
