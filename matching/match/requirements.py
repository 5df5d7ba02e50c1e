"""The limits of a case file, and what every bed and the loop have to keep for a controller to count as robust."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from matching.match.case import LIMITS_OF_ALL, Case, own_limit, table_of
from matching.match.targets import target_modes
from modelling.bed.vehicle import TorqueCurve, read_torque_curve
from modelling.errors import InputError, unknown
from modelling.modal.modes import damped_modes
from modelling.system import System
from modelling.units import to_si

# --- Reading the limits of a case file.

LIMIT_UNITS = {
    "modulus_margin": "1",
    "margin_from": "Hz",
    "rolled_off": "1",
    "rolled_off_from": "Hz",
    "command_noise": "N*m",
    "sensor_offset": "N*m",
    "damping_ratio": "1",
    "damping_share": "1",
    "dynamometer_torque": "N*m",
    "dynamometer_speed": "rad/s",
    "dynamometer_power": "W",
}
STRESSES = ("shear_stress", "shear_stress_amplitude")  # of a shaft by its drawing: largest, and half of its range
OPENED_SHAFTS = "opened_shafts"  # as a limit: whether cut shafts that free play opens have to leave a bed stable
DEFAULT_LIMITS: dict[str, float] = {
    "modulus_margin": 0.5,
    "rolled_off": 0.5,
    "rolled_off_from": 100.0,  # where a model of a drivetrain ends
    "damping_ratio": 0.01,
    "damping_share": 1 / 3,
    OPENED_SHAFTS: True,
}
MARGIN_FROM_HIGHEST_TARGET = 2.0  # times the highest target mode: ``margin_from`` unless stated
NOISE_SHARE = 0.02  # of the dynamometers' torque limit: ``command_noise`` unless stated
OFFSET_SHARE = 0.02  # of the same, a twentieth of what ends an emulation: ``sensor_offset`` unless stated
TORQUE_OVER_SPEED = "dynamometer_torque_over_speed"  # as a limit: 1, on the share of the curve that is used


def limit_units(rig: System, dynamometers: Iterable[str] = ()) -> dict[str, str]:
    """Unit of every limit that a case may state, by its key; but for the torque over speed, which is a list."""
    return (
        LIMIT_UNITS
        | {own_limit(name, what): LIMIT_UNITS[key] for name in dynamometers for what, key in LIMITS_OF_ALL.items()}
        | {f"shafts.{part.name}.torque": "N*m" for part in rig.shafts}
        | {f"shafts.{part.name}.twist": "rad" for part in rig.shafts}
        | {f"shafts.{part.name}.{what}": "Pa" for part in rig.shafts if part.drawing for what in STRESSES}
    )


def read_limits(data: Mapping[str, Any], rig: System, where: str) -> tuple[dict[str, float], TorqueCurve | None]:
    """Limits by key, SI, and the dynamometers' torque over speed; its last speed limits the speed."""
    table = table_of(data, "limits", where)
    units = limit_units(rig, table_of(data, "dynamometers", where))
    limits = dict(DEFAULT_LIMITS)
    curve = None
    for key, value in table.items():
        if key == TORQUE_OVER_SPEED:
            curve = read_torque_curve(value, f"{where}: limits.{key}")
            continue
        if key == OPENED_SHAFTS:
            if not isinstance(value, bool):
                raise InputError(f"{where}: limits.{key}", f"{value!r} is no yes or no", "true or false is needed")
            limits[key] = value
            continue
        if key not in units:
            _check_drawn(key, rig, f"{where}: limits.{key}")
            raise unknown(key, [*units, OPENED_SHAFTS, TORQUE_OVER_SPEED], f"{where}: limits")
        limits[key] = to_si(value, units[key], f"{where}: limits.{key}")
        if not limits[key] > 0:
            raise InputError(f"{where}: limits.{key}", f"{limits[key]:g} is not possible", "greater than 0 is needed")
    for key, usual in {"modulus_margin": "0.5", "damping_ratio": "0.01", "damping_share": "1/3"}.items():
        if limits[key] >= 1:
            wrong, right = f"{limits[key]:g} cannot be reached", f"less than 1 is needed; {usual} is usual"
            raise InputError(f"{where}: limits.{key}", wrong, right)
    if curve is not None:
        limits[TORQUE_OVER_SPEED] = 1.0
        limits["dynamometer_speed"] = min(limits.get("dynamometer_speed", curve.speeds[-1]), curve.speeds[-1])
    return limits, curve


