"""What every bed and the loop have to keep, for a controller to count as robust."""

from __future__ import annotations

from dataclasses import dataclass

from matching.frequency.case.case import Case
from matching.frequency.case.targets import target_modes

DAMPING_SHARE = 1 / 3  # of the least damping of the target modes, for every mode on every bed
MARGIN_FROM_HIGHEST_TARGET = 2.0  # the margin counts from this many times the highest target mode on
ROLLED_OFF_FROM_HZ = 100.0  # where a model of a drivetrain ends, unless the case says otherwise
LARGEST_ROLLED_OFF = 0.5  # of |T| from there on
OF_ITS_OWN = 0.95  # of its damping that a mode of the bed's own keeps, above the roll-off, where that is all it has
NOISE_SHARE = 0.02  # of the dynamometers' torque limit that sensor noise may become, rms


@dataclass(frozen=True)
class Requirements:
    """Least damping ratio of any mode, modulus margin and from where (Hz), roll-off (Hz), command noise (N·m rms)."""

    damping_ratio: float
    modulus_margin: float
    margin_from: float
    rolled_off_from: float
    command_noise: float | None


def rolled_off_from(case: Case) -> float:
    """From where the loop has to have rolled off, Hz."""
    return case.limits.get("rolled_off_from", ROLLED_OFF_FROM_HZ)


def requirements(case: Case) -> Requirements:
    """What a case asks for.

    Raises
    ------
    InputError
        If the vehicle has no such target modes.
    """
    damped = [mode for _, mode in target_modes(case)]
    limits = case.limits
    noise = limits.get("command_noise")
    if noise is None and "dynamometer_torque" in limits:
        noise = NOISE_SHARE * limits["dynamometer_torque"]
    return Requirements(
        DAMPING_SHARE * min(mode.damping_ratio for mode in damped),
        limits["modulus_margin"],
        limits.get("margin_from", MARGIN_FROM_HIGHEST_TARGET * max(mode.frequency for mode in damped)),
        rolled_off_from(case),
        noise,
    )
