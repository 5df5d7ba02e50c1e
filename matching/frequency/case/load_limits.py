"""Reading the limits of a case file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matching.frequency.case.tables import table_of
from modelling.bed.torque_curve import TorqueCurve, read_torque_curve
from modelling.common.errors import InputError, unknown
from modelling.model.system import System
from modelling.units import to_si

LIMIT_UNITS = {
    "modulus_margin": "1",
    "margin_from": "Hz",
    "rolled_off_from": "Hz",
    "command_noise": "N*m",
    "damping_ratio": "1",
    "dynamometer_torque": "N*m",
    "dynamometer_speed": "rad/s",
    "dynamometer_power": "W",
}
DEFAULT_LIMITS = {"modulus_margin": 0.5, "damping_ratio": 0.01}
TORQUE_OVER_SPEED = "dynamometer_torque_over_speed"  # as a limit: 1, on the share of the curve that is used


def limit_units(rig: System) -> dict[str, str]:
    """Unit of every limit that a case may state, by its key; but for the torque over speed, which is a list."""
    return (
        LIMIT_UNITS
        | {f"shafts.{part.name}.torque": "N*m" for part in rig.shafts}
        | {f"shafts.{part.name}.twist": "rad" for part in rig.shafts}
    )


def read_limits(data: Mapping[str, Any], rig: System, where: str) -> tuple[dict[str, float], TorqueCurve | None]:
    """Limits by key, SI, and the dynamometers' torque over speed; its last speed limits the speed.

    Raises
    ------
    InputError
        Naming file and key.
    """
    table = table_of(data, "limits", where)
    units = limit_units(rig)
    limits: dict[str, float] = dict(DEFAULT_LIMITS)
    curve = None
    for key, value in table.items():
        if key == TORQUE_OVER_SPEED:
            curve = read_torque_curve(value, f"{where}: limits.{key}")
            continue
        if key not in units:
            raise unknown(key, [*units, TORQUE_OVER_SPEED], f"{where}: limits")
        limits[key] = to_si(value, units[key], f"{where}: limits.{key}")
        if not limits[key] > 0:
            raise InputError(f"{where}: limits.{key}", f"{limits[key]:g} is not possible", "greater than 0 is needed")
    if limits["modulus_margin"] >= 1:
        raise InputError(
            f"{where}: limits.modulus_margin",
            f"{limits['modulus_margin']:g} cannot be reached",
            "less than 1 is needed; 0.5 is usual",
        )
    if limits["damping_ratio"] >= 1:
        where, wrong = f"{where}: limits.damping_ratio", f"{limits['damping_ratio']:g} is no motion that swings"
        raise InputError(where, wrong, "less than 1 is needed; 0.01 is usual")
    if curve is not None:
        limits[TORQUE_OVER_SPEED] = 1.0
        limits["dynamometer_speed"] = min(limits.get("dynamometer_speed", curve.speeds[-1]), curve.speeds[-1])
    return limits, curve