def _check_drawn(key: str, rig: System, place: str) -> None:
    """Refuse a shear stress of a shaft whose diameters no file states."""
    shaft, _, what = key.removeprefix("shafts.").rpartition(".")
    if what in STRESSES and key.startswith("shafts.") and shaft in {part.name for part in rig.shafts}:
        raise InputError(place, "needs the diameter of the shaft", "state the shaft by its drawing: length, diameter")


# --- What every bed and the loop have to keep, for a controller to count as robust.


@dataclass(frozen=True)
class Requirements:
    """Robustness requirements of a case, by its ``[limits]``.

    Attributes
    ----------
    damping_ratio, damping_share : float
        Least damping ratio of a mode on any bed that is neither the vehicle's nor the bed's own: this share of the
        least damping of the target modes. See :mod:`matching.match.damping`.
    vehicle_modes : tuple of (float, float)
        |s| in rad/s and damping ratio of the emulated vehicle's modes.
    decay_rate : float
        1/s: least rate of decay of what runs on known torques alone, ``damping_share`` of the least one of these modes.
    modulus_margin, margin_from : float
        Least singular value of I + L, and from where it counts, Hz.
    rolled_off, rolled_off_from : float
        Largest abs(T), and from where it counts, Hz.
    command_noise : tuple of float (k)
        N·m rms of every dynamometer, infinite where the case states no limit.
    sensor_offset : tuple of float (f)
        N·m: how far a flange torque may be from what an observer expects, a minute after every sensor is off by its
        uncertainty; infinite without a limit.
    opened_shafts : bool
        Whether an observer has to keep beds stable whose cut shafts free play opens (:mod:`matching.match.opened`).
    """

    damping_ratio: float
    damping_share: float
    modulus_margin: float
    margin_from: float
    rolled_off: float
    rolled_off_from: float
    command_noise: tuple[float, ...]
    sensor_offset: tuple[float, ...]
    vehicle_modes: tuple[tuple[float, float], ...] = ()
    decay_rate: float = 0.0
    opened_shafts: bool = True


def requirements(case: Case) -> Requirements:
    """What a case asks for; without targets, at another speed of a range, of the vehicle's modes within the band."""
    limits, swinging = case.limits, [mode for mode in damped_modes(case.emulated_vehicle) if mode.frequency > 0]
    within = [mode for mode in swinging if mode.damping_ratio < 1 and mode.frequency <= case.band[1]]
    damped = [mode for _, mode in target_modes(case)] or within or swinging
    vehicle = tuple((2 * np.pi * mode.frequency, mode.damping_ratio) for mode in swinging if mode.damping_ratio < 1)
    torque, noise = case.limits_of("torque"), case.limits_of("command_noise")
    noise = np.where(np.isinf(noise), NOISE_SHARE * torque, noise)
    offset = np.full(len(torque), limits["sensor_offset"]) if "sensor_offset" in limits else OFFSET_SHARE * torque
    return Requirements(
        limits["damping_share"] * min(mode.damping_ratio for mode in damped),
        limits["damping_share"],
        limits["modulus_margin"],
        limits.get("margin_from", MARGIN_FROM_HIGHEST_TARGET * max(mode.frequency for mode in damped)),
        limits["rolled_off"],
        limits["rolled_off_from"],
        tuple(noise.tolist()),
        tuple(offset[case.loop.with_flange].tolist()),
        vehicle,
        limits["damping_share"] * min((size * ratio for size, ratio in vehicle), default=0.0),
        bool(limits[OPENED_SHAFTS]) and case.loop.structure.is_observer,
    )
