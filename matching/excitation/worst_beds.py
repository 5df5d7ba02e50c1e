"""Beds of the box on which an excitation comes nearest to each limit, and by how much it has to be smaller there."""

from __future__ import annotations

import numpy as np

from matching.excitation.limits import ExcitationLimits
from matching.excitation.motion import ExcitedBeds, ExcitedMotion, SpeedHold
from matching.frequency.case.uncertainty import Box

SLOPE_STEP = 0.5  # of a half-width, over which the slope of a limit's use is taken
AT_ONCE = 8  # beds that are simulated together: recordings of all sensors and shafts are held in memory


def scale_on_worst_beds(limits: ExcitationLimits, box: Box, hold: SpeedHold, torques: np.ndarray) -> float:
    """Largest factor, at most 1, on demanded ``torques`` (t, u), N·m, with no limit exceeded on the box's worst beds.

    For each limit that is the corner to which its use rises, by its slope over each uncertain quantity. No margin is
    left there: the margin is for what is not in the box.

    Raises
    ------
    InputError
        If the steady speed alone exceeds a limit on such a bed.
    """
    positions = np.vstack([np.zeros(len(box.uncertain)), SLOPE_STEP * np.eye(len(box.uncertain))])
    used: list[dict[str, float]] = []
    for first in range(0, len(positions), AT_ONCE):
        beds = _beds(limits, box, hold, positions[first : first + AT_ONCE])
        (commands, outputs), motion = beds.steady(limits.speed), beds.run(torques)
        for b in range(len(commands)):
            part = slice(b, b + 1)
            moved = ExcitedMotion(motion.commands[:, part], motion.outputs[:, part])
            used.append(limits.used((commands[part], outputs[part]), moved, torques))
    shares = np.array([list(of_bed.values()) for of_bed in used])  # (1 + p, l)
    corners = np.unique(np.sign(shares[1:] - shares[0]).T, axis=0)
    scale = 1.0
    for first in range(0, len(corners), AT_ONCE):
        beds = _beds(limits, box, hold, corners[first : first + AT_ONCE])
        steady = beds.steady(limits.speed)
        limits.check_steady(steady, 1.0)
        scale = min(scale, limits.largest_scale(steady, beds.run(torques), torques, 1.0))
    return scale


def _beds(limits: ExcitationLimits, box: Box, hold: SpeedHold, positions: np.ndarray) -> ExcitedBeds:
    return ExcitedBeds(limits.bed, [box.at(position) for position in positions], hold)
